"""Force against deformation: the loops of dampers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.looks import Look
from fvi_cli.plotting.motions.time_series import (
    MOST_COMPONENTS,
    has_quantities,
    most_accurate,
    select_runs,
)
from fvi_cli.plotting.panels import MOST_LINES, plane
from fvi_cli.plotting.style import COLOURS
from fvi_cli.plotting.words import (
    member_label,
    swept_in_words,
    swept_number,
    typeset_name,
    with_unit,
)
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.loops import deformation_against, forces_of


def hysteresis_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw force against deformation, a panel for every force (up to 4) among the quantities."""
    best = most_accurate(select_runs(finished, has_quantities))
    panels = []
    for name in forces_of(experiment)[:MOST_COMPONENTS]:
        look = Look(colour=COLOURS[0], width=0.9)
        panels.append(_panel(experiment, name, [_loop(best, name, look=look)]))
    return plane(panels, columns=min(2, len(panels)))


def sweep_hysteresis_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the loops of members of a sweep, of the first method on the finest grid.

    Many members of one swept number have the colours of a bar.
    """
    having = finest_of_members([item for item in finished if has_quantities(item)])
    numbers = [swept_number(item.run.member) for item in having]
    is_many = len(having) > MOST_LINES and None not in numbers
    panels = []
    for name in forces_of(experiment)[:MOST_COMPONENTS]:
        curves = [
            _loop(item, name, label=member_label(item.run.member), by=number if is_many else None)
            for item, number in zip(having, numbers, strict=True)
        ]
        panels.append(_panel(experiment, name, curves))
    swept = swept_in_words(experiment)
    title = f"{len(experiment.members)} members: {swept}"
    return plane(panels, columns=min(2, len(panels)), bar=swept if is_many else "", title=title)


def _loop(
    item: FinishedRun,
    name: str,
    *,
    label: str = "",
    by: float | None = None,
    look: Look | None = None,
) -> Curve:
    deformation, force = deformation_against(item, name)
    finite = np.isfinite(deformation) & np.isfinite(force)
    number = np.nan if by is None else by
    return Curve(x=deformation[finite], y=force[finite], label=label, by=number, look=look)


def _panel(experiment: Experiment, name: str, curves: Sequence[Curve]) -> Panel:
    return Panel(
        curves=curves,
        x=with_unit("deformation", experiment.units, "length"),
        y=with_unit(
            f"force {typeset_name(name)}" if name != "force" else name, experiment.units, name
        ),
        height=2.4,
    )
