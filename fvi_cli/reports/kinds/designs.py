"""The table that compares designs: peaks of quantities, and their change against the first one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from fvi_cli.reports.document import Block, Paragraph
from fvi_cli.reports.naming import DESIGN, member_columns, with_unit
from fvi_cli.reports.table import About, Column, Sheet, Within
from fvi_cli.studies.experiment import FinishedRun, finest_of_members

GOOD = ("ok", "floor")
"""Statuses of runs whose numbers are valid."""
CLOSE = Within(relative=1e-3, absolute=1e-12)
"""Tolerance for numbers that depend on the rounding of the machine, as for errors."""
_CHANGE = Within(absolute=2e-3)
LARGE_CHANGE = 100.0
"""Changes from this on are shown as powers of ten."""


def design_sheet(finished: Sequence[FinishedRun]) -> Sheet | None:
    """A row for every design, with columns for peaks and changes; None without designs."""
    by_experiment: dict[str, list[FinishedRun]] = {}
    for one in finished:
        if one.run.member is not None and one.run.member.name:
            by_experiment.setdefault(one.run.experiment.name, []).append(one)
    rows: list[About] = []
    for own in by_experiment.values():
        firsts: dict[str, FinishedRun] = {}
        rows += [
            About(of=one, first=firsts.setdefault(repr(_values(one)), one))
            for one in finest_of_members(own)
        ]
    seen = [one.of.trajectory.observed for one in rows]
    quantities = dict.fromkeys(name for one in seen if one is not None for name in one.extents)
    if not quantities:
        return None
    units = rows[0].of.run.experiment.units if len(by_experiment) == 1 else {}
    members = [one.of.run.member for one in rows]
    tells = member_columns(members, lambda one: one.of.run.member, DESIGN)
    columns = (
        Column(
            "experiment",
            "name of the experiment",
            "experiment" * (len(by_experiment) > 1),
            get="of.run.experiment.name",
        ),
        *(one for one in tells if one.title),
        Column("values", "swept values", "at" * any(_values(one.of) for one in rows), get=_label),
        Column("case", "name of the method in files", get="of.run.method.case"),
        Column("method", "its short name", get="of.run.method_label"),
        Column("n_steps", "number N of steps", get="of.run.n_steps"),
        *(column for quantity in quantities for column in _of_quantity(quantity, units)),
        Column(
            "error",
            "error of the position in the experiment's norm, or its estimate for a tolerance",
            "error of position",
            ".1e",
            None,
            get="of.error",
        ),
        Column(
            "status",
            "what was observed",
            "" if all(one.of.status in GOOD for one in rows) else "status",
            get="of.status",
        ),
        *(one for one in tells if not one.title),
    )
    return Sheet.of("designs", columns, rows, ("experiment", DESIGN, "values"), is_file=False)


def _extent(one: FinishedRun, quantity: str, what: str) -> float:
    observed = one.trajectory.observed
    found = None if observed is None else observed.extents.get(quantity)
    return math.nan if found is None else float(getattr(found, what))


def _of_quantity(name: str, units: Mapping[str, str]) -> tuple[Column, ...]:
    def change(one: About) -> float | None:
        if one.first is one.of or one.of.status not in GOOD:
            # the peaks of a failed run cannot be compared
            return None
        before = _extent(one.first, name, "peak")
        return _extent(one.of, name, "peak") / before - 1.0 if before else math.nan

    def extent(one: About, what: str) -> float:
        return _extent(one.of, name, what)

    label = with_unit(f"peak {name}", units, name)
    peak, error = partial(extent, what="peak"), partial(extent, what="error")
    words = "its change against the first design, as a fraction of that"
    return (
        Column(f"peak_{name}", "largest absolute value", label, ".4g", CLOSE, get=peak),
        Column(f"peak_{name}_error", "estimated error", compared=None, get=error),
        Column(f"peak_{name}_change", words, "change", _percent, _CHANGE, get=change),
    )


def _percent(value: float | None) -> str:
    if value is None or math.isnan(value):
        return "-"
    return f"{100 * value:+.1f} %" if abs(value) < LARGE_CHANGE else f"{100 * value:+.1e} %"


def _values(one: FinishedRun) -> Mapping[str, Any]:
    return {} if one.run.member is None else one.run.member.unnamed


def _label(one: Any) -> str:
    member = one.of.run.member
    return str(member.label).removeprefix(member.name).removeprefix(", ")


def design_blocks(sheet: Sheet) -> list[Block]:
    """The table of the designs with its title."""
    words = sum(bool(one.title) for one in sheet.columns[:3])
    return [
        Paragraph("Designs: peaks and their change against the first design."),
        sheet.grid(text_columns=words),
    ]
