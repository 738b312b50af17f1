"""Planes of two quantities of a motion: sections at events, and the loops of dampers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.trajectory import Occurrences
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import figure, lines
from fvi_cli.plotting.kinds.members import distinguish
from fvi_cli.plotting.kinds.motions import MOST_COMPONENTS, most_accurate, select_runs
from fvi_cli.plotting.kinds.paths import planes
from fvi_cli.plotting.kinds.quantities import observed_of, quantity_label, with_quantities
from fvi_cli.plotting.panels import Curve, NothingToDraw, Panel
from fvi_cli.plotting.style import COLOURS, Look, cycled, dots, method_names
from fvi_cli.plotting.words import coordinates_of, position_label, velocity_label
from fvi_cli.reports.naming import with_unit
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.loops import deformation_against, forces_of, loops_of

_MANY = 200  # from this number on points are small


def occurrences_of(
    item: FinishedRun, name: str | None = None, after: float = 0.0
) -> Mapping[str, Occurrences]:
    """The events of a run (of one name) that happened, from a time on."""
    found = {}
    for event, one in observed_of(item).events.items():
        late = one.time >= after
        if name in (None, event) and late.any():
            seen = {key: values[late] for key, values in vars(one).items()}
            found[event] = Occurrences(**seen)
    return found


def section_figure(
    experiment: Experiment,
    finished: Sequence[FinishedRun],
    name: str | None = None,
    after: float = 0.0,
) -> Figure:
    """Draw velocity against position at every event, a panel for every coordinate (up to 4).

    For a sweep the first coordinate is shown. Of more than 6 members the left panel shows the
    position against the swept number (with several keys: the number of the member), and the right
    one velocity against position in the same colours.
    """
    having = [item for item in finished if occurrences_of(item, name, after)]
    if not having:
        when = f" after t = {after:g}" if after else ""
        raise NothingToDraw(
            f"the event {name} did not happen{when}" if name else "no event happened"
        )
    names = coordinates_of(experiment)
    if experiment.members:
        shown, names = finest_of_members(having), names[:1]
        distinction = distinguish(experiment.members, experiment.units)
        of_run = [distinction.of(item.run.member) for item in shown]
    else:
        shown, distinction = select_runs(having), None
        methods = method_names([item.run.method for item in shown])
        of_run = [{"label": methods[item.run.method.case]} for item in shown]
    points = [
        (one, _named(own, event, is_alone=len(shown) == 1))
        for item, own in zip(shown, of_run, strict=True)
        for event, one in occurrences_of(item, name, after).items()
    ]
    size = 1.9 if sum(one.time.size for one, _ in points) > _MANY else 3.4
    panels = [
        Panel(
            curves=[
                Curve(
                    x=one.position[:, k],
                    y=one.velocity[:, k],
                    look=dots(cycled(number).colour, size),
                    **words,
                )
                for number, (one, words) in enumerate(points)
            ],
            x=position_label(experiment, coordinate),
            y=velocity_label(experiment, coordinate),
        )
        for k, coordinate in enumerate(names[:MOST_COMPONENTS])
    ]
    if distinction is None or distinction.names:
        return planes(panels)
    (section,) = panels
    against = [
        Curve(x=np.full(curve.x.size, curve.by), y=curve.x, by=curve.by, look=curve.look)
        for curve in section.curves
    ]
    left = Panel(curves=against, x=distinction.titles["bar"], y=section.x)
    return figure([[left, section]], lines, height=2.6, is_wide=True, **distinction.titles)


def _named(words: Mapping[str, Any], event: str, *, is_alone: bool) -> dict[str, Any]:
    """The words of a curve with the name of its event."""
    if "label" not in words:
        return dict(words)
    return {"label": event if is_alone else f"{event}, {words['label']}"}


def hysteresis_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw force against deformation, a panel for every force (up to 4) among the quantities.

    It shows the most accurate run with its loops; for a sweep the members by the first method.
    """
    if not (forces := forces_of(experiment)):
        raise NothingToDraw(
            "no quantity is the force of a damper; write quantities: {force: force_1}"
        )
    having, titles = with_quantities(finished), {}
    if experiment.members:
        distinction = distinguish(experiment.members, experiment.units)
        titles = distinction.titles
    panels = []
    for name in forces[:MOST_COMPONENTS]:
        if experiment.members:
            pairs = [(item, *deformation_against(item, name)) for item in finest_of_members(having)]
            curves = [Curve(x=x, y=y, **distinction.of(one.run.member)) for one, x, y in pairs]
        else:
            best = most_accurate(select_runs(having))
            curves = _loops(best.trajectory.time, *deformation_against(best, name))
        x = with_unit("deformation", experiment.units, "length")
        panels.append(Panel(curves=curves, x=x, y=quantity_label(experiment, name)))
    return planes(panels, **titles)


def _loops(time: Array, x: Array, y: Array) -> list[Curve]:
    """The whole motion, and above it the loops that the table of quantities reports."""
    curves = [Curve(x=x, y=y, label="whole motion", look=Look(colour="#9a9a9a", width=0.7))]
    for place, (word, loop) in enumerate(loops_of(time, x, y).items()):
        inside = time[(time > loop.begin) & (time < loop.end)]
        whole = np.array([loop.begin, *inside, loop.end])
        look = Look(colour=COLOURS[1 - place], width=1.6)
        places = [np.interp(whole, time, values) for values in (x, y)]
        curves.append(Curve(x=places[0], y=places[1], label=f"{word} loop", look=look))
    return curves
