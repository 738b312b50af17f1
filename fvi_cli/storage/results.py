"""Runs that are finished: look them up, keep them one by one, consolidate them into one file."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fvi_cli.errors import StorageError
from fvi_cli.storage.assurance_records import asked_for_tolerance
from fvi_cli.storage.atomic import UNFINISHED, told
from fvi_cli.storage.batch_reading import MemberReader
from fvi_cli.storage.batch_records import (
    block_of,
    columns_of,
    member_record,
    write_batch,
)
from fvi_cli.storage.consolidation import Configuration, described, write_root, write_runs
from fvi_cli.storage.files import damage_told, reading, replacing
from fvi_cli.storage.locations import Location, index, located
from fvi_cli.storage.locking import file_lock
from fvi_cli.storage.provenance import (
    identity,
    identity_otherwise_allowed,
    sha256,
)
from fvi_cli.storage.records import (
    Form,
    Place,
    basis_in,
    basis_of,
    finished_of,
    form_of,
    group_path,
    place_of,
    record_of,
    write_record,
)
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run

_logger = logging.getLogger(__name__)

SUFFIX = ".h5"
PARTS_SUFFIX = ".parts"


@dataclass(kw_only=True, eq=False)
class StoredRuns:
    """The complete runs of a result file and of the parts beside it, by identity."""

    path: Path
    _by_identity: dict[tuple[str, Form], Location] = field(default_factory=dict)
    _by_place: dict[Place, Location] = field(default_factory=dict)
    _reader: MemberReader = field(default_factory=MemberReader)

    def finished(self, run: Run) -> FinishedRun | None:
        """The run with its result, read back; None if it is not there or not complete.

        Raises
        ------
        StorageError
            If what is stored is damaged.
        """
        location = self._location(run)
        if location is None:
            return None
        record = location.read(self._reader)
        with damage_told(location.file):
            return finished_of(record, run)

    def chosen(self, experiment: Experiment) -> FinishedRun | None:
        """The run that was chosen for the tolerance of an open experiment; None if none was.

        Raises
        ------
        StorageError
            If what is stored is damaged.
        """
        for place in [place for place in self.places() if place[0] == experiment.name]:
            run = asked_for_tolerance(experiment, self.attributes(place))
            found = None if run is None else self.finished(run)
            if found is not None:
                return found
        return None

    def _location(self, run: Run) -> Location | None:
        """Where the run is, also under the other answer to a question that it does not raise."""
        # the same numbers may be there as a member of another sweep, in a group of another form
        form = form_of(place_of(run))
        location = self._by_identity.get((identity(run), form))
        if location is None:
            other = self._by_identity.get((identity_otherwise_allowed(run), form))
            if other is not None and other.predicted != "unstable":
                return other
        return location

    def places(self) -> Collection[Place]:
        """Where runs are stored that are complete."""
        return self._by_place.keys()

    def attributes(self, place: Place) -> Mapping[str, Any]:
        """What is said of the run in one of :meth:`places`."""
        location = self._by_place[place]
        if location.row is not None:
            return self._reader.attributes(location.member_row)
        with reading(location.file) as file:
            return dict(file[group_path(location.place)].attrs)

    def of_another_problem(self, runs: Iterable[Run]) -> int:
        """Number of stored runs whose experiment has become another one by the time of `runs`.

        Keeping `runs` replaces them.
        """
        bases = {run.experiment.name: basis_of(run) for run in runs}
        return sum(
            location.basis != bases.get(place[0], location.basis)
            for place, location in self._by_place.items()
        )

    def _learn(self, locations: Iterable[Location]) -> None:
        for location in locations:
            self._by_identity[location.identity, form_of(location.place)] = location
            self._by_place[location.place] = location


@dataclass(kw_only=True, eq=False)
class Results(StoredRuns):
    """A result file that is open for new runs; made by :func:`open_results`."""

    parts: Path
    is_fresh: bool = False
    _asked: dict[Place, str] = field(default_factory=dict)
    _numbers: dict[Place, int] = field(default_factory=dict)

    def finished(self, run: Run) -> FinishedRun | None:
        """As :meth:`StoredRuns.finished`; what is found belongs to the consolidated file."""
        if self.is_fresh:
            return None
        found, location = super().finished(run), self._location(run)
        if location is not None:
            self._ask(run, location.identity)
        return found

    def _ask(self, run: Run, own_identity: str) -> None:
        place = place_of(run)
        self._asked[place] = own_identity
        if run.member is not None:
            self._numbers[place] = run.member.number

    def add(self, finished: FinishedRun) -> None:
        """Write a finished run at once, as a part of its own.

        Raises
        ------
        StorageError
            If it cannot be written; other runs stay as they are.
        """
        self.add_batch([finished])

    def add_batch(self, batch: Sequence[FinishedRun]) -> None:
        """Write the finished runs of a batch at once, as one part.

        Raises
        ------
        StorageError
            As :meth:`add`.
        """
        with told(self.parts):
            self.parts.mkdir(exist_ok=True)
        if batch[0].run.member is None:
            for finished in batch:
                record = record_of(finished)
                path = self.parts / f"{record.attributes['identity']}{SUFFIX}"
                with replacing(path) as new:
                    write_record(new.file, record)
                self._learn([located(path, record.attributes)])
                self._ask(finished.run, str(record.attributes["identity"]))
            return
        records = [member_record(finished) for finished in batch]
        columns = columns_of(records)
        path = self.parts / f"{sha256(';'.join(columns['identity']))}{SUFFIX}"
        with replacing(path) as new:
            write_batch(new.file, columns, [block_of(records)])
        own_basis = basis_in(records[0].attributes)
        for row, (finished, record) in enumerate(zip(batch, records, strict=True)):
            own_identity = str(record.attributes["identity"])
            location = Location(
                file=path,
                place=place_of(finished.run),
                identity=own_identity,
                basis=own_basis,
                predicted=finished.predicted,
                row=row,
            )
            self._learn([location])
            self._ask(finished.run, own_identity)

    def consolidate(self, configuration: Configuration) -> Path | None:
        """Put all finished runs into one file, then remove the parts.

        Runs that were not asked for this time are kept, unless their experiment has become
        another one, or everything was to be computed anew.

        Returns
        -------
        Path or None
            The file; None when there is no finished run.

        Raises
        ------
        StorageError
            If it cannot be written; then the file that was there and the parts are untouched.
        """
        chosen = self._chosen()
        if not chosen:
            return None
        if not self._is_current(chosen, configuration):
            try:
                with replacing(self.path) as new:
                    write_root(new.file, configuration)
                    write_runs(new, chosen, self._reader)
            except StorageError as error:
                raise StorageError(f"{error}; finished runs are kept in {self.parts}") from error
        self._remove_parts()
        self._by_identity.clear()
        self._by_place.clear()
        self._reader.forget()
        self._learn(index(self.path))
        return self.path

    def _chosen(self) -> dict[Place, Location]:
        """What the file is to hold, in the order of asking, what was not asked for behind."""
        # members in the order of the sweep, whenever they were computed
        in_order = sorted(self._asked, key=lambda place: self._numbers.get(place, -1))
        chosen = {
            place: self._by_identity[self._asked[place], form_of(place)] for place in in_order
        }
        bases = {place[0]: location.basis for place, location in chosen.items()}
        forgets_others = self.is_fresh and bool(chosen)
        superseded = 0
        for place, location in self._by_place.items():
            if place in chosen:
                superseded += location.identity != chosen[place].identity
            elif location.basis != bases.get(place[0], location.basis):
                superseded += 1
            elif not forgets_others:
                chosen[place] = location
        if superseded:
            _logger.info("%s: %d runs of an earlier problem are replaced", self.path, superseded)
        return chosen

    def _is_current(self, chosen: Mapping[Place, Location], configuration: Configuration) -> bool:
        """Whether the file holds just that already."""
        if not self.path.is_file() or any(
            location.file != self.path or location.place != place
            for place, location in chosen.items()
        ):
            return False
        wanted = described(configuration)
        with reading(self.path) as file:
            return all(file.attrs.get(name) == value for name, value in wanted.items())

    def _remove_parts(self) -> None:
        with told(self.parts):
            if self.parts.is_dir():
                for path in _part_paths(self.parts):
                    path.unlink()
                with contextlib.suppress(OSError):  # somebody keeps other files there
                    self.parts.rmdir()


@contextlib.contextmanager
def open_results(directory: Path, name: str, *, fresh: bool = False) -> Iterator[Results]:
    """Open ``<name>.h5`` in `directory` for reading and for new runs.

    The file is held by a lock of the kernel until the block ends.

    Parameters
    ----------
    directory
        Folder of results; it is made when it is missing.
    name
        Of the configuration.
    fresh
        Forget what is stored as soon as a new run is added.

    Raises
    ------
    StorageError
        If another process writes it, the folder cannot be used, or a file of that name cannot
        be read or is not ours.
    """
    path = directory / f"{name}{SUFFIX}"
    parts = directory / f"{name}{PARTS_SUFFIX}"
    with file_lock(path):
        _sweep(path, parts)
        results = Results(path=path, parts=parts, is_fresh=fresh)
        results._learn(_all_locations(path, parts))
        yield results


@contextlib.contextmanager
def read_results(path: Path) -> Iterator[StoredRuns]:
    """Look up runs of a result file, and of parts that wait beside it; nothing is written.

    Raises
    ------
    StorageError
        If neither is there, or one cannot be read.
    """
    stored = StoredRuns(path=path)
    # parts first: when they are consolidated meanwhile, the file is read after that
    locations = _part_locations(path.with_suffix(PARTS_SUFFIX))
    if path.exists() or not locations:
        stored._learn(index(path))
    stored._learn(locations)
    yield stored


def holds_runs(path: Path) -> bool:
    """Whether there is something to read for :func:`read_results`: the file, or parts.

    A folder of parts without any is what is left of a command that could write none.
    """
    return path.exists() or bool(_part_paths(path.with_suffix(PARTS_SUFFIX)))


def _all_locations(path: Path, parts: Path) -> list[Location]:
    stored = index(path) if path.exists() else []
    return stored + _part_locations(parts)


def _part_locations(parts: Path) -> list[Location]:
    found = []
    for path in _part_paths(parts):
        # another process may just have consolidated it
        if path.exists():
            found += index(path)
    return found


def _part_paths(parts: Path) -> Sequence[Path]:
    return sorted(parts.glob(f"[!.]*{SUFFIX}"))


def _sweep(path: Path, parts: Path) -> None:
    """Remove what a crash has left half written; the lock says that nobody is writing it."""
    unfinished = [
        *path.parent.glob(f".{path.name}.*{UNFINISHED}"),
        *parts.glob(f".*{SUFFIX}.*{UNFINISHED}"),
    ]
    for leftover in unfinished:
        with told(leftover):
            leftover.unlink(missing_ok=True)
