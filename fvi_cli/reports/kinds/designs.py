"""The table that compares designs: peaks of quantities, and their change against the first one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from fvi_cli.integrator.trajectory import Extent
from fvi_cli.reports.columns import CLOSE, GOOD, Item, member_columns, member_title, status_in_words
from fvi_cli.reports.table import Column, Sheet, Within
from fvi_cli.studies.experiment import FinishedRun, finest_of_members

LARGE_CHANGE = 100.0
"""Changes from this on are shown as powers of ten."""


def design_sheet(finished: Sequence[FinishedRun]) -> Sheet | None:
    """A row for every design, with columns for peaks and changes; None without designs."""
    by_experiment: dict[str, list[FinishedRun]] = {}
    for one in finished:
        if one.run.member is not None and one.run.member.name:
            by_experiment.setdefault(one.run.experiment.name, []).append(one)
    items = []
    for own in by_experiment.values():
        # the first design with the same swept values
        firsts: dict[str, FinishedRun] = {}
        for one in finest_of_members(own):
            values = repr(one.run.member and one.run.member.unnamed)
            items.append(Item(of=one, first=firsts.setdefault(values, one)))
    seen = [one.of.trajectory.observed for one in items]
    quantities = dict.fromkeys(name for one in seen if one is not None for name in one.extents)
    if not quantities:
        return None
    columns = (
        Column("experiment", get="of.run.experiment.name"),
        *member_columns((one.of.run.member for one in items), "of.run.member"),
        member_title("of.run.member"),
        Column("case", get="of.run.method.case"),
        Column("n_steps", get="of.run.n_steps"),
        *(column for quantity in quantities for column in _of_quantity(quantity)),
        Column("error", "error of position", ".1e", None, get="of.error"),
        Column("status", "status", status_in_words, get="of.status"),
    )
    return Sheet(name="designs", columns=columns, items=items, is_file=False)


def _of_quantity(name: str) -> tuple[Column, ...]:
    def extent(one: FinishedRun, what: str) -> float:
        observed = one.trajectory.observed
        found: Extent | None = None if observed is None else observed.extents.get(name)
        return math.nan if found is None else float(getattr(found, what))

    def of(item: Any, what: str) -> float:
        return extent(item.of, what)

    def change(item: Any) -> float | None:
        """As a fraction; the peaks of a failed run cannot be compared."""
        if item.first is item.of or item.of.status not in GOOD:
            return None
        before = extent(item.first, "peak")
        return of(item, "peak") / before - 1.0 if before else math.nan

    peak, error, limit = partial(of, what="peak"), partial(of, what="error"), Within(absolute=2e-3)
    return (
        Column(f"peak_{name}", f"peak {name}", ".4g", CLOSE, unit=name, get=peak),
        Column(f"peak_{name}_error", within=None, get=error),
        Column(f"peak_{name}_change", "change", _percent, limit, get=change),
    )


def _percent(value: float | None) -> str:
    if value is None or math.isnan(value):
        return "-"
    return f"{100 * value:+.1f} %" if abs(value) < LARGE_CHANGE else f"{100 * value:+.1e} %"
