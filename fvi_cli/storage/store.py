"""A result file and its parts: finding, adding, reading and folding runs."""

from __future__ import annotations

import contextlib
import io
import json
import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Final

from fvi_cli.errors import StorageError
from fvi_cli.scenes.records.inputs import keep_numbers
from fvi_cli.storage.fields import TIME, finished_of
from fvi_cli.storage.files import UNFINISHED, file_lock, replace_file
from fvi_cli.storage.fold import KEPT, fold_files
from fvi_cli.storage.groups import Record, identities_in, read_records, run_groups
from fvi_cli.storage.hdf5 import OTHER_VERSION, Source, damage_named, opened, read_plain
from fvi_cli.storage.identity import identity_of, reference_identity_of, variant_of
from fvi_cli.storage.parts import CONFIGURATION, INPUTS, configuration_part_of
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.reference import Reference, Tabulated

_logger = logging.getLogger(__name__)

SUFFIX: Final = ".h5"
PARTIAL: Final = ".partial"
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
        self._memory: dict[str, io.BytesIO] = {}
        self._places: dict[str, Place] = {}
        self._known: dict[Source, int] = {}
        if path is not None:
            for ending in _OF_VERSION_3:
                if (other := path.with_suffix(ending)).exists():
                    raise StorageError(OTHER_VERSION.format(path=other, version="0.3"))
        self.look()

    @classmethod
    def existing(cls, path: Path) -> Store:
        """The store of a file that a command reads; its parts are folded.

        Raises
        ------
        StorageError
            If there is no configuration.
        """
        store = cls(path)
        store.configuration()
        store.fold()
        return store

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
        sources: list[Source] = [*self.sources(), *self._memory.values()]
        for source in sources:
            # another command may have folded it
            with contextlib.suppress(FileNotFoundError):
                changed = source.stat().st_mtime_ns if isinstance(source, Path) else 0
                if self._known.get(source) != changed:
                    self._places |= _surveyed(source)
                    self._known[source] = changed

    def has(self, identity: str) -> bool:
        """Whether a run or a reference is stored."""
        return identity in self._places

    def add(self, name: str, content: bytes) -> None:
        """Store a part; :meth:`look` finds its runs."""
        if not self.keeps:
            self._memory[name] = io.BytesIO(content)
            return
        replace_file(self.folder / name, content)

    def read(self, runs: Sequence[Run], *, motions: bool = True) -> dict[Run, FinishedRun]:
        """The stored ones among some runs; a search gives the run that it chose.

        Without `motions` they have no points.
        """
        names = {run: identity_of(run) for run in runs}
        found = {}
        for run, one in self._records(names, motions=motions):
            found[run] = finished_of(_chosen(run, one.values), one.values, one.arrays)
        return found

    def references(self, runs: Sequence[Run]) -> dict[Run, Reference]:
        """The stored references of some runs."""
        names = {run: reference_identity_of(run) for run in runs}
        found: dict[Run, Reference] = {}
        for run, one in self._records(names):
            table = Tabulated(time=one.arrays[TIME], position=one.arrays["position"])
            error, source = float(one.values["reference_error"]), one.values["reference"]
            found[run] = Reference(values=table, error=error, source=source)
        return found

    def _records(
        self, names: Mapping[Run, str], *, motions: bool = True
    ) -> Iterator[tuple[Run, Record]]:
        """The stored runs or references with some identities."""
        places: dict[Source, dict[str, dict[int, list[Run]]]] = {}
        for run, name in names.items():
            if place := self._places.get(name):
                groups = places.setdefault(place.source, {})
                groups.setdefault(place.group, {}).setdefault(place.row, []).append(run)
        for source, groups in places.items():
            with opened(source) as file:
                for path, rows in groups.items():
                    with damage_named(source, path):
                        blocks = read_records(file[path], sorted(rows), motions=motions)
                        records = list(chain.from_iterable(blocks))
                    for row, one in zip(sorted(rows), records, strict=True):
                        yield from ((run, one) for run in rows[row])

    def describe(self, text: str, resolved: Mapping[str, Any], overrides: Sequence[str]) -> None:
        """Store the configuration of a command, unless the file has it already."""
        texts = {
            "text": text, "resolved": json.dumps(resolved), "overrides": json.dumps(overrides)
        }  # fmt: skip
        if self.path is None or not self.keeps:
            return
        if self.path.exists():
            with opened(self.path) as file:
                if read_plain(file, CONFIGURATION).get(CONFIGURATION) == texts:
                    return
        # parts are folded in the order of their names, the latest last
        name = f"configuration-{time.time_ns()}{SUFFIX}"
        self.add(name, configuration_part_of(resolved, texts))

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
            with opened(source) as file:
                if texts := read_plain(file, CONFIGURATION).get(CONFIGURATION):
                    for inputs in read_plain(file, INPUTS).values():
                        keep_numbers(inputs["numbers"])
                    return StoredConfiguration(
                        text=texts["text"],
                        overrides=tuple(json.loads(texts["overrides"])),
                        resolved=json.loads(texts["resolved"]),
                    )
        raise StorageError(f"{self.path}: holds no configuration")

    def fold(self, requested: Sequence[Run] = (), *, prunes: bool = False) -> None:
        """Append the parts to the file, and remove them.

        Experiments with other settings than those of the `requested` runs move to ``/@kept/``; if
        it `prunes`, runs that are not requested are dropped. One command folds at a time; a part
        that appears meanwhile waits for the next.
        """
        if (
            self.path is None
            or not self.keeps
            or not (self.parts() or (prunes and self.path.exists()))
        ):
            return
        with file_lock(self.path.with_name(f".{self.path.name}.lock")):
            # of a fold that was killed
            for one in self.path.parent.glob(f".{self.path.name}.*{UNFINISHED}"):
                one.unlink(missing_ok=True)
            self.look()
            parts = self.parts()
            keys = (identity_of, reference_identity_of) if prunes else ()
            needed = {key_of(run) for run in requested for key_of in keys}

            def is_kept(identity: str, source: Path) -> bool:
                place = self._places.get(identity)
                is_latest = place is not None and place.source == source
                return is_latest and (not prunes or identity in needed)

            first = {run.experiment: run for run in requested}
            variants = {one.name: variant_of(run)[0] for one, run in first.items()}
            fold_files(self.path, parts, is_kept, variants, prunes=prunes)
            for one in parts:
                one.unlink(missing_ok=True)
            # another command may have written a part meanwhile
            if not self.parts():
                with contextlib.suppress(OSError):
                    for one in self.folder.glob(f".*{UNFINISHED}"):
                        one.unlink(missing_ok=True)
                    self.folder.rmdir()
        self._places.clear()
        self._known.clear()
        self.look()
        if kept := sum(one.group.startswith(f"/{KEPT}/") for one in self._places.values()):
            _logger.info(
                "%s: also holds %d runs with other settings; `fvi show` lists them, "
                "`fvi run --prune` drops them", self.path, kept,
            )  # fmt: skip


def _chosen(run: Run, values: Mapping[str, Any]) -> Run:
    """The run; for a tolerance the one that the search chose."""
    accuracy = run.experiment.accuracy
    for method in () if accuracy is None else accuracy.methods:
        chosen = method, int(values["n_steps"])
        if method.case == values["case"] and chosen != (run.method, run.n_steps):
            return run.experiment.chosen_run(*chosen, run.member)
    return run


def _surveyed(source: Source) -> dict[str, Place]:
    """The runs and references of a file."""
    with opened(source) as file:
        return {
            identity: Place(source, str(group.name), row)
            for group in run_groups(file)
            for row, identity in enumerate(identities_in(group))
        }
