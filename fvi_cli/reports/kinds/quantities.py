"""How large quantities become in runs, and how often events happen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from fvi_cli.reports.document import Block, Code, Heading, Paragraph
from fvi_cli.reports.table import Column, Report, Row, Sheet, Value, Within, row_of
from fvi_cli.studies.experiment import FinishedRun

CLOSE = Within(relative=1e-3, absolute=1e-12)
"""As for errors: other machines round otherwise."""

_RUN = (
    Column("experiment", "name of the experiment", title="experiment"),
    Column("member", "swept values", title="member"),
    Column("case", "name of the method in files", title="case"),
    Column("n_steps", "number N of steps", title="N"),
)
_KEYS = ("experiment", "member", "case", "n_steps")
ERROR_TITLE = "error of position"
COLUMNS = (
    *_RUN,
    Column("quantity", "its name", title="quantity"),
    Column("peak", "largest absolute value", title="peak", form=".6g", compared=CLOSE),
    Column("peak_time", "when it is reached first", title="at t", form=".6g", compared=CLOSE),
    Column(
        "error",
        "error of the position in the experiment's norm, or its estimate for a tolerance",
        title=ERROR_TITLE,
        form=".1e",
        compared=None,
    ),
    Column("least", "smallest value", title="least", form=".6g", compared=CLOSE),
    Column("greatest", "largest value", title="greatest", form=".6g", compared=CLOSE),
    Column("rms", "root of the mean square over the run", title="rms", form=".6g", compared=CLOSE),
    Column("status", "what was observed of the run"),
)
EVENT_COLUMNS = (
    *_RUN,
    Column("event", "name of the event or impact", title="event"),
    Column("count", "how often it happened", title="times"),
    Column("first", "when it happened first", title="first", form=".6g", compared=CLOSE),
    Column("last", "when it happened last", title="last", form=".6g", compared=CLOSE),
    Column("ended_the_run", "whether the run ended there", title="ends the run"),
)


def quantities_report(name: str, finished: Sequence[FinishedRun]) -> Report:
    """Peaks and means of every quantity, and numbers and times of every event, of every run."""
    quantities: list[Row] = []
    events: list[Row] = []
    for one in finished:
        observed = one.trajectory.observed
        if observed is None:
            continue
        run = _run(one)
        for quantity, extent in observed.extents.items():
            quantities.append(row_of(COLUMNS, extent, one, **run, quantity=quantity))
        for event, found in observed.events.items():
            times = found.time
            events.append(
                {
                    **run,
                    "event": event,
                    "count": int(times.size),
                    "first": float(times[0]) if times.size else None,
                    "last": float(times[-1]) if times.size else None,
                    "ended_the_run": event == observed.stopped_by,
                }
            )
    columns: tuple[Column, ...] = COLUMNS
    if not any(math.isfinite(one.error) for one in finished):
        columns = tuple(replace(one, title="") if one.name == "error" else one for one in COLUMNS)
    sheets = (
        Sheet(name="runs", columns=columns, rows=tuple(quantities), keys=(*_KEYS, "quantity")),
        Sheet(name="events", columns=EVENT_COLUMNS, rows=tuple(events), keys=(*_KEYS, "event")),
    )
    blocks: list[Block] = [
        Heading(level=1, words=("Quantities: ", Code(name))),
        Paragraph(
            words="Peaks, smallest and largest values and means are of the motion at all times, "
            "not of its stored points."
        ),
    ]
    grids = [sheet.grid(text_columns=3, key_columns=4) for sheet in sheets if sheet.rows]
    words = (*blocks, *grids)
    return Report(name=f"{name}-quantities", sheets=sheets, summary=words, blocks=words)


def _run(one: FinishedRun) -> dict[str, Value]:
    run = one.run
    return {
        "experiment": run.experiment.name,
        "member": "" if run.member is None else run.member.label,
        "case": run.method.case,
        "n_steps": run.n_steps,
    }
