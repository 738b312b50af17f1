"""Find stored runs that are no longer wanted, and remove them from their file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fvi_cli.errors import RequestError
from fvi_cli.runner.request import STORED_SUFFIX, gather
from fvi_cli.storage import Entry, open_results, read_results
from fvi_cli.storage.digests import identity_of, refusal_of


def forget_runs(
    path: Path,
    *,
    overrides: Sequence[str] = (),
    case: str | None = None,
    others: bool = False,
    everything: bool = False,
    is_tried: bool = False,
) -> list[Entry]:
    """Remove the runs that meet all given conditions from a result file, and return them.

    With `overrides` these are the runs that the file's configuration requests after these changes,
    with `others` those that it does not request; with `case` the runs of this method (or of all
    methods whose name begins with it up to a ``-``); with `everything` all runs. A file without
    runs is removed. With `is_tried` the runs are found but not removed.

    Raises
    ------
    RequestError
        If no selection is given, or one together with `everything`, or no run matches; the file is
        unchanged then.
    StorageError
        If the file cannot be read or written, or another command writes it.
    """
    is_some = bool(overrides or case or others)
    if not is_some and not everything:
        raise RequestError("say which runs: --set KEY.PATH=VALUE, --case, --others or --all")
    if is_some and everything:
        raise RequestError("--all: means every run; leave out the other options")
    if overrides and others:
        raise RequestError("--set and --others: give one of them")
    if path.suffix != STORED_SUFFIX:
        raise RequestError(f"{path}: not a result file; give one, such as {path.stem}.h5")
    # errors in the file or the changes are raised before the file is locked
    (request,) = gather([str(path)], overrides)
    runs = (run for one in request.loaded.experiments for run in one.runs())
    identities = {identity_of(run) for run in runs}
    identities |= {refusal_of(one) for one in identities}

    def is_meant(one: Entry) -> bool:
        if case is not None and not f"{one.kind.case}-".startswith(f"{case}-"):
            return False
        return (one.identity in identities) != others if overrides or others else True

    held = read_results(path) if is_tried else open_results(path.parent, path.stem)
    with held as store:
        found = [one for one in store.entries() if is_meant(one)]
        if not found:
            raise RequestError(f"{path}: no run matches; `fvi show {path}` lists its runs")
        if not is_tried:
            store.forget(found)
    return found


def forget(
    path: Path | str,
    *,
    overrides: Sequence[str] = (),
    case: str | None = None,
    others: bool = False,
    everything: bool = False,
) -> int:
    """Remove runs from a result file, as ``fvi forget`` does, and return their number.

    The runs that its configuration requests with `overrides`, of the method `case`, not requested
    (`others`), or all (`everything`).

    Raises
    ------
    RequestError
        If no selection is given, or no run matches.
    """
    found = forget_runs(
        Path(path), overrides=overrides, case=case, others=others, everything=everything
    )
    return len(found)
