"""The report on quantities: their extents, numbers of events, and loops of dampers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from fvi_cli.integrator.trajectory import Extent, Observed
from fvi_cli.reports.document import Block, Heading, Paragraph
from fvi_cli.reports.kinds.designs import CLOSE, GOOD, design_blocks, design_sheet
from fvi_cli.reports.kinds.ensembles import ensemble_sheet
from fvi_cli.reports.naming import columns_with_units, member_columns
from fvi_cli.reports.table import About, Column, Report, Sheet, Within, within
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.loops import (
    DamperLoop,
    deformation_against,
    forces_of,
    loops_of,
)
from fvi_cli.studies.members import label_of
from fvi_cli.studies.peak_errors import with_peak_errors

LOOSE = Within(relative=1e-2, absolute=1e-12)
"""Tolerance for loops, which are computed from the stored points."""
MOST_ROWS = 100
"""Longer tables are in the CSV only; readers have mean and spread of the members."""
_RUN = (
    Column("experiment", "name of the experiment", "experiment", get="of.run.experiment.name"),
    Column("member", "swept values", "member", get=lambda one: label_of(one.of.run.member)),
    Column("case", "name of the method in files", "method", get="of.run.method.case"),
    Column("n_steps", "number N of steps", "N", get="of.run.n_steps"),
)
_KEYS = ("experiment", "member", "case", "n_steps")
_STATUS = Column("status", "what was observed of the run", get="of.status")
_UNIT = Column(
    "unit",
    "label of its unit",
    "unit",
    is_extra=True,
    get=lambda one: one.of.run.experiment.units.get(one.name, ""),
)


def _estimate(value: float) -> str:
    return f"{value:.1e}" if math.isfinite(value) else "-"


def shown_errors(extents: Iterable[Extent], errors: Iterable[float]) -> tuple[bool, bool]:
    """Whether to show errors of the quantities, and whether in their place those of positions."""
    is_own = any(math.isfinite(one.error) for one in extents)
    return is_own, not is_own and any(map(math.isfinite, errors))


EXTENT_COLUMNS = (
    Column("quantity", "its name", "quantity", get="name"),
    Column("peak", "largest absolute value", "peak", ".6g", CLOSE, get="found.peak"),
    Column("peak_time", "when first", "at t", ".6g", CLOSE, get="found.peak_time"),
    Column(
        "peak_error",
        "estimated error by a second run: for a tolerance of the quantity, in ladders of its peak",
        "error",
        _estimate,
        None,
        get="found.error",
    ),
    Column(
        "error",
        "error of the position in the experiment's norm, or its estimate for a tolerance",
        "error of position",
        ".1e",
        None,
    ),
    *within(
        "found",
        Column("least", "smallest value", "least", ".6g", CLOSE),
        Column("greatest", "largest value", "greatest", ".6g", CLOSE),
        Column("rms", "root of the mean square over the run", "rms", ".6g", CLOSE),
    ),
)
"""Columns for items with a `name`, an extent `found`, and the `error` of the run."""
COLUMNS = (*_RUN, EXTENT_COLUMNS[0], _UNIT, *EXTENT_COLUMNS[1:], _STATUS)


def _time(place: int) -> Callable[[About], float | None]:
    return lambda one: float(one.found.time[place]) if one.found.time.size else None


EVENT_COLUMNS = (
    *_RUN,
    Column("event", "name of the event or impact", "event", get="name"),
    Column("count", "how often it happened", "times", get=lambda one: int(one.found.time.size)),
    Column("first", "when it happened first", "first", ".6g", CLOSE, get=_time(0)),
    Column("last", "when it happened last", "last", ".6g", CLOSE, get=_time(-1)),
    Column(
        "ended_the_run",
        "whether the run ended there",
        "ends the run",
        get=lambda one: one.name == one.of.trajectory.observed.stopped_by,
    ),
    _STATUS,
)
LOOP_COLUMNS = (
    *_RUN,
    Column("force", "name of the quantity that is the force", "force", get="name"),
    Column("loop", "which one: the last, or the largest", "loop", get="which"),
    *within(
        "found",
        Column("amplitude", "half the range of the deformation", "amplitude", ".5g", LOOSE),
        Column("stiffness", "force over deformation", "stiffness", ".5g", LOOSE),
        Column(
            "loss_factor",
            "energy of the loop over 2 pi times that of the stiffness at the amplitude",
            "loss factor",
            ".4g",
            LOOSE,
        ),
        Column("work", "energy of the loop", "energy of the loop", ".5g", LOOSE),
        Column("begin", "when the loop begins", "from t", ".5g", LOOSE),
        Column("end", "when it ends", "to t", ".5g", LOOSE),
    ),
    _STATUS,
)
Found = Callable[[FinishedRun, Observed], Iterable[tuple[str, str, Any]]]
"""From a run to triples (name, a further word, result)."""


def _extents(one: FinishedRun, observed: Observed) -> Iterator[tuple[str, str, Any]]:
    return ((name, "", found) for name, found in observed.extents.items())


def _events(one: FinishedRun, observed: Observed) -> Iterator[tuple[str, str, Any]]:
    return ((name, "", found) for name, found in observed.events.items())


def _loops(one: FinishedRun, observed: Observed) -> Iterator[tuple[str, str, DamperLoop]]:
    """The last and the largest loop of every damper whose force is a quantity."""
    for name in forces_of(one.run.experiment):
        if name in observed.quantities:
            motion = deformation_against(one, name)
            for word, loop in loops_of(one.trajectory.time, *motion).items():
                yield name, word, loop


def quantities_report(name: str, finished: Sequence[FinishedRun]) -> Report:
    """The report on peaks and means of quantities, and numbers and times of events, by run.

    Separate tables compare designs, and give mean and spread over the members of sweeps.
    """
    finished = with_peak_errors(finished)
    members = [one.run.member for one in finished]
    tells = member_columns(members, lambda one: one.of.run.member, "design")
    named = [one for one in tells if one.title]
    shape = _shape(finished)

    def sheet(name: str, declared: tuple[Column, ...], of: Found, *keys: str) -> Sheet:
        # names of members are among the first columns, values the last ones
        every = (declared[0], *named, *declared[1:], *(one for one in tells if not one.title))
        columns = tuple(replace(one, **shape.get(one.name, {})) for one in every)
        items = (
            About(of=one, name=found_name, which=word, found=found, error=one.error)
            for one in finished
            if one.trajectory.observed is not None
            for found_name, word, found in of(one, one.trajectory.observed)
        )
        return Sheet.of(name, columns, items, (*_KEYS, *(one.name for one in named), *keys))

    experiments = {one.run.experiment.name: one.run.experiment for one in finished}
    units = next(iter(experiments.values())).units if len(experiments) == 1 else {}
    kinds = {"amplitude": "length", "stiffness": "stiffness", "work": "energy"}
    loop_columns = columns_with_units(LOOP_COLUMNS, units, **kinds)
    loops = sheet("loops", loop_columns, _loops, "force", "loop")
    sheets = [
        sheet("runs", COLUMNS, _extents, "quantity"),
        sheet("events", EVENT_COLUMNS, _events, "event"),
        replace(loops, is_file=False),
        ensemble_sheet(finished),
        design_sheet(finished),
    ]
    first, *others = [one for one in sheets if one is not None]
    kept = (first, *(one for one in others if one.rows))
    blocks = list(_blocks(name, {one.name: one for one in kept}))
    return Report(name=f"{name}-quantities", sheets=kept, blocks=blocks)


def _shape(finished: Sequence[FinishedRun]) -> Mapping[str, dict[str, Any]]:
    """Titles and forms of columns for these runs: what is the same for all has no column."""
    seen = [one.trajectory.observed for one in finished]
    extents = [one for found in seen if found is not None for one in found.extents.values()]
    is_own, is_of_position = shown_errors(extents, [one.error for one in finished])
    labels = {one.run.method.case: one.run.method_label for one in finished}
    members = [one.run.member for one in finished]
    hidden = {
        "peak_error": not is_own,
        "error": not is_of_position,
        "experiment": len({one.run.experiment.name for one in finished}) == 1,
        # names of designs are enough
        "member": all(one is None or (one.name and not one.unnamed) for one in members),
    }
    shape: dict[str, dict[str, Any]] = {
        name: {"title": ""} for name, is_so in hidden.items() if is_so
    }
    if any(one.status not in GOOD for one in finished):
        shape["status"] = {"title": "status"}
    return shape | {"case": {"form": lambda case: labels.get(case, case)}}


def _blocks(name: str, sheets: Mapping[str, Sheet]) -> Iterator[Block]:
    yield Heading(1, f"Quantities: {name}")
    if "designs" in sheets:
        yield from design_blocks(sheets["designs"])
    if "ensemble" in sheets:
        yield Paragraph("Peaks over the members:")
        yield sheets["ensemble"].grid(text_columns=2)
    for sheet in (sheets[one] for one in ("runs", "events", "loops") if one in sheets):
        if not sheet.rows or len(sheet.rows) > MOST_ROWS:
            continue
        if sheet.name == "loops":
            yield Paragraph("The last loop of every damper, and the largest one if wider:")
        shown = [column.name for column in sheet.columns if column.title]
        keys = shown.index("n_steps") + 2 + ("loop" in shown) + ("unit" in shown)
        yield sheet.grid(text_columns=keys)
