"""Designs side by side: the peak of every quantity, and its change against the first design."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fvi_cli.reports.document import Block, Paragraph
from fvi_cli.reports.kinds.members import DESIGN, member_columns
from fvi_cli.reports.table import Column, Sheet, Within, rows_of
from fvi_cli.studies.experiment import FinishedRun, finest_of_members

CLOSE = Within(relative=1e-3, absolute=1e-12)
_CHANGE = Within(absolute=2e-3)
_GOOD = ("ok", "floor")


@dataclass(frozen=True, kw_only=True)
class _Design:
    """The finest run of a design by the first method, and that of the first design beside it."""

    of: FinishedRun
    first: FinishedRun | None

    def peak(self, quantity: str) -> float:
        return _peak(self.of, quantity)

    def change(self, quantity: str) -> float | None:
        if self.first is None or self.first is self.of:
            return None
        before = _peak(self.first, quantity)
        return self.peak(quantity) / before - 1.0 if before else math.nan


def _peak(one: FinishedRun, quantity: str) -> float:
    observed = one.trajectory.observed
    found = None if observed is None else observed.extents.get(quantity)
    return math.nan if found is None else float(found.peak)


def design_sheet(finished: Sequence[FinishedRun]) -> Sheet | None:
    """A row for every design, with peaks and changes in columns; None where nothing is named."""
    named = [one for one in finished if one.run.member is not None and one.run.member.name]
    by_experiment: dict[str, list[FinishedRun]] = {}
    for one in named:
        by_experiment.setdefault(one.run.experiment.name, []).append(one)
    rows: list[_Design] = []
    for own in by_experiment.values():
        firsts: dict[str, FinishedRun] = {}
        for one in finest_of_members(own):
            values = repr(_values(one))
            rows.append(_Design(of=one, first=firsts.setdefault(values, one)))
    quantities = dict.fromkeys(
        name
        for one in rows
        if one.of.trajectory.observed is not None
        for name in one.of.trajectory.observed.extents
    )
    if not quantities:
        return None
    is_known = any(math.isfinite(one.of.error) for one in rows)
    is_swept = any(_values(one.of) for one in rows)
    is_good = all(one.of.status in _GOOD for one in rows)
    several = "experiment" if len(by_experiment) > 1 else ""
    tells = member_columns([one.of.run.member for one in rows], _member_of, DESIGN)
    keys = [one for one in tells if one.title]
    columns = (
        Column("experiment", "name of the experiment", several, get="of.run.experiment.name"),
        *keys,
        Column("values", "swept values", "at" if is_swept else "", get=_label),
        Column("case", "name of the method in files", get="of.run.method.case"),
        Column("method", "its short name", get="of.run.method.label"),
        Column("n_steps", "number N of steps", get="of.run.n_steps"),
        *(column for quantity in quantities for column in _of_quantity(quantity)),
        Column(
            "error",
            "error of the position in the experiment's norm, or its estimate for a tolerance",
            "error of position" if is_known else "",
            ".1e",
            None,
            get="of.error",
        ),
        Column("status", "what was observed", "" if is_good else "status", get="of.status"),
        *(one for one in tells if not one.title),
    )
    return Sheet(
        name="designs",
        columns=columns,
        rows=rows_of(columns, rows),
        keys=("experiment", DESIGN, "values"),
    )


def _of_quantity(name: str) -> tuple[Column, Column]:
    def peak(one: Any) -> float:
        return float(one.peak(name))

    def change(one: Any) -> float | None:
        found: float | None = one.change(name)
        return found

    return (
        Column(f"peak_{name}", "largest absolute value", f"peak {name}", ".4g", CLOSE, get=peak),
        Column(
            f"peak_{name}_change",
            "its change against the first design, as a fraction of that",
            "change",
            _percent,
            _CHANGE,
            get=change,
        ),
    )


def _percent(value: float | None) -> str:
    return "-" if value is None or math.isnan(value) else f"{100 * value:+.1f} %"


def _member_of(one: Any) -> Any:
    return one.of.run.member


def _values(one: FinishedRun) -> Mapping[str, Any]:
    return {} if one.run.member is None else one.run.member.unnamed


def _label(one: Any) -> str:
    member = one.of.run.member
    return str(member.label).removeprefix(member.name).removeprefix(", ")


def design_blocks(sheet: Sheet) -> list[Block]:
    """The table of the designs, and what it says."""
    words = sum(bool(one.title) for one in sheet.columns[:3])
    row = sheet.rows[0]
    how = f"by {row['method']}, N = {row['n_steps']}"
    if len({(one["case"], one["n_steps"]) for one in sheet.rows}) > 1:
        how = "each on its finest grid"
    note = f"Designs: peaks ({how}) and their change against the first design."
    return [Paragraph(words=note), sheet.grid(text_columns=words, key_columns=words)]
