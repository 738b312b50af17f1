"""How large quantities become in runs, and how often events happen."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fvi_cli.integrator.results.observed import Observed
from fvi_cli.reports.document import Block, CodeSpan, Heading, Paragraph
from fvi_cli.reports.kinds.designs import design_blocks, design_sheet
from fvi_cli.reports.kinds.members import member_columns
from fvi_cli.reports.table import Column, Report, Sheet, Sheets, Within, alike, rows_of, within
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.loops import DamperLoop, deformation_against, forces_of, last_loop

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
        get=lambda one: one.of.run.member.label if one.of.run.member else "",
    ),
    Column("case", "name of the method in files", "case", get="of.run.method.case"),
    Column("n_steps", "number N of steps", "N", get="of.run.n_steps"),
)
_KEYS = ("experiment", "member", "case", "n_steps")
_GOOD = ("ok", "floor")
EXTENT_COLUMNS = (
    Column("quantity", "its name", "quantity", get="name"),
    *within(
        "found",
        Column("peak", "largest absolute value", "peak", ".6g", CLOSE),
        Column("peak_time", "when it is reached first", "at t", ".6g", CLOSE),
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
_STATUS = Column("status", "what was observed of the run", get="of.status")
COLUMNS = (*_RUN, *EXTENT_COLUMNS, _STATUS)
EVENT_COLUMNS = (
    *_RUN,
    Column("event", "name of the event or impact", "event", get="name"),
    Column("count", "how often it happened", "times", get=lambda one: int(one.found.time.size)),
    Column(
        "first", "when it happened first", "first", ".6g", CLOSE, get=lambda one: one.time_at(0)
    ),
    Column("last", "when it happened last", "last", ".6g", CLOSE, get=lambda one: one.time_at(-1)),
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
        Column("end", "when it ends", "to t", ".5g", LOOSE),
    ),
    _STATUS,
)
Found = Callable[[FinishedRun, Observed], Mapping[str, Any]]


@dataclass(frozen=True, kw_only=True)
class _One:
    """A quantity or event of a run, and what was found of it."""

    of: FinishedRun
    name: str
    found: Any

    @property
    def error(self) -> float:
        return self.of.error

    def time_at(self, place: int) -> float | None:
        return float(self.found.time[place]) if self.found.time.size else None


def _loops(one: FinishedRun, observed: Observed) -> Mapping[str, DamperLoop]:
    """The last loop of every damper whose force is a quantity, where there is one."""
    names = [name for name in forces_of(one.run.experiment) if name in observed.quantities]
    loops = {
        name: last_loop(one.trajectory.time, *deformation_against(one, name)) for name in names
    }
    return {name: loop for name, loop in loops.items() if loop is not None}


def quantities_report(name: str, finished: Sequence[FinishedRun]) -> Report:
    """Peaks and means of every quantity, and numbers and times of every event, of every run.

    Designs have a table of their own, in which they stand side by side.
    """
    seen = [(one, one.trajectory.observed) for one in finished]
    is_known = any(math.isfinite(one.error) for one in finished)
    # people see the status where there is a run that did not come to its end in order
    titles = {"status": "status"} if any(one.status not in _GOOD for one in finished) else {}
    if not is_known:
        titles["error"] = ""

    members = [one.run.member for one in finished]
    tells = member_columns(members, lambda one: one.of.run.member, "design")
    if all(one is not None and one.name and not one.unnamed for one in members):
        # the names of designs say it all
        titles["member"] = ""

    def sheet(name: str, declared: tuple[Column, ...], of: Found, key: str) -> Sheet:
        # names stand where people begin to read, values behind everything else
        first, *rest = declared
        named = [one for one in tells if one.title]
        every = (first, *named, *rest, *(one for one in tells if not one.title))
        columns = tuple(replace(one, title=titles.get(one.name, one.title)) for one in every)
        items = (
            _One(of=one, name=name, found=found)
            for one, observed in seen
            if observed is not None
            for name, found in of(one, observed).items()
        )
        rows = rows_of(columns, items)
        keys = (*_KEYS, *(one.name for one in named), key)
        return Sheet(name=name, columns=columns, rows=rows, keys=keys)

    sheets: tuple[Sheet, ...] = (
        sheet("runs", COLUMNS, lambda _, observed: observed.extents, "quantity"),
        sheet("events", EVENT_COLUMNS, lambda _, observed: observed.events, "event"),
    )
    loops = sheet("loops", LOOP_COLUMNS, _loops, "force")
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
    runs = [sheets[one] for one in ("runs", "events", "loops") if one in sheets]
    # what tells a run from the others is repeated where a grid is split
    position = [column.name for column in runs[0].columns if column.title].index("n_steps") + 1
    yield from (
        one.grid(text_columns=position - 1, key_columns=position) for one in runs if one.rows
    )
