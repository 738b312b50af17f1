"""The report on orders of convergence: every error, and the slopes of all methods."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Iterator, Mapping, Sequence

from fvi_cli.reports.columns import GOOD, Item, member_columns
from fvi_cli.reports.naming import members_in_words
from fvi_cli.reports.table import Block, Column, Grid, Report, Sheet, Within, grid_of, listed, pivot
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.members import counts_in_words, label_of
from fvi_cli.studies.order import OrderCase, OrderTable

ERROR = Within(relative=1e-3)
"""Tolerance for reliable errors."""
RELIABLE = 2000.0
"""Errors above this many floors are equal on every machine."""
MOST_MEMBERS = 32
"""Up to so many members have a row of their own."""
MOST_METHODS = 4
"""So many methods stand side by side."""
NORMS: Mapping[str, str] = {
    "max": "maximum norm over components and grid points",
    "final": "maximum norm over components at the final time",
    "l2": "l2 norm over the grid, weighted by h",
}
COLUMNS = (
    Column("case", get="case.method.case"),
    # convolution quadrature or baseline, sampling of the damping, degree of the polynomials,
    # quadrature of the action, start correction
    *(Column(name, get=f"case.method.{name}") for name in ("cq", "sampling", "degree")),
    Column("quadrature", get=lambda of: str(of.case.method.quadrature)),
    Column("start", get="case.method.start"),
    Column("norm", get="table.experiment.norm"),
    Column("n_steps", get="row.run.n_steps"),
    Column("step_size", get="row.run.step_size"),
    Column("error", within=ERROR, get="row.error"),
    Column("pairwise_order", within=None, get=lambda of: of.case.pairwise_order(of.index)),
    Column("used_in_fit", get="row.used_in_fit"),
    Column("slope", within=None, get="case.slope"),
    Column("order_smooth", get="row.order_smooth"),
    Column("status", get="row.status"),
    Column("seconds", within=None, get="row.trajectory.seconds"),
    Column("history_operations", within=None, get="row.trajectory.history_operations"),
)


def order_report(name: str, tables: Sequence[OrderTable]) -> Report:
    """The report on the orders of all experiments of the configuration `name`.

    A sweep has a table for every member, whose name and swept values stand behind that of the
    experiment.
    """
    items = [
        Item(table=table, case=case, index=index, row=row)
        for table in tables
        for case in table.cases
        for index, row in enumerate(case.rows)
    ]
    experiment = Column("experiment", get="table.experiment.name")
    swept = member_columns((table.member for table in tables), "table.member")
    heading = f"# Orders of convergence: {name}"
    return Report(
        name=name,
        sheets=(
            Sheet(
                name="runs",
                columns=(experiment, *swept, *COLUMNS),
                items=items,
                is_round_off=_is_round_off,
            ),
        ),
        blocks=[heading, *_blocks(name, tables)],
        summary=[heading, *_blocks(name, tables, every_n=False)],
        has_latex=True,
    )


def _is_round_off(of: Item, stored: Mapping[str, str]) -> set[str]:
    """Columns not compared: errors near the floor, and of diverged runs."""
    row = of.row
    if row.status not in GOOD:
        return {"error"}
    is_near = stored["status"] in GOOD and all(
        error <= RELIABLE * row.floor for error in (float(stored["error"]), row.error)
    )
    return {"error", "status", "used_in_fit"} if is_near else set()


def errors_in_words(norm: str, reference: str) -> str:
    """In which norm errors are, and against what."""
    known = {"expression": "the exact solution"}.get(
        reference, reference.removeprefix("reference ")
    )
    return f"Errors in the {NORMS[norm]}; reference: {known}"


def _blocks(title: str, tables: Sequence[OrderTable], *, every_n: bool = True) -> Iterator[Block]:
    """The slopes of all experiments; of each its setting, errors and remarks.

    Without `every_n` only finest errors and slopes.
    """
    alone = [table for table in tables if not table.swept]
    if len(alone) > 1:
        yield _finest(title, alone)
    for name, group in itertools.groupby(tables, key=lambda table: table.experiment.name):
        own = list(group)
        if own[0].cases and len(alone) > 1 and not (every_n or own[0].swept):
            continue
        if name != title:
            yield f"## {name}"
        if not own[0].cases:
            yield "No run is finished."
            continue
        yield _setting(own)
        if not own[0].swept and not every_n:
            yield grid_of(SLOPES, [Item(case=case, finest=case.rows[-1]) for case in own[0].cases])
        elif not own[0].swept:
            for first in range(0, len(own[0].cases), MOST_METHODS):
                yield _errors(own[0].cases[first : first + MOST_METHODS])
            yield from listed(_remarks(own[0]))
        else:
            yield f"{members_in_words([one.member for one in own if one.member is not None])}."
            yield _finest(title, own) if len(own) <= MOST_MEMBERS else _spread(own)


def _finest(title: str, tables: Sequence[OrderTable]) -> Grid:
    """A line for every table with the finest error and the slope of every method."""
    cases = {case.method.case: case.method.label for table in tables for case in table.cases}
    stated = {c.method.case for table in tables for c in table.cases if not math.isnan(c.claim)}
    return pivot(
        (
            (
                (label_of(table.member) or table.experiment.name.removeprefix(f"{title}-"),),
                case.method.case,
                (_entries(case, -1)[0], _slope(case)),
            )
            for table in tables
            for case in table.cases
        ),
        corner=("member" if tables[0].swept else "problem",),
        headings={
            case: (label, "slope (stated)" if case in stated else "slope")
            for case, label in cases.items()
        },
    )


def _slope(case: OrderCase) -> str:
    stated = "" if math.isnan(case.claim) else f" ({case.claim:g})"
    return _number(case.slope, ".2f") + stated


def _setting(tables: Sequence[OrderTable]) -> str:
    """Equation and norm of an experiment; `tables` are those of its members for a sweep."""
    experiment, reference = tables[0].experiment, tables[0].cases[0].rows[0].reference
    problem = experiment.problem
    terms = problem.scene.damping if isinstance(problem, Problem) else (problem,)
    orders = [f"{one.order:.15g}" for one in terms if not experiment.members]
    gamma = ", ".join(dict.fromkeys(orders))
    rows = (row for one in tables for case in one.cases for row in case.rows)
    mark = "" if all(row.used_in_fit for row in rows) else "; in parentheses: not used by the slope"
    equation = f"`{problem.equation}`; " if problem.equation else ""
    errors = errors_in_words(experiment.norm, reference)
    begin = f"{equation}{f'gamma = {gamma}; ' if gamma else ''}T = {problem.final_time:g}"
    return f"{begin}. {errors}{mark}."


def _errors(cases: Sequence[OrderCase]) -> Grid:
    """A line for every N with the error and the order of every method; slope and theory below."""
    cells = sorted(
        (row.run.n_steps, f"{row.run.step_size:.4g}", case.method.case, _entries(case, k))
        for case in cases
        for k, row in enumerate(case.rows)
    )
    sizes = {n: size for n, size, _, _ in reversed(cells)}
    below = {
        "slope": [_number(case.slope, ".2f") for case in cases],
        "on smooth data": [_number(case.order_smooth, ".3g") for case in cases],
        "stated": [_number(case.claim, "g") for case in cases],
    }
    return pivot(
        (((str(n), sizes[n]), case, texts) for n, _, case, texts in cells),
        corner=("N", "h"),
        headings={case.method.case: (case.method.label, "order") for case in cases},
        foot=[
            ((title, ""), {c.method.case: ("", one) for c, one in zip(cases, words, strict=True)})
            for title, words in below.items()
            if set(words) != {"-"}
        ],
    )


def _entries(case: OrderCase, k: int) -> list[str]:
    """The measured error, in parentheses where the slope does not use it, and the order."""
    row = case.rows[k]
    if math.isnan(row.error) or row.status == "diverged":
        return [row.status, ""]
    error = f"{row.error:.2e}" if row.used_in_fit else f"({row.error:.2e})"
    return [error, _number(case.pairwise_order(k), ".2f", "")]


def _number(value: float, form: str, missing: str = "-") -> str:
    return missing if math.isnan(value) else format(value, form)


SLOPES = (
    Column("method", "method", get="case.method.label"),
    Column("n_steps", "N", get="finest.run.n_steps"),
    Column("error", "error", get=lambda of: _entries(of.case, -1)[0]),
    Column("slope", "slope", ".2f", get="case.slope"),
    Column("order_smooth", "on smooth data", ".3g", get="case.order_smooth"),
    Column("claim", "stated", "g", get="case.claim"),
)
SPREAD = (
    Column("method", "method"),
    Column("least", "slope: least", ".2f", get=lambda of: min(of.slopes, default=math.nan)),
    Column("median", "median", ".2f", get=lambda of: statistics.median(of.slopes or [math.nan])),
    Column("greatest", "greatest", ".2f", get=lambda of: max(of.slopes, default=math.nan)),
    Column("error", "finest error: median", ".1e", get=lambda of: statistics.median(of.errors)),
    Column("largest", "largest", ".1e", get="worst.error"),
    Column("at", "at", get="worst.member"),
    Column("rows", "rows", get=lambda of: counts_in_words(of.statuses)),
)


def _spread(tables: Sequence[OrderTable]) -> Grid:
    """A line for every method with its slopes and finest errors over the members."""
    found: dict[str, list[tuple[OrderTable, OrderCase]]] = {}
    for table in tables:
        for case in table.cases:
            found.setdefault(case.method.label, []).append((table, case))
    items = []
    for label, own in found.items():
        finest = [Item(error=c.rows[-1].error, member=label_of(t.member)) for t, c in own]
        finite = [one for one in finest if math.isfinite(one.error)] or finest[:1]
        items.append(
            Item(
                method=label,
                slopes=[case.slope for _, case in own if math.isfinite(case.slope)],
                errors=[one.error for one in finite],
                worst=max(finite, key=lambda one: one.error),
                statuses=[row.status for _, case in own for row in case.rows],
            )
        )
    return grid_of(SPREAD, items)


def _remarks(table: OrderTable) -> Iterator[str]:
    """What the runs say, once for every method and text; of failures that of the first run."""
    found: dict[tuple[str, str], list[int]] = {}
    for case in table.cases:
        for row in case.rows:
            for text in row.trajectory.remarks:
                found.setdefault((case.method.label, text), []).append(row.run.n_steps)
        for row in [row for row in case.rows if row.trajectory.message][:1]:
            text = row.trajectory.message
            found.setdefault((case.method.label, text), []).append(row.run.n_steps)
    for (label, text), steps in found.items():
        numbers = steps if len(steps) <= 4 else [*steps[:2], "...", steps[-1]]
        yield f"{label}, N = {', '.join(map(str, numbers))}: {text.rstrip('.')}."
