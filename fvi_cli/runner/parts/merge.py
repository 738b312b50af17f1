"""Merging of result files of one configuration, such as those of its parts."""

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
    """The result of merging files."""

    path: Path  # the file that holds the runs of all files
    runs: int  # number of runs that the configuration requests
    missing: int  # number of these that no file holds


def merge_files(paths: Sequence[Path], output: Path) -> Merged:
    """Merge the runs of result files into ``<name>.h5``.

    Runs that ``<name>.h5`` already has stay, and so do the merged files.

    Raises
    ------
    RequestError
        If the files are not of one configuration.
    StorageError
        If a file cannot be read, is damaged or still being written; all files are unchanged
        then.
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
    # free the memory of the members of a large sweep before writing
    del request
    target = output / f"{name}{STORED_SUFFIX}"
    with open_results(output, name) as store:
        for path in paths:
            if target.exists() and path.samefile(target):
                continue
            with file_lock(path), read_results(path) as part:
                store.merge(part)
        runs = (run for one in experiments for run in one.runs())
        count, missing = store.mark_requested(runs)
        del experiments
        store.consolidate(configuration)
    return Merged(path=target, runs=count, missing=missing)
