"""The report on quantities: their extents, numbers of events, and loops of dampers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from fvi_cli.integrator.trajectory import Observed
from fvi_cli.reports.columns import CLOSE, Item, member_columns, member_title, status_in_words
from fvi_cli.reports.kinds.designs import design_sheet
from fvi_cli.reports.kinds.ensembles import ensemble_sheet
from fvi_cli.reports.naming import with_unit
from fvi_cli.reports.table import MOST_LINES, Block, Column, Report, Sheet, Within, grid_of
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.loops import deformation_against, forces_of, last_loop
from fvi_cli.studies.study import with_peak_errors

LOOSE = Within(relative=1e-2, absolute=1e-12)
"""Tolerance for loops, which are computed from the stored points."""
RUN = (
    member_title("of.run.member"),
    Column("case", get="of.run.method.case"),
    Column("", "method", get="of.run.method_label"),
    Column("n_steps", "N", get="of.run.n_steps"),
)
STATUS = Column("status", "status", status_in_words, get="of.status")


def _error_of_position(one: Item) -> float:
    """The error of the run, where the quantity has none of its own."""
    return math.nan if math.isfinite(one.found.error) else float(one.of.error)


EXTENTS = (
    Column("peak", "peak", ".6g", CLOSE, get="found.peak"),
    Column("peak_time", "at t", ".6g", CLOSE, get="found.peak_time"),
    # by a second run: for a tolerance of the quantity, in ladders of its peak
    Column("peak_error", "error", ".1e", None, get="found.error"),
    # in the experiment's norm, or its estimate for a tolerance
    Column("error", within=None, get="of.error"),
    Column("", "error of position", ".1e", get=_error_of_position),
    Column("least", "least", ".6g", CLOSE, get="found.least"),
    Column("greatest", "greatest", ".6g", CLOSE, get="found.greatest"),
    Column("rms", "rms", ".6g", CLOSE, get="found.rms"),
    STATUS,
)
EVENTS = (
    Column("event", "event", get="name"),
    Column("count", "times", get=lambda one: int(one.found.time.size)),
    Column("first", "first", ".6g", CLOSE, get=lambda one: _time(one, 0)),
    Column("last", "last", ".6g", CLOSE, get=lambda one: _time(one, -1)),
    Column("ended_the_run", "ends the run", get=lambda one: one.name == _stop(one.of)),
    STATUS,
)
LOOPS = (
    Column("force", "force", get="name"),
    Column("amplitude", "amplitude", ".5g", LOOSE, "length", get="found.amplitude"),
    Column("stiffness", "stiffness", ".5g", LOOSE, "stiffness", get="found.stiffness"),
    Column("loss_factor", "loss factor", ".4g", LOOSE, get="found.loss_factor"),
    Column("work", "energy of the loop", ".5g", LOOSE, "energy", get="found.work"),
    Column("begin", "from t", ".5g", LOOSE, get="found.begin"),
    Column("end", "to t", ".5g", LOOSE, get="found.end"),
    STATUS,
)


def _time(one: Item, place: int) -> float | None:
    return float(one.found.time[place]) if one.found.time.size else None


def _stop(one: FinishedRun) -> str | None:
    return one.trajectory.observed.stopped_by if one.trajectory.observed else None


def _quantity(one: Item) -> str:
    return with_unit(one.name, one.of.run.experiment.units, one.name)


def _loops(one: FinishedRun, observed: Observed) -> Iterator[tuple[str, Any]]:
    """The last loop of every damper whose force is a quantity."""
    for name in forces_of(one.run.experiment):
        if name in observed.quantities:
            loop = last_loop(one.trajectory.time, *deformation_against(one, name))
            if loop is not None:
                yield name, loop


KINDS: dict[str, tuple[tuple[Column, ...], Callable[[FinishedRun, Observed], Iterable[Any]]]] = {
    "runs": (
        (Column("quantity", get="name"), Column("", "quantity", get=_quantity), *EXTENTS),
        lambda one, observed: observed.extents.items(),
    ),
    "events": (EVENTS, lambda one, observed: observed.events.items()),
    "loops": (LOOPS, _loops),
}
"""Columns of a table, and from a run to its rows: names and results."""


def quantities_report(name: str, finished: Sequence[FinishedRun]) -> Report:
    """The report on peaks and means of quantities, and numbers and times of events, by run.

    Further tables compare designs, and give mean and spread over the members of sweeps.
    """
    sheets, summaries = quantity_sheets(finished)
    return Report(
        name=f"{name}-quantities",
        sheets=(*sheets, *reversed(summaries)),
        blocks=[f"# Quantities: {name}", *quantity_blocks([*summaries, *sheets])],
    )


def quantity_sheets(finished: Sequence[FinishedRun]) -> tuple[list[Sheet], list[Sheet]]:
    """Sheets of runs, and those that sum up designs and members."""
    finished = with_peak_errors(finished)
    experiment = Column("experiment", get="of.run.experiment.name")
    swept = member_columns((one.run.member for one in finished), "of.run.member")
    sheets = []
    for kind, (columns, results) in KINDS.items():
        items = [
            Item(of=one, name=name, found=found)
            for one in finished
            if one.trajectory.observed is not None
            for name, found in results(one, one.trajectory.observed)
        ]
        if items or kind == "runs":
            every, is_file = (experiment, *swept, *RUN, *columns), kind != "loops"
            sheets.append(Sheet(name=kind, columns=every, items=items, is_file=is_file))
    return sheets, [one for one in (design_sheet(finished), ensemble_sheet(finished)) if one]


TITLES = {
    "designs": "Designs: peaks and their change against the first design.",
    "ensemble": "Peaks over the members:",
    "loops": "The last loop of every damper:",
}


SPARSE = (
    "A loop without numbers has too few stored points; 40 or more are needed, by more steps or by "
    "output: {step: ...}."
)


def quantity_blocks(sheets: Sequence[Sheet]) -> Iterator[Block]:
    """The grids of every experiment."""
    owners = {one.of.run.experiment.name: one.of.run for sheet in sheets for one in sheet.items}
    for (name, run), sheet in itertools.product(owners.items(), sheets):
        items = [one for one in sheet.items if one.of.run.experiment.name == name]
        if len(owners) > 1 and sheet is sheets[0]:
            yield f"## {name}"
        if not items or len(items) > MOST_LINES:
            continue
        if sheet.name in TITLES:
            yield TITLES[sheet.name]
        yield grid_of(sheet.columns, items, run.experiment.units)
        if sheet.name == "loops" and any(math.isnan(one.found.amplitude) for one in items):
            yield SPARSE
