"""Motions, energies, errors, balances and quantities over time."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.observe.observer import observe_runs
from fvi_cli.integrator.trajectory import Diagnostics, Observed
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import figure, lines
from fvi_cli.plotting.kinds.runs import Motion, Shown, select
from fvi_cli.plotting.panels import Curve, NothingToDraw, Panel
from fvi_cli.plotting.style import EXACT, INK, Look
from fvi_cli.plotting.words import coordinates_of, number_in_words, position_label, time_label
from fvi_cli.reports.naming import with_unit
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.loops import forces_of

MOST_COMPONENTS = 4
"""Most coordinates that are drawn, the first ones."""
LEAST_POINTS = 600
"""Least points of a motion that is drawn."""
NO_MOMENTUM = "no method of the experiment has a momentum; write method: gauss3"
NO_QUANTITIES = "there are none; write quantities: {drift: x2 - x1}"
_PER_STEP, _MOST_POINTS = 20, 200_000
_MOST_PANELS = 8  # of quantities, the first ones


def drawn_times(item: FinishedRun) -> Array:
    """Times at which a motion is drawn: at least 20 in every step, and 600 in all."""
    steps = item.trajectory.steps
    points = item.trajectory.time if steps is None else steps.time
    count = max(_PER_STEP, -(-LEAST_POINTS // (points.size - 1)))
    count = max(1, min(count, _MOST_POINTS // (points.size - 1)))
    inside = points[:-1, None] + np.diff(points)[:, None] * np.arange(count) / count
    return np.append(inside.ravel(), points[-1])


def _polynomials(item: FinishedRun) -> tuple[Callable[[Array], Array], ...] | None:
    """Position and velocity as functions of time: the polynomials of the steps of a run.

    Where these were not kept, cubic ones through the stored points with the velocities there. None
    where velocities are not known, or jump.
    """
    trajectory = item.trajectory
    if trajectory.steps is not None:
        return trajectory, trajectory.velocity
    time, position, momentum = trajectory.time, trajectory.position, trajectory.momentum
    has_impacts = bool(item.run.experiment.observations.impacts)
    if momentum is None or has_impacts or not np.isfinite(momentum).all():
        return None
    from scipy.interpolate import CubicHermiteSpline  # slow to import

    cubic = CubicHermiteSpline(time, position, item.run.scene.velocity(position, momentum, time))
    return cubic, cubic.derivative()


def drawn_motion(item: FinishedRun) -> tuple[Array, Array]:
    """Times and positions of what is drawn, ``(n,)`` and ``(n, d)``; else the stored points."""
    found, times = _polynomials(item), drawn_times(item)
    if found is None:
        return item.trajectory.time, item.trajectory.position
    return times, found[0](times)


def drawn_velocity(item: FinishedRun) -> Array:
    """Velocities at :func:`drawn_times`, ``(n, d)``."""
    found = _polynomials(item)
    if found is None:
        raise NothingToDraw(NO_MOMENTUM)
    return found[1](drawn_times(item))


def over_time(
    experiment: Experiment, shown: Shown, motions: Mapping[str, Motion], **options: Any
) -> list[Panel]:
    """Panels of runs over time: a row for each of `motions` with its label, in columns."""
    x = time_label(experiment)
    return [
        Panel(curves=shown.curves(motion, own), x=x, y=label, **options)
        for label, motion in motions.items()
        for own in shown.columns.values()
    ]


def figure_over_time(panels: Sequence[Panel], shown: Shown) -> Figure:
    """The figure of panels over time, with titles above."""
    columns = len(shown.columns)
    names = shown.columns if columns > 1 else [shown.title]
    top = [replace(one, title=title) for one, title in zip(panels, names, strict=False)]
    height = max(1.15, 2.4 - 0.4 * len(panels) / columns)
    titles = {"columns": columns, "height": height, "sharey": "row", **shown.titles}
    return figure([*top, *panels[columns:]], lines, sharex=True, **titles)


def trajectory_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the position of every method or member, a row for each of the first coordinates.

    Where the exact solution of one scene is known, it is shown too, and the error below.
    """
    shown, exact = select(experiment, finished, in_columns=True), experiment.problem.exact
    dimension = shown.best.trajectory.position.shape[1]
    names = coordinates_of(experiment, dimension)[:MOST_COMPONENTS]
    motions = {
        position_label(experiment, name): functools.partial(_coordinate, index=index)
        for index, name in enumerate(names)
    }
    panels = over_time(experiment, shown, motions)
    if exact is not None and not experiment.members:
        times = np.linspace(0.0, experiment.problem.final_time, LEAST_POINTS + 1)
        for place, panel in enumerate(panels):
            values = exact(times)[:, place // len(shown.columns)]
            true = Curve(x=times, y=values, label="exact", look=EXACT)
            panels[place] = replace(panel, curves=[true, *panel.curves])
        if len(names) == 1:
            label = with_unit("error $x_k-x(t_k)$", experiment.units, "length")
            below = {label: lambda item: (item.trajectory.time, _error(item)[:, 0])}
            panels += over_time(experiment, shown, below, levels=[0.0])
    return figure_over_time(panels, shown)


def _coordinate(item: FinishedRun, index: int) -> tuple[Array, Array]:
    times, position = drawn_motion(item)
    return times, position[:, index]


def _error(item: FinishedRun) -> Array:
    """Position minus the exact one."""
    exact, trajectory = item.run.problem.exact, item.trajectory
    if exact is None:
        raise NothingToDraw("no exact solution is known; write exact: 1 - cos(t)")
    return np.asarray(trajectory.position - exact(trajectory.time))


def energy_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the Hamiltonian without forcing; below the difference to the exact one."""
    usable = {one for one in finished if one.trajectory.energy is not None}
    shown = select(experiment, finished, usable.__contains__, NO_MOMENTUM, in_columns=True)
    label = with_unit("energy $H$", experiment.units, "energy")
    panels = over_time(experiment, shown, {label: _energy})
    true = None if experiment.members else _exact_energy(experiment)
    if true is not None:

        def difference(item: FinishedRun) -> tuple[Array, Array]:
            times, energy = _energy(item)
            return times, energy - np.interp(times, *true)

        exact = Curve(x=true[0], y=true[1], label="exact", look=EXACT)
        panels = [replace(panel, curves=[exact, *panel.curves]) for panel in panels]
        words = with_unit("$H_k-H(t_k)$", experiment.units, "energy")
        panels += over_time(experiment, shown, {words: difference}, levels=[0.0])
    return figure_over_time(panels, shown)


def _energy(item: FinishedRun) -> tuple[Array, Array]:
    """Times and the energy; of runs for a tolerance, whose steps are long, also within them."""
    trajectory = item.trajectory
    if trajectory.steps is not None and item.run.is_search:
        (times, position), scene = drawn_motion(item), item.run.scene
        momentum = scene.momentum(position, drawn_velocity(item), times)
        return times, scene.energy(position, momentum, times)
    return trajectory.time, np.zeros(0) if trajectory.energy is None else trajectory.energy


def error_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the largest absolute error of all components over time, logarithmically."""
    shown = select(experiment, finished, in_columns=True)
    several = shown.best.trajectory.position.shape[1] > 1
    words = r"error $\max_i\,|x_{i,k}-x_i(t_k)|$" if several else "error $|x_k-x(t_k)|$"

    def size(item: FinishedRun) -> tuple[Array, Array]:
        error = np.abs(_error(item)).max(axis=1)
        return item.trajectory.time, np.where(error == 0, np.nan, error)

    label = with_unit(words, experiment.units, "length")
    return figure_over_time(over_time(experiment, shown, {label: size}, log="y"), shown)


def balance_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw energy, works and their sum of the most accurate run, and the defect of every run.

    The work on dampers includes the energy that they store, so it may decrease.
    """
    reason = "it needs store: {diagnostics: [energy-balance]} and a method such as gauss3"
    shown = select(experiment, finished, lambda item: item.trajectory.diagnostics, reason)
    units, x = experiment.units, time_label(experiment)
    found, scene = _diagnostics(shown.best), shown.best.run.scene
    position, velocity = scene.initial_position, scene.initial_velocity
    start = scene.energy(position, scene.momentum(position, velocity, 0.0), 0.0)
    total = start + found.energy_defect
    together = "E+W_d-W_f" if np.any(found.forcing_work) else "E+W_d"
    parts = {
        "energy $E$": total - found.dissipated_work + found.forcing_work,
        "work on dampers $W_d$": found.dissipated_work,
        "stored part of $W_d$": found.stored_energy,
        "work of forcing $W_f$": found.forcing_work,
    }
    curves = [
        Curve(x=found.time, y=values, label=label)
        for label, values in parts.items()
        if values is not None and np.any(values)
    ]
    look = Look(colour=INK, dashes=":", width=1.6)
    curves.append(Curve(x=found.time, y=total, label=f"${together}$", look=look))

    def defect(item: FinishedRun) -> tuple[Array, Array]:
        return _diagnostics(item).time, _diagnostics(item).energy_defect

    is_one, defects = len(shown.runs) == 1, shown.curves(defect)
    defects = [replace(one, label="" if is_one else one.label) for one in defects]
    upper = with_unit("energy, work", units, "energy")
    lower = with_unit(f"${together}-E_0$", units, "energy")
    below = Panel(curves=defects, y=lower, x=x, levels=[0.0])
    panels = [Panel(curves=curves, y=upper, x=x, title=shown.title), below]
    return figure(panels, lines, height=(1.9, 1.3), sharex=True)


def _diagnostics(item: FinishedRun) -> Diagnostics:
    found = item.trajectory.diagnostics
    if found is None:
        raise NothingToDraw("the run has no energy balance")
    return found


def _exact_energy(experiment: Experiment) -> tuple[Array, Array] | None:
    """Time and energy of the exact solution; its velocity by differences on a fine grid."""
    problem = experiment.problem
    if not isinstance(problem, Problem) or problem.exact is None:
        return None
    time = np.linspace(0.0, problem.final_time, 8001)
    position, scene = problem.exact(time), problem.scene
    velocity = np.gradient(position, time[1], axis=0, edge_order=2)
    return time, scene.energy(position, scene.momentum(position, velocity, time), time)


def quantities_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the quantities over time, without a sweep with the largest peak of every panel.

    Of one run, those of one kind (drift_1, drift_3) share a panel.
    """
    shown = select(experiment, finished, has_quantities, NO_QUANTITIES, in_columns=True)
    groups: dict[str, list[str]] = {}
    stems = {name: re.sub(r"_\d+$", "", name) for name in observed_of(shown.best).extents}
    for name, stem in stems.items():
        together = len(shown.runs) == 1 and list(stems.values()).count(stem) > 1
        label = quantity_label(experiment, name, is_group=together)
        groups.setdefault(label, []).append(name)
    panels = []
    for label, names in list(groups.items())[:_MOST_PANELS]:
        for runs in shown.columns.values():
            motions = [functools.partial(_quantity, name=name) for name in names]
            curves = [one for motion in motions for one in shown.curves(motion, runs)]
            if len(shown.runs) == 1:
                words = [_in_words(experiment, name) * (len(names) > 1) for name in names]
                pairs = zip(curves, words, strict=True)
                curves = [replace(one, label=word, look=None) for one, word in pairs]
            if not experiment.members:
                peaks = [_peak(item, name) for name in names for item in runs]
                place = max(range(len(peaks)), key=lambda k: abs(peaks[k][1]))
                curves[place] = replace(curves[place], marks=[peaks[place]])
            x = time_label(experiment)
            panels.append(Panel(curves=curves, x=x, y=label, levels=[0.0]))
    return figure_over_time(panels, shown)


def _peak(item: FinishedRun, name: str) -> tuple[float, float, str]:
    """The peak of a quantity with its number."""
    one = observed_of(item).extents[name]
    height = one.greatest if one.greatest == one.peak else one.least
    return one.peak_time, height, number_in_words(height)


def quantity_label(experiment: Experiment, name: str, *, is_group: bool = False) -> str:
    """The label of an axis of a quantity, or of those of its kind."""
    kinds = (name, "force") if name in forces_of(experiment) else (name,)
    words = _in_words(experiment, name)
    words = re.sub(r"( of storey| of damper)? \d+$", "", words) if is_group else words
    return with_unit(words, experiment.units, *kinds)


def _in_words(experiment: Experiment, name: str) -> str:
    """``drift of storey 3`` for drift_3, ``force of wall 1`` for force_wall_1 of those ready."""
    texts = experiment.observations.quantities or {}
    if name in experiment.problem.ready:
        name = re.sub(r"^(drift|acceleration)_(?=\d)", r"\1 of storey ", name)
    if name in forces_of(experiment) and texts[name].text.strip() == name:
        name = re.sub("^force_", "force of ", re.sub(r"^force_(?=\d)", "force of damper ", name))
    return name.replace("_", " ")


def _quantity(item: FinishedRun, name: str) -> tuple[Array, Array]:
    dense = within_steps(item)
    return dense.trajectory.time, observed_of(dense).quantities[name]


@functools.lru_cache(maxsize=16)
def within_steps(item: FinishedRun) -> FinishedRun:
    """The run at the times at which it is drawn, where its steps were kept and few are reported."""
    trajectory = item.trajectory
    if trajectory.steps is None or trajectory.time.size >= LEAST_POINTS:
        return item
    request = replace(item.run.observations, times=drawn_times(item), events={}, impacts={})
    (dense,) = observe_runs([item.run.scene], item.run.method, [trajectory], [request])
    return replace(item, trajectory=dense)


def has_quantities(item: FinishedRun) -> bool:
    """Whether quantities were requested of a run."""
    return bool(observed_of(item).quantities)


def observed_of(item: FinishedRun) -> Observed:
    """The quantities and events of a run; empty if none were requested."""
    observed = item.trajectory.observed
    return Observed(mesh=item.trajectory.time) if observed is None else observed
