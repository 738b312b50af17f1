"""Texts on finished runs, and on the contents of a result file."""

from __future__ import annotations

import math
import shutil
import statistics
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from fvi_cli.reports.document import Grid
from fvi_cli.reports.kinds.designs import design_blocks, design_sheet
from fvi_cli.reports.kinds.quantities import (
    EXTENT_COLUMNS,
    shown_errors,
)
from fvi_cli.reports.table import About, Column, grid_of
from fvi_cli.reports.writers import grid_as_text, to_text
from fvi_cli.runner.outcome import Outcome
from fvi_cli.storage import StoredFile
from fvi_cli.storage.fields import counts_in, extents_in, values_of
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.members import counts_in_words
from fvi_cli.studies.peak_errors import with_peak_errors


def columns_of_words(rows: Sequence[Sequence[str]]) -> str:
    """Rows of words as columns, the first row as heading; empty columns are left out."""
    head, *body = map(tuple, rows)
    kept = [k for k in range(len(head)) if not body or any(row[k].strip("-") for row in body)]
    lines = [tuple(row[k] for k in kept) for row in (head, *body)]
    return _as_text(Grid(header=lines[0], rows=tuple(lines[1:])))


def _filled(columns: Sequence[Column], items: Sequence[object]) -> list[Column]:
    """The columns that are not empty."""
    return [c for c in columns if any(c.show(c.of(one)).strip("-") for one in items)]


def _as_text(grid: Grid) -> str:
    return grid_as_text(replace(grid, text_columns=len(grid.header)))


def runs_as_text(outcomes: Sequence[Outcome], *, every_member: bool = False) -> str:
    """One line for every finished run; for a sweep one for each method and number of steps.

    With `every_member` every member of a sweep has a line as well.
    """
    rows = [("experiment", "method", "n_steps", "step_size", "error", "status", "expected")]
    summed_up = []
    for outcome in outcomes:
        if outcome.experiment.members and not outcome.experiment.needs_search:
            summed_up.append(_members_as_text(outcome))
        is_named = any(member.name for member in outcome.experiment.members)
        if outcome.experiment.members and not every_member and not is_named:
            continue
        for finished in outcome.finished:
            run = finished.run
            member = "" if run.member is None else f" ({run.member.label})"
            rows.append(
                (
                    run.experiment.name,
                    run.method_label,
                    str(run.n_steps),
                    f"{run.step_size:.6g}",
                    f"{finished.error:.3e}" if math.isfinite(finished.error) else "-",
                    f"{finished.status}{member}",
                    "may fail" if run.experiment.expects_failure(run.method) else "",
                )
            )
    is_swept = any(outcome.experiment.members for outcome in outcomes)
    texts = [columns_of_words(rows)] if len(rows) > 1 or not is_swept else []
    texts += _tolerances_as_text(outcomes, every_member=every_member)
    texts += _observed_as_text(outcomes)
    designs = design_sheet([one for outcome in outcomes for one in outcome.finished])
    texts += [] if designs is None else [to_text(design_blocks(designs))]
    return "\n\n".join([*texts, *summed_up])


def _tolerances_as_text(outcomes: Sequence[Outcome], *, every_member: bool) -> list[str]:
    """Tolerance and estimate of runs for a tolerance; of sweeps those nearest to theirs."""
    rows = [("experiment", "tolerance", "estimate", "outcome", "member")]
    for outcome in outcomes:
        judged = [(one.run, one.trajectory.assessment) for one in outcome.finished]
        found = [(run, own) for run, own in judged if own is not None]
        if found and outcome.experiment.members and not every_member:
            found = [max(found, key=lambda one: one[1].estimate / one[1].tolerance)]
        rows += [
            (
                outcome.experiment.name,
                f"{own.tolerance:g}",
                f"{own.estimate:.3e}",
                own.outcome,
                run.member.label if run.member else "",
            )
            for run, own in found
        ]
    return [columns_of_words(rows)] if len(rows) > 1 else []


def _observed_as_text(outcomes: Sequence[Outcome]) -> list[str]:
    """Quantities and events of every run that is not a member of a sweep."""
    return _quantities_as_text(
        About(
            experiment=outcome.experiment.name,
            method=one.run.method_label,
            n_steps=one.run.n_steps,
            error=one.error,
            values=values_of(one),
        )
        for outcome in outcomes
        for one in with_peak_errors(outcome.finished)
        if one.run.member is None
    )


_EVENT_COLUMNS = (
    Column("name", title="event"),
    Column("found", title="times", form=lambda count: str(count) if count else "never"),
    Column(
        "run",
        title="run",
        get=lambda one: "ended by this event" if one.name == one.values["stopped_by"] else "",
    ),
)


def _quantities_as_text(runs: Iterable[About]) -> list[str]:
    """A table of the quantities of runs, and one of their events."""
    found = list(runs)
    named = [Column(name, title=name) for name in ("experiment", "method", "n_steps")]
    texts = []
    for read, columns in ((extents_in, EXTENT_COLUMNS), (counts_in, _EVENT_COLUMNS)):
        items = [
            About(**vars(run), name=name, found=seen)
            for run in found
            for name, seen in read(run.values).items()
        ]
        extents = [one.found for one in items if read is extents_in]
        is_own, is_of_position = shown_errors(extents, [one.error for one in items])
        left_out = ("peak_error",) * (not is_own) + ("error",) * (not is_of_position)
        shown = [one for one in columns if one.name not in left_out]
        if items:
            texts.append(_as_text(grid_of(_filled([*named, *shown], items), items)))
    return texts


def _members_as_text(outcome: Outcome) -> str:
    """One line for each method and N of a sweep; with errors of members that have one."""
    groups: dict[tuple[str, int], list[FinishedRun]] = {}
    for one in outcome.finished:
        groups.setdefault((one.run.method_label, one.run.n_steps), []).append(one)
    rows = [("experiment", "method", "n_steps", "members", "median", "largest", "status", "at")]
    for (method, n_steps), runs in groups.items():
        errors = {one.run.member: one.error for one in runs if math.isfinite(one.error)}
        worst = max(errors, key=errors.__getitem__, default=None)
        rows.append(
            (
                outcome.experiment.name,
                method,
                str(n_steps),
                str(len(runs)),
                f"{statistics.median(errors.values()):.3e}" if errors else "-",
                f"{errors[worst]:.3e}" if errors else "-",
                counts_in_words(one.status for one in runs),
                "" if worst is None else worst.label,
            )
        )
    return columns_of_words(rows)


def _stored(name: str, form: str = "") -> Column:
    """The column of a value of stored runs."""
    return Column(name, title=name, get=lambda run: run.values.get(name), form=form)


_STORED_COLUMNS = (
    Column("experiment", title="experiment"),
    *map(_stored, ("method", "n_steps")),
    _stored("step_size", ".6g"),
    _stored("norm"),
    _stored("error", ".3e"),
    *map(_stored, ("status", "case")),
    Column("variant", title="with"),
)


def contents_as_text(stored: StoredFile) -> str:
    """The provenance of a result file, and one line for every run in it."""
    lines = [f"{name}: {value}" for name, value in stored.provenance.items()]
    grid = grid_of(_filled(_STORED_COLUMNS, stored.runs), stored.runs)
    tables = _quantities_as_text(
        About(
            experiment=run.experiment,
            method=run.values["method"],
            n_steps=run.values["n_steps"],
            error=run.values["error"],
            values=run.values,
        )
        for run in stored.runs
        if not run.members
    )
    swept = dict.fromkeys(
        f"{run.experiment}: {run.members} members, {run.swept}; the largest error is shown"
        for run in stored.runs
        if run.members
    )
    return "\n\n".join(filter(None, ("\n".join(lines), _as_text(grid), *tables, "\n".join(swept))))


def titles_as_text(titles: Mapping[str, str]) -> str:
    """Names and titles in two columns, wrapped where there is a terminal."""
    width = max(map(len, titles)) + 2
    room = shutil.get_terminal_size().columns if sys.stdout.isatty() else 10_000
    return "\n".join(
        textwrap.fill(
            title,
            width=max(room, 2 * width),
            initial_indent=name.ljust(width),
            subsequent_indent=" " * width,
        )
        for name, title in titles.items()
    )
