"""Motions, energies, errors and balances over time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.draw import calm_limits, figure, lines
from fvi_cli.plotting.kinds.convergence import by_degree
from fvi_cli.plotting.kinds.members import bar_of, member_curves, members_title, split_members
from fvi_cli.plotting.looks import BLACK, EXACT, method_looks, method_names
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.words import coordinates_of, position_label, step_words, time_label
from fvi_cli.reports.naming import with_unit
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members

MOST_COMPONENTS = 4
"""Most coordinates that are drawn, the first ones."""
LEAST_POINTS = 600
"""Least points of a motion that is drawn."""
_PER_STEP, _MOST_POINTS = 20, 200_000
_MARKED = 65  # up to so many points have a mark

Motion = Callable[[FinishedRun], tuple[Array, Array]]


def drawn_times(item: FinishedRun) -> Array:
    """Times at which a motion is drawn: the points of its mesh, and some in every step.

    Where the steps were not kept, the reported times.
    """
    steps = item.trajectory.steps
    if steps is None:
        return item.trajectory.time
    count = max(_PER_STEP, -(-LEAST_POINTS // steps.n_steps))
    count = max(1, min(count, _MOST_POINTS // steps.n_steps))
    inside = steps.time[:-1, None] + np.diff(steps.time)[:, None] * np.arange(count) / count
    return np.append(inside.ravel(), steps.time[-1])


def drawn_motion(item: FinishedRun) -> tuple[Array, Array]:
    """Times and positions by the polynomials of the steps, ``(n,)`` and ``(n, d)``."""
    trajectory, times = item.trajectory, drawn_times(item)
    return times, trajectory.position if trajectory.steps is None else trajectory(times)


def drawn_velocity(item: FinishedRun) -> Array:
    """Velocities at :func:`drawn_times`, ``(n, d)``; without steps those of the momenta."""
    trajectory, scene = item.trajectory, item.run.problem.scene
    if trajectory.steps is not None:
        return trajectory.velocity(drawn_times(item))
    if trajectory.momentum is None or scene is None:
        raise ValueError("velocity: the run has no steps and no momentum")
    return scene.velocity(trajectory.position, trajectory.momentum, trajectory.time)


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
            limits = calm_limits(curves)
            if exact is not None:
                times = np.linspace(0.0, experiment.problem.final_time, LEAST_POINTS + 1)
                true = Curve(x=times, y=exact(times)[:, index], label="exact", look=EXACT)
                curves, limits = [true, *curves], calm_limits([true, *curves])
            y = position_label(experiment, name)
            column.append(Panel(curves=curves, y=y, x=x, title=title, ylim=limits))
            title = ""
        if exact is not None and len(names) == 1:
            column.append(_differences(experiment, own))
        columns.append(column)
    height = 1.55 if len(columns[0]) > 1 else 2.0
    rows, is_wide = list(zip(*columns, strict=True)), len(columns) > 1
    return figure(rows, lines, height=height, is_wide=is_wide, sharex=True, sharey="row")


def _by_degree(
    experiment: Experiment, shown: Sequence[FinishedRun]
) -> dict[str, list[FinishedRun]]:
    """The runs of every degree, by the title of their panel."""
    step = step_words(experiment, shown)
    return {
        ", ".join(filter(None, (f"degree {degree}" * bool(degree), step))): own
        for degree, own in by_degree(shown).items()
    }


def _error(item: FinishedRun) -> tuple[Array, Array]:
    """Times, and position minus the exact one."""
    exact, trajectory = item.run.experiment.problem.exact, item.trajectory
    if exact is None:
        raise ValueError("error: no exact solution is known")
    return trajectory.time, trajectory.position - exact(trajectory.time)


def _differences(experiment: Experiment, shown: Sequence[FinishedRun]) -> Panel:
    """Errors of the first coordinate, with marks at the points of the mesh if these are few."""
    curves = run_curves(shown, lambda item: (_error(item)[0], _error(item)[1][:, 0]), marked=True)
    y = with_unit("error $x_k - x(t_k)$", experiment.units, "length")
    limits = calm_limits(curves)
    return Panel(curves=curves, x=time_label(experiment), y=y, levels=[0.0], ylim=limits)


def energy_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the Hamiltonian without forcing; below the relative difference to the exact one."""
    shown, true = select_runs(finished, has_momentum), _exact_energy(experiment)
    curves = run_curves(shown, _energy)
    y, x = with_unit("energy $H$", experiment.units, "energy"), time_label(experiment)
    rows: list[list[Panel]] = []
    if true is not None:
        differences = [replace(c, y=c.y / np.interp(c.x, *true) - 1.0) for c in curves]
        words = "$H_k / H(t_k) - 1$"
        rows = [[Panel(curves=differences, y=words, x=x, levels=[0.0], ylim=(-1.0, 2.0))]]
        curves = [Curve(x=true[0], y=true[1], label="exact", look=EXACT), *curves]
    title, limits = step_words(experiment, shown), calm_limits(curves)
    rows.insert(0, [Panel(curves=curves, y=y, x=x, title=title, ylim=limits)])
    return figure(rows, lines, height=1.6 if true is not None else 2.2, sharex=True)


def _energy(item: FinishedRun) -> tuple[Array, Array]:
    """Times and the energy; of runs for a tolerance, whose steps are long, also within them."""
    trajectory, scene = item.trajectory, item.run.problem.scene
    if trajectory.steps is not None and item.run.is_search and scene is not None:
        times, position = drawn_motion(item)
        momentum = scene.momentum(position, drawn_velocity(item), times)
        return times, scene.energy(position, momentum, times)
    energy = trajectory.energy
    return trajectory.time, np.zeros(0) if energy is None else energy


def error_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the largest absolute error of all components over time, logarithmically."""
    shown, x = select_runs(finished), time_label(experiment)

    def size(item: FinishedRun) -> tuple[Array, Array]:
        times, error = _error(item)
        return times, _positive(np.abs(error).max(axis=1))

    several = shown[0].trajectory.position.shape[1] > 1
    words = r"error $\max_i\,|x_{i,k} - x_i(t_k)|$" if several else "error $|x_k - x(t_k)|$"
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
    shown, units, x = select_runs(finished, has_balance), experiment.units, time_label(experiment)
    best = most_accurate(shown)
    found, scene = best.trajectory.diagnostics, best.run.scene
    if found is None:
        raise ValueError("balance: the run has none")  # pragma: no cover - chosen above
    position, velocity = scene.initial_position, scene.initial_velocity
    start = scene.energy(position, scene.momentum(position, velocity, 0.0), 0.0)
    energy = start + found.energy_defect - found.dissipated_work + found.forcing_work
    parts = {
        "energy $E$": energy,
        "work on dampers $W_d$": found.dissipated_work,
        "stored part of $W_d$": found.stored_energy,
        "work of forcing $W_f$": found.forcing_work,
    }
    together = "$E + W_d - W_f$" if np.any(found.forcing_work) else "$E + W_d$"
    curves = [
        Curve(x=found.time, y=values, label=label)
        for label, values in parts.items()
        if values is not None and np.any(values)
    ]
    total, black = start + found.energy_defect, replace(BLACK, width=1.6)
    curves.append(Curve(x=found.time, y=total, label=together, look=black))
    defects = run_curves(shown, _defect)
    if len(shown) == 1:
        defects = [replace(defects[0], label="")]
    upper = with_unit("energy, work", units, "energy")
    lower = with_unit(f"defect $|{together.strip('$')} - E_0|$", units, "energy")
    rows = [[Panel(curves=curves, y=upper, x=x)], [Panel(curves=defects, y=lower, x=x, log="y")]]
    return figure(rows, lines, height=(1.9, 1.3), sharex=True)


def _defect(item: FinishedRun) -> tuple[Array, Array]:
    found = item.trajectory.diagnostics
    empty = np.zeros(0)
    return (empty, empty) if found is None else (found.time, _positive(np.abs(found.energy_defect)))


def _positive(values: Array) -> Array:
    return np.where(values > 0, values, np.nan)


def sweep_trajectory_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the first coordinate of members over time on the finest grid by the first method."""
    shown = finest_of_members([one for one in finished if one.trajectory.time.size > 1])
    label = position_label(experiment, coordinates_of(experiment)[0])
    return members_over_time(experiment, shown, {label: _coordinate(0)})


def members_over_time(
    experiment: Experiment, shown: Sequence[FinishedRun], motions: Mapping[str, Motion]
) -> Figure:
    """Draw members over time, a row for each of `motions` with its label.

    Of several swept keys the one with few values has a column for each.
    """
    split, x = split_members(experiment, shown), time_label(experiment)
    rows: list[list[Panel]] = []
    for label, motion in motions.items():
        row = []
        for title, own in split.items():
            curves = member_curves(experiment, [(item, *motion(item)) for item in own])
            limits = calm_limits(curves)
            words = title if not rows else ""
            row.append(Panel(curves=curves, x=x, y=label, title=words, ylim=limits))
        rows.append(row)
    return figure(
        rows,
        lines,
        height=1.35 if len(rows) > 1 else 2.0,
        is_wide=len(split) > 1,
        sharex=True,
        sharey="row",
        legend="below",
        bar=bar_of(experiment, max(map(len, split.values()))),
        heading=members_title(experiment),
    )


def run_curves(
    shown: Sequence[FinishedRun], motion: Motion, *, marked: bool = False
) -> list[Curve]:
    """A curve over time for every run, by `motion`: its abscissas and ordinates."""
    methods = [item.run.method for item in shown]
    looks, names, curves = method_looks(methods), method_names(methods), []
    for item in shown:
        x, y = motion(item)
        look = looks[item.run.method.case]
        if not (marked and x.size <= _MARKED):
            look = replace(look, marker="")
        finite = np.where(np.isfinite(y), y, np.nan)
        curves.append(Curve(x=x, y=finite, label=names[item.run.method.case], look=look))
    return curves


def has_momentum(item: FinishedRun) -> bool:
    """Whether the method of a run has a momentum, and so an energy."""
    return item.trajectory.momentum is not None and item.trajectory.energy is not None


def has_balance(item: FinishedRun) -> bool:
    """Whether a run was stored with its energy balance."""
    return item.trajectory.diagnostics is not None


def select_runs(
    finished: Sequence[FinishedRun], is_drawable: Callable[[FinishedRun], bool] = lambda item: True
) -> list[FinishedRun]:
    """One run for every method, on the finest steps with which most methods succeeded."""
    usable = [item for item in finished if is_drawable(item) and item.trajectory.time.size > 1]
    if not usable:
        raise ValueError("no run has what is drawn")
    reached = [item.run.n_steps for item in usable if item.status in ("ok", "floor")]
    n_steps = max((item.run.n_steps for item in usable), key=lambda n: (reached.count(n), n))
    return [item for item in usable if item.run.n_steps == n_steps]


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
