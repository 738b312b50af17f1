"""The runs of a result file: looked up, kept one by one, consolidated, forgotten."""

from __future__ import annotations

import contextlib
import logging
from collections import OrderedDict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from fvi_cli.errors import StorageError
from fvi_cli.storage.atomic import told
from fvi_cli.storage.consolidation import Layout, layout_of, write_file, write_part
from fvi_cli.storage.contents import (
    CONFIGURATION,
    RESOLVED,
    Configuration,
    StoredConfiguration,
    described,
)
from fvi_cli.storage.files import (
    PARTS_SUFFIX,
    damage_told,
    part_paths,
    remove_checkpoints,
    root_attributes,
)
from fvi_cli.storage.groups import run_groups
from fvi_cli.storage.records import (
    Place,
    asked_for_tolerance,
    finished_of,
    place_of,
)
from fvi_cli.storage.snapshot import (
    BLOCK_BYTES,
    VARIANT_MARK,
    Index,
    Key,
    Location,
    NewPart,
    Snapshot,
    Source,
)
from fvi_cli.studies.experiment import FinishedRun, Run

_logger = logging.getLogger(__name__)

PARTS_KEPT = 8
"""Parts that are open at a time."""


@dataclass(kw_only=True, eq=False)
class Store:
    """A result file and the parts beside it, as one command sees them.

    Made by :func:`open_results` or :func:`read_results`; what is read is as it was when opened.
    """

    path: Path
    is_fresh: bool = False
    _main: Snapshot | None = None
    _parts: OrderedDict[Path, Snapshot] = field(default_factory=OrderedDict)
    _written: dict[Path, NewPart] = field(default_factory=dict)
    _index: Index = field(default_factory=Index)
    _asked: dict[Key, Location] = field(default_factory=dict)
    _numbers: dict[Key, int] = field(default_factory=dict)

    @property
    def parts(self) -> Path:
        """Folder of the parts."""
        return self.path.with_suffix(PARTS_SUFFIX)

    def locations(self) -> list[Location]:
        """Every complete run."""
        return list(self._index.by_key.values())

    def finished(self, run: Run) -> FinishedRun | None:
        """The run with its result, read back; None if it is not there or not complete.

        One that was predicted to blow up is given where that is allowed, its refusal elsewhere.

        Raises
        ------
        StorageError
            If what is stored is damaged.
        """
        # a second look, if its part went into the file since the first
        for _ in range(0 if self.is_fresh else 2):
            location = self._index.find(run)
            if location is None:
                return None
            found = self._read(location, "record")
            if found is not None:
                with damage_told(location.file):
                    if found.attributes["identity"] != location.identity:
                        raise ValueError(f"{location.group} holds another run than it is said to")
                    finished = finished_of(found, run)
                self._ask(run, location)
                return finished
        return None

    def chosen(self, search: Run) -> FinishedRun | None:
        """The run that a search for a tolerance came to earlier; None if none did.

        Raises
        ------
        StorageError
            If what is stored is damaged.
        """
        for location in self._index.searched(search):
            attributes = self._read(location, "attributes") or {}
            run = asked_for_tolerance(search, attributes)
            if run is not None and (found := self.finished(run)) is not None:
                return found
        return None

    def _read(self, location: Location, what: Literal["record", "attributes"]) -> Any:
        """What is asked for; None if a part has gone, and all is looked up again."""
        try:
            return getattr(self._source(location.file), what)(location)
        except StorageError:
            if location.file == self.path or location.file.exists():
                raise
        self.look()
        return None

    def _source(self, path: Path) -> Source:
        return self._written.get(path) or self._snapshot(path)

    def _snapshot(self, path: Path) -> Snapshot:
        if path == self.path:
            if self._main is None:
                self._main = Snapshot(path)
            return self._main
        if path not in self._parts:
            self._parts[path] = Snapshot(path)
        self._parts.move_to_end(path)
        while len(self._parts) > PARTS_KEPT:
            self._parts.popitem(last=False)[1].close()
        return self._parts[path]

    def look(self) -> None:
        """Look up what there is."""
        self.close()
        self._index = Index()
        # parts first: when they are consolidated meanwhile, the file is opened after that
        parts: list[Location] = []
        for path in part_paths(self.path):
            try:
                parts += self._snapshot(path).locations()
            except StorageError:
                if path.exists():
                    raise
        if self.path.exists():
            self._index.learn(self._snapshot(self.path).locations())
        self._index.learn(parts)

    def require(self) -> None:
        """Refuse a file that is not there, unless parts are.

        Raises
        ------
        StorageError
            Says so.
        """
        if self._main is None and not self._index.by_key:
            self._snapshot(self.path)

    def close(self) -> None:
        """Let go of all files, and of what is remembered."""
        self._written.clear()
        self._close_parts()
        if self._main is not None:
            self._main.close()
        self._main = None

    def places(self) -> Collection[Place]:
        """Where runs are stored that are complete."""
        return self._index.at_places().keys()

    def attributes(self, place: Place) -> Mapping[str, Any]:
        """What is said of the run in one of :meth:`places`, that of the configuration if any."""
        return self._read(self._index.at_places()[place], "attributes") or {}

    def incomplete(self) -> frozenset[str]:
        """Paths of groups of runs that are only half there."""
        if self._main is None:
            return frozenset()
        with damage_told(self.path):
            groups = [group for _, _, group in run_groups(self._main.file)]
            return frozenset(str(one.group.name) for one in groups if not one.is_complete)

    def add(self, batch: Sequence[FinishedRun]) -> None:
        """Write finished runs, which differ in their places, at once and as one part.

        Raises
        ------
        StorageError
            If it cannot be written; other runs stay as they are.
        """
        with told(self.parts):
            self.parts.mkdir(exist_ok=True)
        # some systems replace no file that is open
        self._close_parts()
        locations, new = write_part(self.parts, batch)
        remove_checkpoints(self.parts, (location.identity for location in locations))
        self._index.learn(locations)
        for finished, location in zip(batch, locations, strict=True):
            self._ask(finished.run, location)
        held = sum(part.size for part in self._written.values())
        if new is not None and held + new.size <= BLOCK_BYTES:
            self._written[locations[0].file] = new

    def _ask(self, run: Run, location: Location) -> None:
        """What is asked for belongs where the file's configuration points to."""
        key = (place_of(run), *location.key[1:])
        self._asked[key] = location
        if run.member is not None:
            self._numbers[key] = run.member.number

    def take(self, other: Store) -> None:
        """Learn the runs of another file of the configuration, for :meth:`consolidate`.

        Raises
        ------
        StorageError
            If a run of it was made by other code than one that is here, or has other numbers.
        """
        for location in other.locations():
            held = self._index.by_key.get(location.key)
            if held is not None and self._data_of(held) != self._data_of(location):
                raise StorageError(
                    f"{location.file}: {location.group} has other numbers than the same run in "
                    f"{held.file}: other code made them; compute one of them again (--fresh)"
                )
            if held is None:
                self._index.learn([location])
            if location.is_of_configuration:
                self._asked[location.key] = location

    def arrange(self, runs: Iterable[Run]) -> tuple[int, int]:
        """Put what was taken in the order of the sweep, when all was taken.

        Parameters
        ----------
        runs
            What the configuration asks for.

        Returns
        -------
        tuple of int
            Number of these runs, and how many of them are not here.
        """
        count = missing = 0
        numbers = {key[0]: -1 for key in self._index.by_key}
        for run in runs:
            count += 1
            place = place_of(run)
            if place not in numbers:
                missing += 1
            elif run.member is not None:
                numbers[place] = run.member.number
        self._asked = {k: self._asked[k] for k in sorted(self._asked, key=lambda k: numbers[k[0]])}
        return count, missing

    def _data_of(self, location: Location) -> tuple[str, str]:
        """Which run, and the checksum of its numbers."""
        attributes = self._read(location, "attributes") or {}
        return location.identity, str(attributes.get("data_sha256"))

    def consolidate(
        self, configuration: Configuration | StoredConfiguration, *, even_empty: bool = False
    ) -> Path | None:
        """Put all finished runs into one file, then remove the parts.

        Runs that were not asked for this time are kept, those of other values in groups of their
        own. What was computed again replaces the earlier run.

        Returns
        -------
        Path or None
            The file; None when there is no finished run, unless it is written `even_empty`.

        Raises
        ------
        StorageError
            If it cannot be written; then the file that was there and the parts are untouched.
        """
        if not self._index.by_key and not even_empty:
            return None
        # nothing that is asked for is finished: the file keeps the configuration that it has
        is_described = self._main is not None and not self._asked
        said = self._said() if is_described else described(configuration)
        layout = layout_of(self._index.by_key, self._asked, self._numbers)
        if not self._is_current(layout, said):
            others = sum(len(runs) for path, runs in layout.items() if VARIANT_MARK in path)
            if others:
                _logger.info(
                    "%s: holds %d runs of other values as well; `fvi show` lists them, "
                    "`fvi forget` removes them",
                    self.path,
                    others,
                )
            self._write(layout, said)
        self._remove_parts()
        return self.path

    def _said(self) -> dict[str, str]:
        """What the file says of its configuration."""
        with damage_told(self.path):
            root = root_attributes(self._snapshot(self.path).file)
            return {name: root[name] for name in CONFIGURATION}

    def forget(self, locations: Collection[Location]) -> None:
        """Remove runs from the file; what else is in it stays, parts are taken in.

        Raises
        ------
        StorageError
            If it cannot be written; then everything is as it was.
        """
        unwanted = {location.key for location in locations}
        remaining = [one for key, one in self._index.by_key.items() if key not in unwanted]
        self._asked = {one.key: one for one in remaining if one.is_of_configuration}
        self._index.by_key = {one.key: one for one in remaining}
        if remaining:
            self._write(layout_of(self._index.by_key, self._asked, self._numbers), self._said())
        elif self.path.exists():
            self.close()
            with told(self.path):
                self.path.unlink()
        self._remove_parts()

    def _is_current(self, layout: Layout, said: Mapping[str, str]) -> bool:
        """Whether the file holds just that already."""
        if self._main is None:
            return False
        held = {str(group.group.name) for _, _, group in run_groups(self._main.file)}
        root = self._main.file.attrs
        return (
            held == set(layout)
            # another comment, or the same values written in another way, change no run
            and root.get(RESOLVED) == said[RESOLVED]
            and all(
                (one.file, one.group, one.row) == (self.path, path, row) and one.place == key[0]
                for path, runs in layout.items()
                for row, (key, one) in enumerate(runs)
            )
        )

    def _write(self, layout: Layout, said: Mapping[str, str]) -> None:
        try:
            # some systems replace no file that is open
            write_file(self.path, layout, said, opened=self._source, done=self.close)
        except StorageError as error:
            kept = f"; finished runs are kept in {self.parts}" if part_paths(self.path) else ""
            raise StorageError(f"{error}{kept}") from error
        self._asked = {}
        self._index = Index()
        self._index.learn(self._snapshot(self.path).locations())

    def _close_parts(self) -> None:
        while self._parts:
            self._parts.popitem()[1].close()

    def _remove_parts(self) -> None:
        self._close_parts()
        with told(self.parts):
            if self.parts.is_dir():
                for path in part_paths(self.path):
                    path.unlink()
                remove_checkpoints(self.parts, self._index.identities())
                with contextlib.suppress(OSError):  # somebody keeps other files there
                    self.parts.rmdir()
