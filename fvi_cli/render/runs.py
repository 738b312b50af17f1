"""Texts on finished runs, and on the contents of a result file."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from operator import itemgetter
from typing import Any

from fvi_cli.reports import Column, grid_of, to_text
from fvi_cli.reports.columns import GOOD, Item, member_title
from fvi_cli.reports.kinds.quantities import quantity_blocks, quantity_sheets
from fvi_cli.reports.table import Block
from fvi_cli.runner.outcome import Outcome
from fvi_cli.storage import StoredFile
from fvi_cli.storage.fields import extents_in
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.members import counts_in_words, label_of
from fvi_cli.studies.study import with_peak_errors


def _assessed(name: str) -> Any:
    """A getter for a number of the assessment of a run to a tolerance; None without one."""
    return lambda one: getattr(one.trajectory.assessment, name, None)


def _stored(name: str) -> Any:
    """A getter for a value of a stored run; None where it has none."""
    return lambda one: one.values.get(name)


def _expected(one: FinishedRun) -> str:
    return "may fail" if one.run.experiment.expects_failure(one.run.method) else ""


STEP = Column("step_size", "h", ".6g", get="run.step_size")
RUNS = (
    Column("experiment", "experiment", get="run.experiment.name"),
    member_title("run.member"),
    Column("method", "method", get="run.method_label"),
    Column("n_steps", "N", get="run.n_steps"),
    STEP,
    Column("error", "error", ".3e"),
    Column("tolerance", "tolerance", "g", get=_assessed("tolerance")),
    Column("estimate", "estimate", ".3e", get=_assessed("estimate")),
    Column("status", "status"),
    Column("expected", "expected", get=_expected),
)
MEMBERS = (
    Column("experiment", "experiment", get="first.run.experiment.name"),
    Column("method", "method", get="first.run.method_label"),
    Column("n_steps", "N", get=lambda of: _steps_in_words(of)),
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


def runs_as_text(outcomes: Sequence[Outcome], *, verbose: bool = False) -> str:
    """A line for every method and design with its finest run; and quantities of these runs.

    Of a sweep the line sums up the members. Runs that failed have lines of their own. With
    `verbose` every run and member has one, and every number of steps of a sweep.
    """
    single = list[FinishedRun]()
    summed_up = list[Item]()
    observed = list[FinishedRun]()
    counts = dict[FinishedRun, int]()
    for outcome in outcomes:
        members = outcome.experiment.members
        is_summed_up = bool(members) and not any(member.name for member in members)
        if is_summed_up:
            summed_up += _by_method(outcome.finished, every_n=verbose)
        if verbose:
            single += outcome.finished
        elif not is_summed_up:
            ladders = _ladders(outcome.finished)
            last = {one[-1] for one in ladders}
            counts |= {one[-1]: len(one) for one in ladders if len(one) > 1}
            single += [o for o in outcome.finished if o in last or o.status not in GOOD]
        with_errors = with_peak_errors(outcome.finished)
        observed += with_errors if verbose else [one[-1] for one in _ladders(with_errors)]
    # a single experiment needs no column with its name
    first = int(len(outcomes) == 1)
    number = Column("runs", "runs", get=counts.get)
    columns = RUNS if verbose else (*RUNS[:3], number, *(c for c in RUNS[3:] if c is not STEP))
    tables = ((columns, single), (MEMBERS, summed_up))
    blocks: list[Block] = [grid_of(columns[first:], rows) for columns, rows in tables if rows]
    sheets, summaries = quantity_sheets(observed)
    return to_text([*blocks, *quantity_blocks(summaries or sheets)])


def _ladders(finished: Iterable[FinishedRun]) -> list[list[FinishedRun]]:
    """The runs of every method and member, with N increasing."""
    found: dict[tuple[object, ...], list[FinishedRun]] = {}
    for one in sorted(finished, key=lambda one: one.run.n_steps):
        found.setdefault((one.run.member, one.run.method), []).append(one)
    return list(found.values())


def _by_method(finished: Iterable[FinishedRun], *, every_n: bool) -> list[Item]:
    """One item for each method of a sweep and its finest N, and for N with runs that failed.

    Errors are those of members that have one; a tolerance chooses N for every member.
    """
    groups: dict[tuple[str, int], list[FinishedRun]] = {}
    for one in finished:
        n_steps = 0 if one.run.is_search else one.run.n_steps
        groups.setdefault((one.run.method_label, n_steps), []).append(one)
    finest = {label: max(n for own, n in groups if own == label) for label, _ in groups}
    items = []
    for (label, n_steps), runs in groups.items():
        if not every_n and n_steps < finest[label] and all(one.status in GOOD for one in runs):
            continue
        known = [one for one in runs if math.isfinite(one.error)] or runs[:1]
        worst = max(known, key=lambda one: one.error)
        at = "" if math.isnan(worst.error) else label_of(worst.run.member)
        errors = [one.error for one in known]
        items.append(Item(first=runs[0], runs=runs, errors=errors, worst=worst, at=at))
    return items


def _steps_in_words(of: Item) -> str:
    """The number of steps, or the least and the largest of those that a tolerance chose."""
    numbers = {one.run.n_steps for one in of.runs}
    return "-".join(map(str, sorted({min(numbers), max(numbers)})))


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
