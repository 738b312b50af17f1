"""A run in the group where it belongs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fvi_cli.storage.identity import specification_of
from fvi_cli.storage.records.fields import field_named
from fvi_cli.storage.records.record import (
    SWEPT,
    Entry,
    StoredRecord,
    same_value,
    swept_by,
    variant_of,
)
from fvi_cli.storage.records.runs import ORIGIN, record_of
from fvi_cli.studies.experiment import FinishedRun, Run


@dataclass(frozen=True, slots=True, eq=False)
class Description:
    """What is said of a run that was written in another experiment, sweep or norm."""

    run: Run  # as it is requested
    # attributes that are other ones, and names of those that it has no more
    changed: Mapping[str, Any]
    without: frozenset[str]


def description_of(record: StoredRecord, finished: FinishedRun) -> Description:
    """How the record of a run is to be changed for the run as it was read back."""
    again = record_of(finished).attributes
    own = {
        name: value
        for name, value in record.attributes.items()
        # what a later version has written stays
        if name not in ORIGIN
        and (field_named(name) is not None or name == SWEPT or name.startswith("problem."))
    }
    changed = {
        name: value
        for name, value in again.items()
        if name not in ORIGIN and (name not in own or not same_value(own[name], value))
    }
    without = frozenset(own) - frozenset(again)
    return Description(run=finished.run, changed=changed, without=without)


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A run in the group where it belongs."""

    entry: Entry  # where it is read
    # what it is to be described as, if it was written as another one
    description: Description | None = None

    @property
    def identity(self) -> str:
        """Of the run."""
        return self.entry.identity

    @property
    def request(self) -> str:
        """Of the run."""
        return self.entry.request

    def attributes(self) -> Mapping[str, Any]:
        """What is said of it."""
        return self._described(self.entry.source.attributes(self.entry))

    def shapes(self) -> Sequence[tuple[str, tuple[int, ...], tuple[str, ...]]]:
        """How large its arrays are."""
        return self.entry.source.shapes(self.entry)

    def record(self) -> StoredRecord:
        """All of it, verified."""
        record = self.entry.record()
        return replace(record, attributes=self._described(record.attributes))

    def _described(self, attributes: Mapping[str, Any]) -> Mapping[str, Any]:
        if self.description is None:
            return attributes
        kept = {k: v for k, v in attributes.items() if k not in self.description.without}
        return {**kept, **self.description.changed}

    @property
    def group_key(self) -> tuple[object, ...]:
        """What the members of a group have in common."""
        kind = self.entry.kind
        swept = kind.swept if self.description is None else swept_by(self.description.run)
        return self.variant, kind.method, kind.is_refusal, swept

    @property
    def variant(self) -> str:
        """As of the kind that it will have."""
        if self.description is None:
            return self.entry.kind.variant
        run = self.description.run
        return variant_of(specification_of(run)[0], swept_by(run), run.experiment.norm)
