"""Looking up, adding, consolidating and removing the runs of a result file."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from fvi_cli.errors import StorageError
from fvi_cli.storage.atomic import file_lock
from fvi_cli.storage.contents import (
    CONFIGURATION,
    RESOLVED,
    Configuration,
    StoredConfiguration,
    described,
)
from fvi_cli.storage.digests import (
    Inputs,
    identity_of,
    specification_of,
)
from fvi_cli.storage.files import (
    SUFFIX,
    explain_damage,
    remove_unfinished,
)
from fvi_cli.storage.journal import Journal
from fvi_cli.storage.records.layout import description_of, layout_of
from fvi_cli.storage.records.record import (
    VARIANT_MARK,
    Description,
    Entry,
    StoredRecord,
    group_path,
    swept_by,
)
from fvi_cli.storage.records.references import (
    reference_identity_of,
    reference_of_record,
    reference_record_of,
)
from fvi_cli.storage.records.runs import finished_of, run_of, stored_record
from fvi_cli.storage.result_file import ResultFile, write_file
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.reference import Reference

_logger = logging.getLogger(__name__)


@contextlib.contextmanager
def open_results(directory: Path, name: str, *, fresh: bool = False) -> Iterator[Store]:
    """Open ``<name>.h5`` in `directory` for reading and for new runs.

    A lock of the kernel holds the file until the block ends. With `fresh` stored runs are not
    found, so that each is computed again and replaced.
    """
    path = directory / f"{name}{SUFFIX}"
    with file_lock(path):
        remove_unfinished(path)
        with contextlib.closing(Store(path, writes=True, is_fresh=fresh)) as store:
            yield store


@contextlib.contextmanager
def read_results(
    path: Path, *, fresh: bool = False, may_be_missing: bool = False
) -> Iterator[Store]:
    """Open a result file and its journal to look up runs; writes no file.

    With `may_be_missing` a file that does not exist counts as one without runs.
    """
    with contextlib.closing(Store(path, is_fresh=fresh)) as store:
        if not may_be_missing and store.is_empty:
            ResultFile(path).close()
        yield store


class Store:
    """A result file and its journal, as one command sees them.

    Reads give the contents at the time of opening; a run of the journal hides the same run of the
    file. A store that `writes` accepts new runs; a fresh one does not find stored runs.
    """

    def __init__(self, path: Path, *, writes: bool = False, is_fresh: bool = False) -> None:
        self.path, self.is_fresh = path, is_fresh
        self._entries: dict[str, Entry] = {}
        self._requested: dict[str, dict[str, int]] = {}
        self._descriptions: dict[tuple[str, str], Description] = {}
        self._merged: list[Store] = []
        self._added: set[str] = set()
        self._inputs: Inputs = {}
        # the journal first: if it is consolidated meanwhile, the file is opened after that
        self._journal = Journal(path, writes=writes)
        self._file: ResultFile | None = None
        try:
            if path.exists():
                self._file = ResultFile(path)
                self._learn(self._file.entries)
            self._learn(self._journal.entries)
        except BaseException:
            self.close()
            raise

    @property
    def is_empty(self) -> bool:
        """Whether there is neither a file nor a journal with runs."""
        return self._file is None and not self._entries

    def close(self) -> None:
        """Close all files."""
        self._close_files()
        self._journal.close()

    def _close_files(self) -> None:
        for other in self._merged:
            other.close()
        if self._file is not None:
            self._file.close()

    def _learn(self, entries: Iterable[Entry]) -> None:
        for entry in entries:
            self._entries[entry.identity] = entry

    def entries(self) -> list[Entry]:
        """The entries of all runs."""
        return [one for one in self._entries.values() if not one.is_reference]

    def read(self, identity: str) -> StoredRecord | None:
        """The record of this identity, verified; None if there is none."""
        entry = self._entries.get(identity)
        return None if entry is None else entry.record()

    def finished(self, run: Run) -> FinishedRun | None:
        """The stored run, or for a search the run that it chose; None: it is not stored."""
        entry = None if self.is_fresh else self._entries.get(identity_of(run))
        if entry is None:
            return None
        record = entry.record()
        finished = self._read_back(run, record)
        if finished is not None:
            self._mark(finished.run, entry, (record, finished))
        return finished

    def _read_back(self, run: Run, record: StoredRecord) -> FinishedRun | None:
        with explain_damage(self.path):
            found = run_of(run, record.attributes)
            return None if found is None else finished_of(record, found)

    def add(self, batch: Sequence[FinishedRun]) -> None:
        """Append finished runs to the journal; a kill after this loses none of them."""
        records = [stored_record(finished) for finished in batch]
        # experiments may share a run, which is then computed twice
        new = {one.identity: one for one in records if one.identity not in self._added}
        if new:
            self._learn(self._journal.append(list(new.values())))
            self._added |= new.keys()
        for finished, record in zip(batch, records, strict=True):
            self._mark(finished.run, self._entries[record.identity])

    def has_reference(self, run: Run) -> bool:
        """Whether the reference of a run is stored."""
        return not self.is_fresh and self._reference_of(run) is not None

    def _reference_of(self, run: Run) -> Entry | None:
        return self._entries.get(reference_identity_of(run))

    def reference(self, run: Run) -> Reference | None:
        """The stored reference of a run, or None."""
        entry = self._reference_of(run)
        if entry is None:
            return None
        record = entry.record()
        with explain_damage(self.path):
            return reference_of_record(record)

    def add_references(self, found: Sequence[tuple[Run, Reference]]) -> None:
        """Append references of runs to the journal."""
        if found:
            self._learn(self._journal.append([reference_record_of(*one) for one in found]))

    def _mark(
        self, run: Run, entry: Entry, known: tuple[StoredRecord, FinishedRun] | None = None
    ) -> None:
        """Note that a stored run is requested, and the path at which it is to be written."""
        kind, name, norm = entry.kind, run.experiment.name, run.experiment.norm
        path = group_path(name, kind.case, kind.n_steps)
        own = self._requested.setdefault(path, {})
        own[entry.identity] = -1 if run.member is None else run.member.number
        if (kind.experiment, kind.norm, kind.swept) != (name, norm, swept_by(run)):
            self._inputs |= specification_of(run)[1]
            record, finished = known or (found := entry.record(), self._read_back(run, found))
            if finished is not None:
                self._descriptions[path, entry.identity] = description_of(record, finished)

    def mark_requested(self, runs: Iterable[Run]) -> tuple[int, int]:
        """Mark the stored runs that a configuration requests, in its order.

        Returns
        -------
        tuple of int
            Number of runs, and number of those that are not stored.
        """
        count = missing = 0
        for run in runs:
            count += 1
            entry = self._entries.get(identity_of(run))
            if entry is None:
                missing += 1
            else:
                self._mark(run, entry)
        return count, missing

    def merge(self, other: Store) -> None:
        """Add the runs of another file that this one lacks, for :meth:`consolidate`."""
        self._merged.append(other)
        for entry in other._entries.values():
            if entry.identity not in self._entries:
                self._learn([entry])

    def consolidate(
        self,
        configuration: Configuration | StoredConfiguration,
        *,
        even_empty: bool = False,
        prunes: bool = False,
    ) -> Path | None:
        """Write all finished runs to one file, then remove the journal; the last call on a store.

        Runs that were not requested this time are kept, in groups of their own where they have
        other values, or dropped if it `prunes`. A run that was computed again replaces the earlier
        one.

        Returns
        -------
        Path or None
            The file; None when there is no finished run, unless it is written `even_empty`.
        """
        if prunes:
            requested = {identity for own in self._requested.values() for identity in own}
            self._entries = {
                identity: one
                for identity, one in self._entries.items()
                if identity in requested or one.is_reference
            }
        if not self.entries() and not even_empty:
            return None
        # no requested run is finished: the file keeps the configuration that it has
        is_described = self._file is not None and not self._requested
        attributes = (
            self._root_attributes() if is_described else described(configuration, self._inputs)
        )
        layout = layout_of(self._entries, self._requested, self._descriptions)
        if not self._is_current(layout, attributes):
            others = sum(
                VARIANT_MARK in path and not one.is_reference
                for path, rows in layout.items()
                for one in rows
            )
            if others:
                _logger.info(
                    "%s: also holds %d runs with other settings; `fvi show` lists them, "
                    "`fvi run --prune` drops them",
                    self.path,
                    others,
                )
            self._write(layout, attributes)
        self._journal.remove()
        return self.path

    def _root_attributes(self) -> dict[str, Any]:
        """The root attributes of the configuration, as the file has them."""
        root = {} if self._file is None else self._file.root
        return {name: root[name] for name in CONFIGURATION}

    def _is_current(
        self, layout: Mapping[str, Sequence[Entry]], attributes: Mapping[str, Any]
    ) -> bool:
        """Whether the file already has this layout and configuration."""
        if self._file is None or self._file.root[RESOLVED] != attributes[RESOLVED]:
            # with an equal RESOLVED the configurations differ in comments and notation at most
            return False
        places = [(path, row, one) for path, own in layout.items() for row, one in enumerate(own)]
        # a run with a new description is another entry
        return [one for *_, one in places] == self._file.entries and all(
            (one.path, one.row) == (path, row) for path, row, one in places
        )

    def _lookup(self, digest: str) -> NDArray[Any]:
        """A long list of numbers by its digest."""
        if digest in self._inputs:
            return self._inputs[digest]
        sources = {id(one.source): one.source for one in self._entries.values()}
        # the root of the file may name lists that none of its runs names
        for source in [*sources.values(), *filter(None, [self._file])]:
            found = source.read_input(digest)
            if found is not None:
                return found
        raise StorageError(f"{self.path}: the input {digest} is missing; run the command again")

    def _write(self, layout: Mapping[str, Sequence[Entry]], attributes: Mapping[str, Any]) -> None:
        with contextlib.suppress(OSError):
            self._journal.sync()
        try:
            # some systems cannot replace an open file, so it is closed first
            write_file(self.path, layout, attributes, lookup=self._lookup, done=self._close_files)
        except StorageError as error:
            kept = self._journal.path
            held = f"; finished runs are kept in {kept}" if kept.exists() else ""
            raise StorageError(f"{error}{held}") from error
