"""How large quantities become in runs, how often events happen, and the comparison of designs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from fvi_cli.integrator.method_names import method_names
from fvi_cli.integrator.results.observed import Observed
from fvi_cli.reports.document import Block, CodeSpan, Heading, Paragraph
from fvi_cli.reports.naming import DESIGN, columns_with_units, member_columns, with_unit
from fvi_cli.reports.table import (
    About,
    Column,
    Report,
    Sheet,
    Sheets,
    Within,
    alike,
    number_of,
    within,
)
from fvi_cli.studies.experiment import FinishedRun, finest_of_members
from fvi_cli.studies.loops import (
    LEAST_POINTS,
    DamperLoop,
    deformation_against,
    forces_of,
    last_loop,
)
from fvi_cli.studies.members import label_of

CLOSE = Within(relative=1e-3, absolute=1e-12)
"""As for errors: other machines round otherwise."""

LOOSE = Within(relative=1e-2, absolute=1e-12)
"""Of loops, which are taken from the stored points."""
_RUN = (
    Column("experiment", "name of the experiment", "experiment", get="of.run.experiment.name"),
    Column(
        "member",
        "swept values",
        "member",
        get=lambda one: label_of(one.of.run.member),
    ),
    Column("case", "name of the method in files", "method", get="of.run.method.case"),
    Column("n_steps", "number N of steps", "N", get="of.run.n_steps"),
)
_KEYS = ("experiment", "member", "case", "n_steps")
_GOOD = ("ok", "floor")
EXTENT_COLUMNS = (
    Column("quantity", "its name", "quantity", get="name"),
    *within(
        "found",
        Column("peak", "largest absolute value", "peak", ".6g", CLOSE),
        Column("peak_time", "when it is reached first", "at t", ".6g", CLOSE, is_continuation=True),
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
"""Of what has a `name`, the extent `found`, and the `error` of its run."""

_UNIT = Column(
    "unit",
    "label of its unit",
    is_extra=True,
    get=lambda one: one.of.run.experiment.units.get(one.name, ""),
)
_STATUS = Column("status", "what was observed of the run", get="of.status")
COLUMNS = (*_RUN, EXTENT_COLUMNS[0], _UNIT, *EXTENT_COLUMNS[1:], _STATUS)


def _time(place: int) -> Callable[[About], float | None]:
    return lambda one: float(one.found.time[place]) if one.found.time.size else None


EVENT_COLUMNS = (
    *_RUN,
    Column("event", "name of the event or impact", "event", get="name"),
    Column("count", "how often it happened", "times", get=lambda one: int(one.found.time.size)),
    Column("first", "when it happened first", "first", ".6g", CLOSE, get=_time(0)),
    Column(
        "last", "when it happened last", "last", ".6g", CLOSE, get=_time(-1), is_continuation=True
    ),
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
    *within(
        "found",
        Column("amplitude", "half the range of the deformation", "amplitude", ".5g", LOOSE),
        Column(
            "stiffness", "equivalent stiffness: force over deformation", "stiffness", ".5g", LOOSE
        ),
        Column(
            "loss_factor",
            "energy of the loop over 2 pi times that of the stiffness at the amplitude",
            "loss factor",
            ".4g",
            LOOSE,
        ),
        Column("work", "energy of the loop", "energy of the loop", ".5g", LOOSE),
        Column("begin", "when the loop begins", "from t", ".5g", LOOSE),
        Column("end", "when it ends", "to t", ".5g", LOOSE, is_continuation=True),
    ),
    _STATUS,
)
Found = Callable[[FinishedRun, Observed], Mapping[str, Any]]


def _loops(one: FinishedRun, observed: Observed) -> Mapping[str, DamperLoop]:
    """The last loop of every damper whose force is a quantity, where there is one."""
    names = [name for name in forces_of(one.run.experiment) if name in observed.quantities]
    loops = {
        name: last_loop(one.trajectory.time, *deformation_against(one, name)) for name in names
    }
    return {name: loop for name, loop in loops.items() if loop is not None}


def quantities_report(name: str, finished: Sequence[FinishedRun]) -> Report:
    """Peaks and means of every quantity, and numbers and times of every event, of every run.

    Designs have a table of their own, which compares them.
    """
    seen = [(one, one.trajectory.observed) for one in finished]
    is_known = any(math.isfinite(one.error) for one in finished)
    # people see the status where there is a run that did not come to its end in order
    titles = {"status": "status"} if any(one.status not in _GOOD for one in finished) else {}
    if not is_known:
        titles["error"] = ""

    methods = method_names([one.run.method for one in finished])

    def label(case: str) -> str:
        return methods[case].label if case in methods else case

    forms = {"case": label}
    members = [one.run.member for one in finished]
    tells = member_columns(members, lambda one: one.of.run.member, "design")
    experiments = {one.run.experiment.name: one.run.experiment for one in finished}
    if len(experiments) == 1:
        titles["experiment"] = ""
    if all(one is None or (one.name and not one.unnamed) for one in members):
        # the names of designs say it all
        titles["member"] = ""
    units = next(iter(experiments.values())).units if len(experiments) == 1 else {}
    if any(
        name in one.units
        for one in experiments.values()
        for name in one.observations.quantities or ()
    ):
        titles["unit"] = "unit"

    def sheet(name: str, declared: tuple[Column, ...], of: Found, key: str) -> Sheet:
        # names stand where people begin to read, values behind everything else
        first, *rest = declared
        named = [one for one in tells if one.title]
        every = (first, *named, *rest, *(one for one in tells if not one.title))
        columns = tuple(
            replace(one, title=titles.get(one.name, one.title), form=forms.get(one.name, one.form))
            for one in every
        )
        items = (
            About(of=one, name=name, found=found, error=one.error)
            for one, observed in seen
            if observed is not None
            for name, found in of(one, observed).items()
        )
        return Sheet.of(name, columns, items, (*_KEYS, *(one.name for one in named), key))

    sheets: tuple[Sheet, ...] = (
        sheet("runs", COLUMNS, lambda _, observed: observed.extents, "quantity"),
        sheet("events", EVENT_COLUMNS, lambda _, observed: observed.events, "event"),
    )
    kinds = {"amplitude": "length", "stiffness": "stiffness", "work": "energy"}
    loops = sheet("loops", columns_with_units(LOOP_COLUMNS, units, **kinds), _loops, "force")
    sheets = (*sheets, loops) if loops.rows else sheets
    designs = design_sheet(finished)
    return Report(
        name=f"{name}-quantities",
        sheets=(*sheets, designs) if designs else sheets,
        words=lambda sheets: alike(_words(name, sheets)),
    )


def _words(name: str, sheets: Sheets) -> Iterator[Block]:
    yield Heading(level=1, words=("Quantities: ", CodeSpan(name)))
    yield Paragraph(
        words="Peaks, smallest and largest values and means are of the motion at all times, "
        "not of its stored points."
    )
    if designs := sheets.get("designs"):
        yield from design_blocks(designs)
    for sheet in (sheets[one] for one in ("runs", "events", "loops") if one in sheets):
        # what distinguishes a run from the others, and names of quantities and events, are repeated
        # where a grid is split
        shown = [column.name for column in sheet.columns if column.title]
        keys = shown.index("n_steps") + 2
        if sheet.rows:
            words = keys + (shown[keys] == "unit")
            yield sheet.grid(text_columns=words, key_columns=keys)
    if "loops" in sheets:
        amplitudes = [number_of(row["amplitude"]) for row in sheets["loops"].rows]
        if any(math.isnan(one) for one in amplitudes):
            yield Paragraph(
                words=(
                    f"Loops with fewer than {LEAST_POINTS} stored points, or too few for their "
                    "form, are left empty: store more points, such as ",
                    CodeSpan("output: {step: ...}"),
                    " with a fortieth of its time or less.",
                )
            )


_CHANGE = Within(absolute=2e-3)


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
    rows: list[About] = []
    for own in by_experiment.values():
        firsts: dict[str, FinishedRun] = {}
        rows += [
            About(of=one, first=firsts.setdefault(repr(_values(one)), one))
            for one in finest_of_members(own)
        ]
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
    units = rows[0].of.run.experiment.units if len(by_experiment) == 1 else {}
    tells = member_columns(
        [one.of.run.member for one in rows], lambda one: one.of.run.member, DESIGN
    )
    keys = [one for one in tells if one.title]
    columns = (
        Column("experiment", "name of the experiment", several, get="of.run.experiment.name"),
        *keys,
        Column("values", "swept values", "at" if is_swept else "", get=_label),
        Column("case", "name of the method in files", get="of.run.method.case"),
        Column("method", "its short name", get="of.run.method.label"),
        Column("n_steps", "number N of steps", get="of.run.n_steps"),
        *(column for quantity in quantities for column in _of_quantity(quantity, units)),
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
    return Sheet.of("designs", columns, rows, ("experiment", DESIGN, "values"))


def _of_quantity(name: str, units: Mapping[str, str]) -> tuple[Column, Column]:
    def change(one: About) -> float | None:
        if one.first is one.of:
            return None
        before = _peak(one.first, name)
        return _peak(one.of, name) / before - 1.0 if before else math.nan

    return (
        Column(
            f"peak_{name}",
            with_unit("largest absolute value", units, name),
            f"peak {name}",
            ".4g",
            CLOSE,
            get=lambda one: _peak(one.of, name),
        ),
        Column(
            f"peak_{name}_change",
            "its change against the first design, as a fraction of that",
            "change",
            _percent,
            _CHANGE,
            is_continuation=True,
            get=change,
        ),
    )


def _percent(value: float | None) -> str:
    return "-" if value is None or math.isnan(value) else f"{100 * value:+.1f} %"


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
