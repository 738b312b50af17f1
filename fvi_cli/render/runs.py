"""Texts on finished runs, and on the contents of a result file."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from fvi_cli.integrator.trajectory import Assessment
from fvi_cli.reports.document import Grid
from fvi_cli.reports.kinds.designs import design_blocks, design_sheet
from fvi_cli.reports.writers import grid_as_text, to_text
from fvi_cli.runner.outcome import Outcome
from fvi_cli.storage import StoredFile
from fvi_cli.storage.fields import COUNTS, extents_in, values_of
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.members import counts_in_words
from fvi_cli.studies.peak_errors import with_peak_errors

Row = Mapping[str, object]
Subject = tuple[str, Mapping[str, Any]]
"""The experiment of a run, and the values of the run."""


def columns_of(rows: Sequence[Row], **forms: str) -> str:
    """Rows as columns under their names, formatted by `forms`; empty columns are left out."""
    names = list(rows[0]) if rows else []
    lines = [[_word(row[name], forms.get(name, "")) for name in names] for row in rows]
    kept = [k for k in range(len(names)) if any(line[k].strip("-") for line in lines)]
    grid = Grid(
        header=tuple(names[k] for k in kept),
        rows=tuple(tuple(line[k] for k in kept) for line in lines),
    )
    return grid_as_text(replace(grid, text_columns=len(kept)))


def _word(value: object, form: str) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    return format(value, form)


def runs_as_text(outcomes: Sequence[Outcome], *, every_member: bool = False) -> str:
    """One line for every finished run; for a sweep one for each method and number of steps.

    With `every_member` every member of a sweep has a line as well.
    """
    single, assured, observed, summed_up = list[Row](), list[Row](), list[Subject](), list[str]()
    for outcome in outcomes:
        experiment, members = outcome.experiment, outcome.experiment.members
        if every_member or not members or any(member.name for member in members):
            single += [_run(one) for one in outcome.finished]
        if members and not experiment.needs_search:
            summed_up.append(columns_of(_groups(outcome), median=".3e", largest=".3e"))
        judged = [(one.run, one.trajectory.assessment) for one in outcome.finished]
        found = [(run, own) for run, own in judged if own is not None]
        if found and members and not every_member:
            # the one that is nearest to its tolerance
            found = [max(found, key=lambda one: one[1].estimate / one[1].tolerance)]
        assured += [_tolerance(run, own) for run, own in found]
        if not members:
            own = with_peak_errors(outcome.finished)
            observed += [(experiment.name, values_of(one)) for one in own]
    designs = design_sheet([one for outcome in outcomes for one in outcome.finished])
    texts = [
        columns_of(single, step_size=".6g", error=".3e"),
        columns_of(assured, tolerance="g", estimate=".3e"),
        *_observed(observed),
        "" if designs is None else to_text(design_blocks(designs)),
        *summed_up,
    ]
    return "\n\n".join(filter(None, texts))


def _run(finished: FinishedRun) -> Row:
    run = finished.run
    return {
        "experiment": run.experiment.name,
        "method": run.method_label,
        "n_steps": run.n_steps,
        "step_size": run.step_size,
        "error": finished.error,
        "status": finished.status + (f" ({run.member.label})" if run.member else ""),
        "expected": "may fail" if run.experiment.expects_failure(run.method) else "",
    }


def _tolerance(run: Run, assessment: Assessment) -> Row:
    return {
        "experiment": run.experiment.name,
        "tolerance": assessment.tolerance,
        "estimate": assessment.estimate,
        "outcome": assessment.outcome,
        "member": run.member.label if run.member else "",
    }


def _groups(outcome: Outcome) -> list[Row]:
    """One row for each method and N of a sweep; with errors of members that have one."""
    groups: dict[tuple[str, int], list[FinishedRun]] = {}
    for one in outcome.finished:
        groups.setdefault((one.run.method_label, one.run.n_steps), []).append(one)
    rows = list[Row]()
    for (method, n_steps), runs in groups.items():
        known = [one for one in runs if math.isfinite(one.error)]
        worst = max(known, key=lambda one: one.error, default=None)
        rows.append({
            "experiment": outcome.experiment.name,
            "method": method,
            "n_steps": n_steps,
            "members": len(runs),
            "median": statistics.median(one.error for one in known) if known else None,
            "largest": worst.error if worst else None,
            "status": counts_in_words(one.status for one in runs),
            "at": worst.run.member.label if worst and worst.run.member else "",
        })  # fmt: skip
    return rows


def _observed(runs: Iterable[Subject]) -> list[str]:
    """A table of the quantities of runs, and one of their events."""
    extents, events = list[Row](), list[Row]()
    for experiment, values in runs:
        head = {"experiment": experiment, **{n: values[n] for n in ("method", "n_steps")}}
        for name, found in extents_in(values).items():
            extents.append({
                **head, "quantity": name, "peak": found.peak, "at t": found.peak_time,
                "error": found.error, "least": found.least, "greatest": found.greatest,
                "rms": found.rms,
            })  # fmt: skip
        for name, count in values.get(COUNTS, {}).items():
            ended = "ended by this event" if name == values.get("stopped_by") else ""
            events.append({**head, "event": name, "times": count or "never", "run": ended})
    numbers = dict.fromkeys(("peak", "at t", "least", "greatest", "rms"), ".6g")
    return [columns_of(extents, error=".1e", **numbers), columns_of(events)]


STORED = ("method", "n_steps", "step_size", "norm", "error", "status", "case")


def contents_as_text(stored: StoredFile) -> str:
    """The provenance of a result file, and one line for every run in it."""
    rows = [
        {
            "experiment": run.experiment,
            **{name: run.values.get(name) for name in STORED},
            "with": run.variant,
        }
        for run in stored.runs
    ]
    swept = dict.fromkeys(
        f"{run.experiment}: {run.members} members, {run.swept}; the largest error is shown"
        for run in stored.runs
        if run.members
    )
    texts = [
        "\n".join(f"{name}: {value}" for name, value in stored.provenance.items()),
        columns_of(rows, step_size=".6g", error=".3e"),
        *_observed((run.experiment, run.values) for run in stored.runs if not run.members),
        "\n".join(swept),
    ]
    return "\n\n".join(filter(None, texts))
