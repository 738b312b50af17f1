"""Orders of convergence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import cast, get_args

from fvi_cli.reports.document import Block, Heading
from fvi_cli.reports.kinds.members import member_columns
from fvi_cli.reports.kinds.order_details import details, setting
from fvi_cli.reports.kinds.order_summary import legend, names_of, summary
from fvi_cli.reports.kinds.order_sweeps import split_sweeps, sweep_details
from fvi_cli.reports.table import (
    Column,
    Report,
    Row,
    Sheet,
    Value,
    Within,
    Words,
    number_of,
    rows_of,
    within,
)
from fvi_cli.studies.experiment import Observed
from fvi_cli.studies.order import NEAR_FLOOR, OrderCase, OrderRow, OrderTable, with_orders

ERROR = Within(relative=1e-3)
"""For errors that are reliable."""

RELIABLE = 2 * NEAR_FLOOR
"""Errors above this many floors are the same on every machine.

Twice the limit below which rows are used for no order, so that an error beside that limit may lie
on either side of it.
"""

_EXPERIMENT = Column("experiment", "name of the experiment", get="table.experiment")


COLUMNS = (
    _EXPERIMENT,
    Column("case", "name of the method in files", get="case.method.case"),
    *within(
        "described",
        Column("cq", "convolution quadrature, or the baseline"),
        Column("sampling", "where the damping is sampled"),
        Column("degree", "degree of the polynomials"),
        Column("quadrature", "quadrature of the action and its number of points"),
        Column("start", "start correction"),
    ),
    Column("gamma", "orders of the damping, joined by ;", get="table.gamma"),
    Column("norm", "norm of the error", get="table.norm"),
    *within(
        "row",
        Column("n_steps", "number N of steps"),
        Column("step_size", "h, in the scene's unit of time"),
        Column("error", "error of the position, in its unit", compared=ERROR),
        # what follows from errors must follow from those beside it: within 0.01 of the fresh one
        Column("pairwise_order", "order against the row before", compared=None, follows=True),
        Column("used_in_fit", "whether the slope uses the row", follows=True),
    ),
    *within(
        "case",
        Column(
            "slope",
            "least-squares slope of log(error) against log(h) over the rows used",
            compared=None,
            follows=True,
        ),
        Column(
            "fit_residual", "rms residual of that fit in log10(error)", compared=None, follows=True
        ),
    ),
    *within(
        "row",
        Column("expected_order", "order that theory expects at this step"),
        Column("predicted", "predicted stability"),
        Column("status", "what was observed"),
    ),
)
EXTRA_COLUMNS = within(
    "row",
    Column("floor", "errors below are round-off or the reference's own", "", "", None, "", True),
    Column("message", "what happened", "", "", None, "", True),
    Column(
        "remarks",
        "what a reader should know",
        compared=None,
        is_extra=True,
        get=lambda of: "; ".join(of.row.remarks),
    ),
)
EXPERIMENT_COLUMNS = (
    Column("experiment", "name of the experiment, and member of a sweep", get="title"),
    Column("equation", "equation of motion"),
    Column("reference", "what errors are measured against", compared=None),
    Column("final_time", "T, in the scene's unit of time"),
)


@dataclass(frozen=True, kw_only=True)
class _Of:
    """What a row is about."""

    table: OrderTable
    case: OrderCase
    row: OrderRow
    described: SimpleNamespace


def order_report(name: str, tables: Sequence[OrderTable]) -> Report:
    """The orders of all experiments of the configuration `name`; a table for every one of them.

    A sweep has a table for every member, and columns for their names and every swept key behind
    the others.
    """
    swept = member_columns((table.member for table in tables), lambda of: of.table.member)
    columns = (*COLUMNS, *swept, *EXTRA_COLUMNS)
    items = (
        _Of(table=table, case=case, row=row, described=described)
        for table in tables
        for case in table.cases
        for described in (SimpleNamespace(**case.columns()),)
        for row in case.rows
    )
    runs = Sheet(
        name="runs",
        columns=columns,
        rows=rows_of(columns, items),
        keys=("experiment", "case", "n_steps", *(column.name for column in swept)),
        below_floor=_below_floor,
    )
    experiments = Sheet(
        name="experiments",
        columns=EXPERIMENT_COLUMNS,
        rows=rows_of(EXPERIMENT_COLUMNS, tables),
        keys=("experiment",),
        is_file=False,
    )
    return Report(
        name=name,
        sheets=(runs, experiments),
        words=lambda sheets: _words(name, tables),
        remake=lambda sheets: order_report(name, list(_with_rows(tables, sheets["runs"].rows))),
    )


def _words(name: str, tables: Sequence[OrderTable]) -> Words:
    orders = [Heading(level=1, words=f"Orders of convergence: {name}"), *summary(name, tables)]
    return orders, [*orders, *legend(tables), *_all_details(tables)]


def _all_details(tables: Sequence[OrderTable]) -> Iterator[Block]:
    names = names_of(tables)
    single, swept = split_sweeps(tables)
    for table in single:
        yield from details(table, names)
    for members in swept:
        yield from sweep_details(members, names, setting(members))


def _below_floor(stored: Row, fresh: Row) -> set[str]:
    """Errors near the floor with what is said of them, and how far a run diverged."""
    if fresh["status"] not in ("ok", "floor"):
        return {"error"}
    error, other, floor = (number_of(v) for v in (stored["error"], fresh["error"], fresh["floor"]))
    is_round_off = stored["status"] in ("ok", "floor") and max(error, other) <= RELIABLE * floor
    return {"error", "status", "used_in_fit"} if is_round_off else set()


def _status(value: Value) -> Observed:
    if value not in get_args(Observed):
        raise ValueError(f"status: {value!r} is not one of {', '.join(get_args(Observed))}")
    return cast(Observed, value)


def _with_rows(tables: Sequence[OrderTable], rows: Sequence[Row]) -> Iterator[OrderTable]:
    """The tables with the errors of `rows`, and the orders that follow from them."""
    stored = iter(rows)
    for table in tables:
        cases = []
        for case in table.cases:
            own = tuple(
                replace(row, error=number_of(found["error"]), status=_status(found["status"]))
                for row, found in zip(case.rows, stored, strict=False)
            )
            cases.append(with_orders(replace(case, rows=own)))
        yield replace(table, cases=tuple(cases))
