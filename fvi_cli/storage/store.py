"""A result file and its parts: finding, adding, reading and folding runs."""

from __future__ import annotations

import contextlib
import json
import logging
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import h5py

from fvi_cli.errors import StorageError
from fvi_cli.scenes.records.inputs import keep_numbers
from fvi_cli.storage.columns import arrays_of_row
from fvi_cli.storage.fields import finished_of
from fvi_cli.storage.files import UNFINISHED, explain_os_error, file_lock, replace_file
from fvi_cli.storage.fold import INDEX, Fold, run_groups
from fvi_cli.storage.groups import GroupRows, rows_in_block
from fvi_cli.storage.hdf5 import (
    OTHER_VERSION,
    DamagedFileError,
    Source,
    children,
    opened,
)
from fvi_cli.storage.identity import identity_of, reference_identity_of
from fvi_cli.storage.parts import (
    CONFIGURATION,
    INPUTS,
    configuration_part_of,
    texts_in,
)
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.reference import Reference, Tabulated

_logger = logging.getLogger(__name__)

SUFFIX: Final = ".h5"
PARTIAL: Final = ".partial"
_RUNNING: Final = ".running"
_OF_VERSION_3: Final = (".journal", ".parts")
"""Endings of files and folders that version 0.3 wrote beside a result file."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a run is stored: file (or its content), group and row."""

    source: Source
    group: str
    row: int


@dataclass(frozen=True)
class StoredConfiguration:
    """The configuration that made a file."""

    text: str  # word for word
    overrides: tuple[str, ...]  # changes ``key.path=value`` that the command made to it
    resolved: Mapping[str, Any]  # with every default filled in and every override applied
    digest: str


class Store:
    """``NAME.h5`` and ``NAME.partial/``, as one command sees them.

    Without a path, or if it does not keep what is added, additions stay in memory.

    Raises
    ------
    StorageError
        For files of other versions and other programs.
    """

    def __init__(self, path: Path | None, *, keeps: bool = True) -> None:
        self.path = path
        self.keeps = keeps and path is not None
        self._memory: dict[str, bytes] = {}
        self._places: dict[str, Place] = {}
        self._known: dict[Source, int] = {}
        if path is not None:
            for ending in _OF_VERSION_3:
                if (other := path.with_suffix(ending)).exists():
                    raise StorageError(OTHER_VERSION.format(path=other, version="0.3"))
        self.look()

    def __len__(self) -> int:
        return len(self._places)

    @property
    def folder(self) -> Path:
        """The folder of the parts."""
        if self.path is None:
            raise StorageError("results in memory have no folder")
        return self.path.with_suffix(PARTIAL)

    def parts(self) -> list[Path]:
        """The parts in the folder, the oldest first."""
        found = []
        for path in [] if self.path is None else self.folder.glob(f"*{SUFFIX}"):
            # another command may have folded it
            with contextlib.suppress(FileNotFoundError):
                found.append((path.stat().st_mtime_ns, path))
        return [path for _, path in sorted(found)]

    def sources(self) -> list[Path]:
        """The file and its parts, the oldest first."""
        own = [self.path] if self.path is not None and self.path.exists() else []
        return own + self.parts()

    def look(self) -> None:
        """Find the runs of the file and of the parts that are new."""
        if self.path is not None and self.path.exists():
            changed = self.path.stat().st_mtime_ns
            if self._known.get(self.path) != changed:
                self._places |= _indexed(self.path)
                self._known[self.path] = changed
        sources: list[Source] = [*self.parts(), *self._memory.values()]
        for source in sources:
            if source not in self._known:
                self._known[source] = 0
                try:
                    self._places |= _surveyed(source)
                except DamagedFileError as error:
                    _logger.warning("%s", error)
                except FileNotFoundError:
                    continue

    def has(self, identity: str) -> bool:
        """Whether a run or a reference is stored."""
        return identity in self._places

    def has_part(self, name: str) -> bool:
        """Whether a part is there, such as one that another command has written meanwhile."""
        return self.path is not None and (self.folder / name).exists()

    def has_grown(self) -> bool:
        """Whether another command has folded parts since the last look."""
        if self.path is None or not self.path.exists():
            return False
        return self.path.stat().st_mtime_ns != self._known.get(self.path)

    def add(self, name: str, content: bytes) -> None:
        """Store a part; :meth:`look` finds its runs."""
        if not self.keeps:
            self._memory[name] = content
            return
        with explain_os_error(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
            replace_file(self.folder / name, content)

    def read(self, runs: Sequence[Run], *, motions: bool = True) -> dict[Run, FinishedRun]:
        """The stored ones among some runs; a search gives the run that it chose.

        Without `motions` members of a sweep have no points.
        """
        found: dict[Run, FinishedRun] = {}
        wanted = {
            run: self._places[one] for run in runs if (one := identity_of(run)) in self._places
        }
        for run, rows, row, values, arrays in _read(wanted, motions=motions):
            own = _chosen(run, values)
            found[run] = finished_of(own, values, arrays_of_row(rows, arrays, row, values))
        return found

    def references(self, runs: Sequence[Run]) -> dict[Run, Reference | None]:
        """The stored references of some runs; None where the exact solution is one."""
        found: dict[Run, Reference | None] = {}
        names = {run: reference_identity_of(run) for run in runs}
        wanted = {run: self._places[one] for run, one in names.items() if one in self._places}
        for run, rows, row, values, block in _read(wanted, motions=True):
            arrays = arrays_of_row(rows, block, row, values)
            found[run] = None
            if "time" in arrays:
                table = Tabulated(time=arrays["time"], position=arrays["position"])
                error, source = float(values["reference_error"]), str(values["reference"])
                found[run] = Reference(values=table, error=error, source=source)
        return found

    def describe(self, text: str, resolved: Mapping[str, Any], overrides: Sequence[str]) -> None:
        """Store the configuration of a command, unless the file has it already."""
        digest, content = configuration_part_of(text, resolved, overrides)
        if self.path is None or not self.keeps or _digest_of(self.path) == digest:
            return
        self.add(f"{digest[:24]}{SUFFIX}", content)

    def configuration(self) -> StoredConfiguration:
        """The latest configuration; the numbers of its files are then known to the process.

        Raises
        ------
        StorageError
            If there is none.
        """
        if not self.sources():
            hint = "" if str(self.path).endswith(SUFFIX) else "; result files end in .h5"
            raise StorageError(f"{self.path}: no such file{hint}")
        for source in reversed(self.sources()):
            with opened(source, CONFIGURATION) as file:
                if CONFIGURATION not in file:
                    continue
                texts = texts_in(file[CONFIGURATION])
                for _, group in children(file[INPUTS]) if INPUTS in file else ():
                    keep_numbers(group["numbers"][()])
            return StoredConfiguration(
                text=texts["text"],
                overrides=tuple(json.loads(texts["overrides"])),
                resolved=json.loads(texts["resolved"]),
                digest=texts["digest"],
            )
        raise StorageError(f"{self.path}: holds no configuration")

    def fold(self, requested: Sequence[Run] = (), *, prunes: bool = False) -> None:
        """Make one file of the file and its parts, which are then removed.

        Runs that are not `requested` move to ``/@kept/``, or are dropped if it `prunes`. One
        command folds at a time; a part that appears meanwhile waits for the next. A damaged part is
        set aside. Where the file system has no locks, parts stay.
        """
        if (
            self.path is None
            or not self.keeps
            or not (self.parts() or (prunes and self.path.exists()))
        ):
            return
        with (
            explain_os_error(self.path),
            file_lock(self.path.with_name(f".{self.path.name}.lock"), waits=True) as is_held,
        ):
            if not is_held:
                _logger.warning("%s: no locks on this file system; parts stay there", self.folder)
                return
            # of a fold that was killed
            for path in self.path.parent.glob(f".{self.path.name}.*{UNFINISHED}"):
                path.unlink(missing_ok=True)
            parts = self.parts()
            while True:
                sources = [*([self.path] if self.path.exists() else []), *parts]
                try:
                    kept = Fold(sources, requested, prunes=prunes).write(self.path)
                    break
                except DamagedFileError as error:
                    if error.path not in parts:
                        raise
                    _logger.warning("%s", error)
                    error.path.replace(error.path.with_suffix(".damaged"))
                    parts.remove(error.path)
            for path in parts:
                path.unlink(missing_ok=True)
            self._remove_unfinished()
        if kept:
            _logger.info(
                "%s: also holds %d runs with other settings; `fvi show` lists them, "
                "`fvi run --prune` drops them", self.path, kept,
            )  # fmt: skip
        self._places.clear()
        self._known.clear()
        self.look()

    def _remove_unfinished(self) -> None:
        """Remove the folder of parts, and files that a killed command left there."""
        now = max((one.stat().st_mtime for one in self.folder.glob("*")), default=0.0)
        for path in self.folder.glob(f".*{UNFINISHED}"):
            with contextlib.suppress(OSError):
                if path.stat().st_mtime < now - 3600 or not any(self.folder.glob(f"*{SUFFIX}")):
                    path.unlink(missing_ok=True)
        # another command may have written a part meanwhile
        if not any(self.folder.glob(f"*{SUFFIX}")):
            with contextlib.suppress(OSError):
                (self.folder / _RUNNING).unlink(missing_ok=True)
                self.folder.rmdir()


@contextlib.contextmanager
def running(path: Path | None) -> Iterator[bool]:
    """Whether this command is the only one that computes runs of a result file."""
    if path is None:
        yield True
        return
    with (
        explain_os_error(path.parent),
        file_lock(path.with_suffix(PARTIAL) / _RUNNING, waits=False) as is_held,
    ):
        yield is_held


def _chosen(run: Run, values: Mapping[str, Any]) -> Run:
    """The run; for a tolerance the one that the search chose."""
    accuracy = run.experiment.accuracy
    for method in () if accuracy is None else accuracy.methods:
        chosen = method, int(values["n_steps"])
        if method.case == values["case"] and chosen != (run.method, run.n_steps):
            return run.experiment.chosen_run(*chosen, run.member)
    return run


def _read(
    places: Mapping[Run, Place], *, motions: bool
) -> Iterator[tuple[Run, GroupRows, int, dict[str, Any], dict[str, Any]]]:
    """Every run with its group, its row in a block, its values, and the arrays of the block."""
    wanted: dict[tuple[Source, str], list[tuple[int, Run]]] = defaultdict(list)
    for run, place in places.items():
        wanted[place.source, place.group].append((place.row, run))
    for (source, path), own in wanted.items():
        with opened(source, path) as file:
            rows = GroupRows(file[path], source)
            values, most = list(rows.values()), rows_in_block(rows, rows.shapes)
            blocks: dict[int, list[tuple[int, Run]]] = defaultdict(list)
            for row, run in own:
                blocks[row // most].append((row, run))
            for number, members in blocks.items():
                first = number * most
                last = min(first + most, rows.count)
                arrays = rows.arrays_in(file, first, last, motions=motions or not rows.keys)
                for row, run in members:
                    yield run, rows, row - first, values[row], arrays


def _indexed(path: Path) -> dict[str, Place]:
    """The runs of a result file by its index."""
    with opened(path, INDEX) as file:
        if INDEX not in file:
            return _surveyed(path)
        held = file[INDEX]
        names = [one.decode() for one in held["groups"][()].tolist()]
        columns = (held[name][()].tolist() for name in ("identity", "group", "row"))
        rows = zip(*columns, strict=True)
        return {one.decode(): Place(path, names[group], row) for one, group, row in rows}


def _surveyed(source: Source) -> dict[str, Place]:
    """The runs of a part by its groups."""
    with opened(source) as file:
        return {
            identity: Place(source, str(group.name), row)
            for group in run_groups(file)
            for row, identity in enumerate(_identities(group))
        }


def _identities(group: h5py.Group) -> list[str]:
    """The identities of a group, without its other values."""
    if "identity" in group:
        return [one.decode() for one in group["identity"][()].tolist()]
    value = group.attrs["identity"]
    return [value.decode() if isinstance(value, bytes) else str(value)]


def _digest_of(path: Path) -> str:
    """The digest of the configuration of a file."""
    if not path.exists():
        return ""
    with opened(path, CONFIGURATION) as file:
        return texts_in(file[CONFIGURATION])["digest"] if CONFIGURATION in file else ""
