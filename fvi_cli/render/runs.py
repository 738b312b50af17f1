"""What is printed of runs that are finished, and of what a result file holds."""

from __future__ import annotations

import math
import shutil
import statistics
import sys
import textwrap
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from fvi_cli.reports.document import Grid
from fvi_cli.reports.kinds.designs import design_blocks, design_sheet
from fvi_cli.reports.kinds.quantities import ERROR_TITLE
from fvi_cli.reports.naming import method_names
from fvi_cli.reports.writers.text import aligned as grid_as_text
from fvi_cli.reports.writers.text import to_text
from fvi_cli.runner.outcome import Outcome
from fvi_cli.storage import Entry, StoredFile
from fvi_cli.storage.records.observed import ObservedSummary, summary_of
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.members import counts_in_words


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Rows of words as columns, the first row as heading."""
    lines = [tuple(row) for row in rows]
    return grid_as_text(Grid(header=lines[0], rows=tuple(lines[1:]), text_columns=len(lines[0])))


def runs_as_text(outcomes: Sequence[Outcome], *, every_member: bool = False) -> str:
    """One line for every finished run; of a sweep one for each method and number of steps.

    Parameters
    ----------
    outcomes
        What became of the experiments.
    every_member
        Give every member of a sweep a line as well.
    """
    rows = [("experiment", "method", "n_steps", "step_size", "error", "status", "expected")]
    summed_up = []
    for outcome in outcomes:
        if outcome.experiment.members and not outcome.experiment.needs_search:
            summed_up.append(_members_as_text(outcome))
        is_named = any(member.name for member in outcome.experiment.members)
        if outcome.experiment.members and not every_member and not is_named:
            continue
        names = method_names([one.run.method for one in outcome.finished])
        for finished in outcome.finished:
            run = finished.run
            member = "" if run.member is None else f" ({run.member.label})"
            rows.append(
                (
                    run.experiment.name,
                    names[run.method.case].label,
                    str(run.n_steps),
                    f"{run.step_size:.6g}",
                    "-" if run.problem.exact_source == "none" else f"{finished.error:.3e}",
                    f"{finished.status}{member}",
                    "may fail" if run.experiment.expects_failure(run.method) else "",
                )
            )
    is_swept = any(outcome.experiment.members for outcome in outcomes)
    texts = [aligned(rows)] if len(rows) > 1 or not is_swept else []
    texts += _assurances_as_text(outcomes, every_member=every_member)
    texts += _observed_as_text(outcomes)
    designs = design_sheet([one for outcome in outcomes for one in outcome.finished])
    texts += [] if designs is None else [to_text(design_blocks(designs))]
    return "\n\n".join([*texts, *summed_up])


def _assurances_as_text(outcomes: Sequence[Outcome], *, every_member: bool) -> list[str]:
    """Tolerance, estimate and choice of runs that were chosen for a tolerance; sweeps summed up."""
    rows = [("experiment", "tolerance", "estimate", "choice")]
    for outcome in outcomes:
        found = [(one.run, one.assurance) for one in outcome.finished if one.assurance is not None]
        name = outcome.experiment.name
        if outcome.experiment.members and found:
            worst, own = max(found, key=lambda one: one[1].estimate / one[1].tolerance)
            steps = [run.n_steps for run, _ in found]
            ends = counts_in_words(one.outcome for _, one in found)
            rows.append(
                (
                    name,
                    f"{own.tolerance:g}",
                    f"{own.estimate:.3e}",
                    f"{len(found)} members on {min(steps)} to {max(steps)} adaptive steps, {ends}; "
                    f"nearest to its tolerance: {worst.member.label if worst.member else name}",
                )
            )
        if every_member or not outcome.experiment.members:
            rows += [
                (name, f"{own.tolerance:g}", f"{own.estimate:.3e}", own.choice) for _, own in found
            ]
    return [aligned(rows)] if len(rows) > 1 else []


def _observed_as_text(outcomes: Sequence[Outcome]) -> list[str]:
    """Quantities and events of every run that stands alone."""
    found = [
        (
            (outcome.experiment.name, _name(outcome, one.run.method.case), str(one.run.n_steps)),
            summary_of(one.trajectory.observed),
            one.error,
        )
        for outcome in outcomes
        for one in outcome.finished
        if one.run.member is None
    ]
    return [aligned(rows) for rows in observed_rows(found, "method")]


def _name(outcome: Outcome, case: str) -> str:
    """What people call a method among those of an experiment."""
    return method_names([one.run.method for one in outcome.finished])[case].label


def observed_rows(
    runs: Iterable[tuple[tuple[str, ...], ObservedSummary, float]], method: str = "case"
) -> list[list[tuple[str, ...]]]:
    """A table of the quantities and one of the events, as far as there are any.

    Parameters
    ----------
    runs
        The words that name a run, what was observed of it, and the error of its position, which
        stands beside the quantities where it is known of any run.
    method
        Heading of the second of these words.
    """
    named = ("experiment", method, "n_steps")
    quantities: list[tuple[str, ...]] = [
        (*named, "quantity", "peak", "at t", ERROR_TITLE, "least", "greatest", "rms")
    ]
    is_known = False
    events: list[tuple[str, ...]] = [(*named, "event", "times", "run")]
    for words, observed, error in runs:
        is_known = is_known or (bool(observed.extents) and math.isfinite(error))
        quantities += [
            (
                *words,
                name,
                *(f"{value:.6g}" for value in (one.peak, one.peak_time)),
                f"{error:.1e}" if math.isfinite(error) else "-",
                *(f"{value:.6g}" for value in (one.least, one.greatest, one.rms)),
            )
            for name, one in observed.extents.items()
        ]
        events += [
            (
                *words,
                name,
                str(count) if count else "never",
                "ended by it" if name == observed.stopped_by else "",
            )
            for name, count in observed.counts.items()
        ]
    if not is_known:
        place = quantities[0].index(ERROR_TITLE)
        quantities = [(*row[:place], *row[place + 1 :]) for row in quantities]
    return [rows for rows in (quantities, events) if len(rows) > 1]


def _members_as_text(outcome: Outcome) -> str:
    """One line for each method and number of steps of a sweep; errors of members that have one."""
    groups: dict[tuple[str, int], list[FinishedRun]] = {}
    for one in outcome.finished:
        groups.setdefault((one.run.method.case, one.run.n_steps), []).append(one)
    rows = [("experiment", "method", "n_steps", "members", "median", "largest", "status", "at")]
    for (case, n_steps), runs in groups.items():
        errors = {one.run.member: one.error for one in runs if math.isfinite(one.error)}
        worst = max(errors, key=errors.__getitem__, default=None)
        rows.append(
            (
                outcome.experiment.name,
                _name(outcome, case),
                str(n_steps),
                str(len(runs)),
                f"{statistics.median(errors.values()) if errors else math.nan:.3e}",
                f"{errors.get(worst, math.nan):.3e}",
                counts_in_words(one.status for one in runs),
                "" if worst is None else worst.label,
            )
        )
    return aligned(rows)


def contents_as_text(stored: StoredFile) -> str:
    """Where a result file comes from, and one line for every run in it."""
    lines = [f"{name}: {value}" for name, value in stored.provenance.items()]
    rows: list[tuple[str, ...]] = [
        ("experiment", "case", "n_steps", "step_size", "norm", "error", "status", "with")
    ]
    rows += [
        (
            run.experiment,
            run.case,
            str(run.n_steps),
            f"{run.step_size:.6g}",
            run.norm,
            f"{run.error:.3e}",
            run.status,
            run.variant,
        )
        for run in stored.runs
    ]
    if not any(run.variant for run in stored.runs):
        rows = [row[:-1] for row in rows]
    text = "\n".join([*lines, "", aligned(rows)])
    swept = dict.fromkeys(
        f"{run.experiment}: {run.members} members, {run.swept}; the largest error is shown"
        if run.members > 1
        else f"{run.experiment} {run.case} n_steps = {run.n_steps}: the member with {run.swept}"
        for run in stored.runs
        if run.members
    )
    observed = observed_rows(
        ((run.experiment, run.case, str(run.n_steps)), run.observed, run.error)
        for run in stored.runs
    )
    tables = [line for rows in observed for line in ("", aligned(rows))]
    return "\n".join([text, *tables, *(["", *swept] if swept else [])])


def titles_as_text(titles: Mapping[str, str]) -> str:
    """Names and titles side by side, wrapped where there is a terminal."""
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


def entries_as_text(entries: Sequence[Entry]) -> str:
    """One line for every group of a result file, with the number of runs in it."""
    counts = Counter(entry.path for entry in entries)
    return aligned([("group", "runs"), *((group, str(n)) for group, n in counts.items())])
