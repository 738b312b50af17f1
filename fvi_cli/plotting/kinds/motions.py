"""Motions, energies, errors and balances over time."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.trajectory import Diagnostics
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import figure, lines
from fvi_cli.plotting.kinds.convergence import by_degree
from fvi_cli.plotting.kinds.members import (
    distinguish,
    member_curves,
    split_members,
    titles_of,
)
from fvi_cli.plotting.panels import Curve, NothingToDraw, Panel
from fvi_cli.plotting.style import BLACK, EXACT, method_looks, method_names
from fvi_cli.plotting.words import coordinates_of, position_label, time_label
from fvi_cli.reports.naming import with_unit
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members

MOST_COMPONENTS = 4
"""Most coordinates that are drawn, the first ones."""
MOST_MEMBERS = 100
"""Most members that are drawn over time, evenly chosen."""
AT_START = "every run failed at its start"
NO_MOMENTUM = "no method of the experiment has a momentum; write method: gauss3"
LEAST_POINTS = 600
"""Least points of a motion that is drawn."""
_PER_STEP, _MOST_POINTS = 20, 200_000

Motion = Callable[[FinishedRun], tuple[Array, Array]]


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


def _coordinate(index: int) -> Motion:
    def motion(item: FinishedRun) -> tuple[Array, Array]:
        times, position = drawn_motion(item)
        return times, position[:, index]

    return motion


def trajectory_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the position of every method; where an exact solution is known, the error below.

    There is a column for every degree, and a row for each of the first coordinates.
    """
    shown, exact, x = select_runs(finished), experiment.problem.exact, time_label(experiment)
    names = coordinates_of(experiment, shown[0].trajectory.position.shape[1])[:MOST_COMPONENTS]
    columns = []
    for title, own in _by_degree(experiment, shown).items():
        column = []
        for index, name in enumerate(names):
            curves = run_curves(own, _coordinate(index))
            if exact is not None:
                times = np.linspace(0.0, experiment.problem.final_time, LEAST_POINTS + 1)
                true = Curve(x=times, y=exact(times)[:, index], label="exact", look=EXACT)
                curves = [true, *curves]
            y = position_label(experiment, name)
            column.append(Panel(curves=curves, y=y, x=x, title=title))
            title = ""
        if exact is not None and len(names) == 1:
            curves = run_curves(own, lambda item: (_error(item)[0], _error(item)[1][:, 0]))
            y = with_unit("error $x_k-x(t_k)$", experiment.units, "length")
            column.append(Panel(curves=curves, x=x, y=y, levels=[0.0]))
        columns.append(column)
    height = 1.55 if len(columns[0]) > 1 else 2.0
    rows, is_wide = list(zip(*columns, strict=True)), len(columns) > 1
    return figure(rows, lines, height=height, is_wide=is_wide, sharex=True, sharey="row")


def _by_degree(
    experiment: Experiment, shown: Sequence[FinishedRun]
) -> dict[str, list[FinishedRun]]:
    """The runs of every degree, by the title of their panel with equal step sizes."""
    words = [""]
    if experiment.grading == 1.0 and experiment.accuracy is None:
        unit = experiment.units.get("time", "")
        words = [f"$h={shown[0].run.step_size:.4g}$ {unit}".rstrip()]
    return {
        ", ".join(filter(None, [f"degree {degree}" * bool(degree), *words])): own
        for degree, own in by_degree(shown).items()
    }


def _error(item: FinishedRun) -> tuple[Array, Array]:
    """Times, and position minus the exact one."""
    exact, trajectory = item.run.experiment.problem.exact, item.trajectory
    if exact is None:
        raise NothingToDraw("no exact solution is known; write exact: 1 - cos(t)")
    return trajectory.time, trajectory.position - exact(trajectory.time)


def energy_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the Hamiltonian without forcing; below the relative difference to the exact one."""
    shown = select_runs(finished, lambda item: item.trajectory.energy is not None, NO_MOMENTUM)
    true, curves = _exact_energy(experiment), run_curves(shown, _energy)
    y, x = with_unit("energy $H$", experiment.units, "energy"), time_label(experiment)
    (title,) = _by_degree(experiment, shown[:1])
    rows: list[list[Panel]] = []
    if true is not None:
        exact = Curve(x=true[0], y=true[1], label="exact", look=EXACT)
        relative = [replace(c, y=_size(c.y / np.interp(c.x, *true) - 1.0)) for c in curves]
        rows = [[Panel(curves=relative, y="$|H_k/H(t_k)-1|$", x=x, log="y")]]
        curves = [exact, *curves]
    rows.insert(0, [Panel(curves=curves, y=y, x=x, title=title)])
    return figure(rows, lines, height=1.6 if true is not None else 2.2, sharex=True)


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
    shown, x = select_runs(finished), time_label(experiment)

    def size(item: FinishedRun) -> tuple[Array, Array]:
        times, error = _error(item)
        return times, _size(np.abs(error).max(axis=1))

    several = shown[0].trajectory.position.shape[1] > 1
    words = r"error $\max_i\,|x_{i,k}-x_i(t_k)|$" if several else "error $|x_k-x(t_k)|$"
    y = with_unit(words, experiment.units, "length")
    panels = [
        Panel(curves=run_curves(own, size), x=x, y=y, title=title, log="y")
        for title, own in _by_degree(experiment, shown).items()
    ]
    return figure([panels], lines, height=2.2, is_wide=len(panels) > 1, sharey=True)


def balance_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw energy, works and their sum of the most accurate run, and the defect of every method.

    The work on dampers includes the energy that they store, so it may decrease.
    """
    reason = "it needs store: {diagnostics: [energy-balance]} and a method such as gauss3"
    shown = select_runs(finished, lambda item: item.trajectory.diagnostics is not None, reason)
    units, x, best = experiment.units, time_label(experiment), most_accurate(shown)
    found, scene = _diagnostics(best), best.run.scene
    position, velocity = scene.initial_position, scene.initial_velocity
    start = scene.energy(position, scene.momentum(position, velocity, 0.0), 0.0)
    total = start + found.energy_defect
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
    together, black = (
        "E+W_d-W_f" if np.any(found.forcing_work) else "E+W_d",
        replace(BLACK, width=1.6),
    )
    curves.append(Curve(x=found.time, y=total, label=f"${together}$", look=black))
    defects = run_curves(
        shown, lambda item: (_diagnostics(item).time, _size(_diagnostics(item).energy_defect))
    )
    if len(shown) == 1:
        defects = [replace(defects[0], label="")]
    upper = with_unit("energy, work", units, "energy")
    lower = with_unit(f"defect $|{together}-E_0|$", units, "energy")
    rows = [[Panel(curves=curves, y=upper, x=x)], [Panel(curves=defects, y=lower, x=x, log="y")]]
    return figure(rows, lines, height=(1.9, 1.3), sharex=True)


def _diagnostics(item: FinishedRun) -> Diagnostics:
    found = item.trajectory.diagnostics
    if found is None:
        raise NothingToDraw("the run has no energy balance")
    return found


def _size(values: Array) -> Array:
    """Sizes on a logarithmic axis; 0 is not drawn."""
    return np.where(values == 0, np.nan, np.abs(values))


def sweep_trajectory_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the first coordinate of members over time on the finest grid by the first method."""
    label = position_label(experiment, coordinates_of(experiment)[0])
    return members_over_time(experiment, finished, {label: _coordinate(0)})


def members_over_time(
    experiment: Experiment, finished: Sequence[FinishedRun], motions: Mapping[str, Motion]
) -> Figure:
    """Draw up to 100 members over time, evenly chosen, a row for each of `motions` by its label.

    Of several swept keys the one with few values has a column for each.
    """
    moving = finest_of_members([one for one in finished if one.trajectory.time.size > 1])
    if not moving:
        raise NothingToDraw(AT_START)
    shown = moving[:: -(-len(moving) // MOST_MEMBERS)]
    key, split = split_members(shown, experiment.units)
    found = distinguish(experiment.members, experiment.units, without=(key,))
    rows = [
        [
            Panel(
                curves=member_curves(found, [(item, *motion(item)) for item in own]),
                x=time_label(experiment),
                y=label,
                title="" if place else title,
            )
            for title, own in split.items()
        ]
        for place, (label, motion) in enumerate(motions.items())
    ]
    return figure(
        rows,
        lines,
        height=1.35 if len(rows) > 1 else 2.0,
        is_wide=len(split) > 1,
        sharex=True,
        sharey="row",
        **titles_of(found, len(shown), experiment.members),
    )


def run_curves(shown: Sequence[FinishedRun], motion: Motion) -> list[Curve]:
    """A curve over time for every run, by `motion`: its abscissas and ordinates."""
    methods = [item.run.method for item in shown]
    looks, names = method_looks(methods), method_names(methods)
    cases = [method.case for method in methods]
    pairs = [motion(item) for item in shown]
    return [
        Curve(x=x, y=y, label=names[case], look=replace(looks[case], marker=""))
        for case, (x, y) in zip(cases, pairs, strict=True)
    ]


def select_runs(
    finished: Sequence[FinishedRun],
    is_drawable: Callable[[FinishedRun], bool] = lambda item: True,
    reason: str = "",
) -> list[FinishedRun]:
    """One run for every method, on the finest steps with which most methods succeeded.

    Runs that failed or diverged are drawn where all did.
    """
    moving = [item for item in finished if item.trajectory.time.size > 1]
    usable = [item for item in moving if is_drawable(item)]
    if not usable:
        raise NothingToDraw(reason if moving else AT_START)
    able = [item for item in usable if item.status in ("ok", "floor")] or usable
    counts = Counter(item.run.n_steps for item in able)
    n_steps = max(counts, key=lambda n: (counts[n], n))
    return [item for item in able if item.run.n_steps == n_steps]


def most_accurate(shown: Sequence[FinishedRun]) -> FinishedRun:
    """The run with the smallest error; the last run if none has an error."""
    measured = [item for item in shown if math.isfinite(item.error)]
    return min(measured, key=lambda item: item.error) if measured else shown[-1]


def _exact_energy(experiment: Experiment) -> tuple[Array, Array] | None:
    """Time and energy of the exact solution; its velocity by differences on a fine grid."""
    problem = experiment.problem
    if not isinstance(problem, Problem) or problem.exact is None:
        return None
    if problem.scene.lagrangian is not None:
        return None
    time = np.linspace(0.0, problem.final_time, 8001)
    position = problem.exact(time)
    velocity = np.gradient(position, time[1], axis=0, edge_order=2)
    return time, problem.scene.energy(position, velocity @ problem.scene.inertia.mass.T)
