"""Stored runs that are no longer wanted are found, and removed from their file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fvi_cli.errors import RequestError
from fvi_cli.runner.request import STORED_SUFFIX, gather
from fvi_cli.storage import Location, Store, key_of, open_results, read_results, variant_of


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Which runs of a result file are meant: those for which everything that is given holds.

    Parameters
    ----------
    overrides
        Changes ``key.path=value`` of the file's configuration: the runs that it asks for then.
    case
        Name of a method in files, or its beginning up to a ``-``.
    others
        The runs that the file's configuration does not ask for.
    everything
        All runs.

    Raises
    ------
    RequestError
        If nothing is given, or something beside everything.
    """

    overrides: tuple[str, ...] = ()
    case: str | None = None
    others: bool = False
    everything: bool = False

    def __post_init__(self) -> None:
        is_some = bool(self.overrides or self.case or self.others)
        if not is_some and not self.everything:
            raise RequestError("say which runs: --set KEY.PATH=VALUE, --case, --others or --all")
        if is_some and self.everything:
            raise RequestError("--all: means every run, and goes with no other choice")
        if self.overrides and self.others:
            raise RequestError("--set and --others: give one of them")


def forget_runs(path: Path, selection: Selection, *, is_tried: bool = False) -> list[Location]:
    """Remove runs from a result file; returns what they were.

    Parameters
    ----------
    path
        The file. Where no run remains it is removed.
    selection
        Which runs.
    is_tried
        Only find them.

    Raises
    ------
    RequestError
        If there is no such run; nothing is changed then.
    StorageError
        If the file cannot be read or written, or another command writes it.
    """
    if path.suffix != STORED_SUFFIX:
        raise RequestError(f"{path}: runs are forgotten in a result file, such as {path.stem}.h5")
    # says what is wrong with the file, or with the changes, before it is held
    (request,) = gather([str(path)], selection.overrides)
    asked = [key_of(run) for one in request.loaded.experiments for run in one.runs()]
    searched = [
        (one.name, variant_of(search.specification(), one.swept))
        for one in request.loaded.experiments
        for search in one.searches()[:1]
    ]
    held = read_results(path) if is_tried else open_results(path.parent, path.stem)
    with held as store:
        found = _chosen(store, selection, asked, searched)
        if not found:
            raise RequestError(f"{path}: holds no such run; `fvi show {path}` lists what it holds")
        if not is_tried:
            store.forget(found)
    return found


def _chosen(
    store: Store,
    selection: Selection,
    asked: Sequence[tuple[object, ...]],
    searched: Sequence[tuple[str, str]],
) -> list[Location]:
    wanted = set(asked)

    def is_asked(one: Location) -> bool:
        return one.key[:3] in wanted or (one.place[0], one.key[1]) in searched

    def is_meant(one: Location) -> bool:
        if selection.case is not None:
            case = one.place[1]
            if case != selection.case and not case.startswith(f"{selection.case}-"):
                return False
        if selection.others:
            return not is_asked(one)
        return is_asked(one) if selection.overrides else True

    return [one for one in store.locations() if is_meant(one)]
