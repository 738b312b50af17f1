"""Result files of one configuration, such as those of its parts, are joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fvi_cli.errors import RequestError
from fvi_cli.runner.request import STORED_SUFFIX, gather
from fvi_cli.storage import open_results, read_configuration, read_results
from fvi_cli.storage.atomic import file_lock


@dataclass(frozen=True, kw_only=True)
class Merged:
    """What became of files that were joined."""

    path: Path  # the file that holds the runs of all
    runs: int  # how many runs the configuration asks for
    missing: int  # how many of them are in none of the files


def merge_files(paths: Sequence[Path], output: Path, *, waits: bool = False) -> Merged:
    """Join the runs of result files into ``<name>.h5``; every run is verified on the way.

    Runs that are there already stay, as do the files that are joined. Commands that write one of
    the files are waited for if asked (`waits`).

    Raises
    ------
    RequestError
        If the files are not of one configuration.
    StorageError
        If one cannot be read, is damaged or still being written, or two have the same run with
        other numbers; then nothing is changed.
    """
    wrong = [path for path in paths if path.suffix != STORED_SUFFIX]
    if wrong:
        raise RequestError(f"{wrong[0]}: not a result file; give files such as {wrong[0].stem}.h5")
    first = paths[0]
    configuration = read_configuration(first)
    for path in paths[1:]:
        if read_configuration(path).resolved != configuration.resolved:
            raise RequestError(
                f"{path}: is of another configuration than {first}; `fvi show --config` prints them"
            )
    (request,) = gather([str(first)])
    name, experiments = request.name, request.loaded.experiments
    # members of a large sweep are not needed while they are written
    del request
    target = output / f"{name}{STORED_SUFFIX}"
    with open_results(output, name, waits=waits) as store:
        for path in paths:
            if target.exists() and path.samefile(target):
                continue
            with file_lock(path, waits=waits), read_results(path) as part:
                store.merge(part)
        runs = (run for one in experiments for run in one.runs())
        count, missing = store.mark_requested(runs)
        del experiments
        store.consolidate(configuration)
    return Merged(path=target, runs=count, missing=missing)
