"""Texts on finished runs, and on the contents of a result file."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from typing import Any

from fvi_cli.reports import Column, grid_of, to_text
from fvi_cli.reports.columns import Item, member_title
from fvi_cli.reports.kinds.quantities import quantity_blocks, quantity_sheets
from fvi_cli.reports.table import Block
from fvi_cli.runner.outcome import Outcome
from fvi_cli.storage import StoredFile
from fvi_cli.storage.fields import extents_in
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.members import counts_in_words, label_of


def _assessed(name: str) -> Any:
    """A getter for a number of the assessment of a run to a tolerance; None without one."""
    return lambda one: getattr(one.trajectory.assessment, name, None)


def _stored(name: str) -> Any:
    """A getter for a value of a stored run; None where it has none."""
    return lambda one: one.values.get(name)


def _expected(one: FinishedRun) -> str:
    return "may fail" if one.run.experiment.expects_failure(one.run.method) else ""


RUNS = (
    Column("experiment", "experiment", get="run.experiment.name"),
    member_title("run.member"),
    Column("method", "method", get="run.method_label"),
    Column("n_steps", "N", get="run.n_steps"),
    Column("step_size", "h", ".6g", get="run.step_size"),
    Column("error", "error", ".3e"),
    Column("tolerance", "tolerance", "g", get=_assessed("tolerance")),
    Column("estimate", "estimate", ".3e", get=_assessed("estimate")),
    Column("outcome", "tolerance is", get=_assessed("outcome")),
    Column("status", "status"),
    Column("expected", "expected", get=_expected),
)
MEMBERS = (
    Column("experiment", "experiment", get="first.run.experiment.name"),
    Column("method", "method", get="first.run.method_label"),
    Column("n_steps", "N", get="first.run.n_steps"),
    Column("members", "members", get=lambda of: len(of.runs)),
    Column("median", "median error", ".3e", get=lambda of: statistics.median(of.errors)),
    Column("largest", "largest", ".3e", get="worst.error"),
    Column("at", "at", get="at"),
    Column("status", "status", get=lambda of: counts_in_words(one.status for one in of.runs)),
)
STORED = (
    Column("experiment", "experiment"),
    Column("method", "method", get=_stored("method")),
    Column("n_steps", "N", get=_stored("n_steps")),
    Column("step_size", "h", ".6g", get=_stored("step_size")),
    Column("norm", "norm", get=_stored("norm")),
    Column("error", "error", ".3e", get=_stored("error")),
    Column("status", "status", get=_stored("status")),
    Column("quantities", "quantities", get=lambda one: ", ".join(extents_in(one.values))),
    Column("variant", "with"),
)


def columns_of(rows: Sequence[Mapping[str, object]], **forms: str) -> str:
    """Rows as columns under their names, formatted by `forms`; empty columns are left out."""
    names = list(rows[0]) if rows else []
    columns = [Column(name, name, forms.get(name, ""), get=itemgetter(name)) for name in names]
    return to_text([grid_of(columns, rows)]) if rows else ""


def runs_as_text(outcomes: Sequence[Outcome], *, every_member: bool = False) -> str:
    """A line for every run, of a sweep for each method and number of steps; and the quantities.

    With `every_member` every member of a sweep has a line as well.
    """
    single = list[FinishedRun]()
    summed_up = list[Item]()
    for outcome in outcomes:
        members = outcome.experiment.members
        if every_member or not members or any(member.name for member in members):
            single += outcome.finished
        if members and not any(member.name for member in members):
            summed_up += _by_method(outcome.finished)
    # a single experiment needs no column with its name
    first = int(len(outcomes) == 1)
    tables = ((RUNS, single), (MEMBERS, summed_up))
    blocks: list[Block] = [grid_of(columns[first:], rows) for columns, rows in tables if rows]
    sheets, summaries = quantity_sheets([one for own in outcomes for one in own.finished])
    return to_text([*blocks, *quantity_blocks(summaries or sheets)])


def _by_method(finished: Iterable[FinishedRun]) -> list[Item]:
    """One item for each method and N of a sweep, with errors of members that have one."""
    groups: dict[tuple[str, int], list[FinishedRun]] = {}
    for one in finished:
        groups.setdefault((one.run.method_label, one.run.n_steps), []).append(one)
    items = []
    for runs in groups.values():
        known = [one for one in runs if math.isfinite(one.error)] or runs[:1]
        worst = max(known, key=lambda one: one.error)
        at = "" if math.isnan(worst.error) else label_of(worst.run.member)
        errors = [one.error for one in known]
        items.append(Item(first=runs[0], runs=runs, errors=errors, worst=worst, at=at))
    return items


def contents_as_text(stored: StoredFile) -> str:
    """The provenance of a result file, and one line for every run in it."""
    swept = dict.fromkeys(
        f"{run.experiment}: {run.members} members, {run.swept}; the largest error is shown"
        for run in stored.runs
        if run.members
    )
    provenance = [f"{name}: {value}" for name, value in stored.provenance.items()]
    return "\n\n".join(
        filter(None, ("\n".join(provenance), to_text([grid_of(STORED, stored.runs)]), *swept))
    )
