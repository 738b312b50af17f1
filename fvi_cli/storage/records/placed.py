"""A run in the group where it belongs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fvi_cli.storage.identity import specification_of
from fvi_cli.storage.records.fields import field_named
from fvi_cli.storage.records.record import SWEPT, Entry, Record, swept_by, variant_of
from fvi_cli.storage.records.runs import ORIGIN, finished_of, record_of, run_of
from fvi_cli.studies.experiment import Run


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A run in the group where it belongs.

    Parameters
    ----------
    entry
        Where it is read.
    run
        What it is to be described as, if it was written as another one: of another experiment or
        sweep, in another norm.
    """

    entry: Entry
    run: Run | None

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
        if self.run is not None:
            return self.record().attributes
        return self.entry.source.attributes(self.entry)

    def shapes(self) -> Sequence[tuple[str, tuple[int, ...], tuple[str, ...]]]:
        """How large its arrays are."""
        return self.entry.source.shapes(self.entry)

    def record(self) -> Record:
        """All of it, verified."""
        record = self.entry.record()
        return record if self.run is None else _described_as(record, self.run)

    @property
    def group_key(self) -> tuple[object, ...]:
        """What the members of a group have in common."""
        kind = self.entry.kind
        swept = kind.swept if self.run is None else swept_by(self.run)
        return self.variant, kind.method, kind.is_refusal, swept

    @property
    def variant(self) -> str:
        """As of the kind that it will have."""
        if self.run is None:
            return self.entry.kind.variant
        specification, _ = specification_of(self.run)
        return variant_of(specification, swept_by(self.run), self.run.experiment.norm)


def _described_as(record: Record, run: Run) -> Record:
    found = run_of(run, record.attributes)
    if found is None:
        return record
    again = record_of(finished_of(record, found)).attributes
    kept = {
        name: value
        for name, value in record.attributes.items()
        if name in ORIGIN
        # what a later version has written stays
        or (field_named(name) is None and name != SWEPT and not name.startswith("problem."))
    }
    origin: dict[str, Any] = {name: kept[name] for name in ORIGIN if name in kept}
    return replace(record, attributes={**kept, **again, **origin})
