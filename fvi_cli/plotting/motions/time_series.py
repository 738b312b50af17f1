"""Solutions, energies, errors, quantities and balances over time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.integrator.trajectory import Diagnostics, Extent, Observed
from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.ladders.convergence import bar_of, member_curve, members_title
from fvi_cli.plotting.looks import EXACT, Look, method_looks
from fvi_cli.plotting.panels import MOST_LINES, over_time
from fvi_cli.plotting.style import COLOURS, INK, LINE_STYLES
from fvi_cli.plotting.words import (
    coordinates_of,
    in_formula,
    quantity_in_words,
    time_label,
    typeset_name,
)
from fvi_cli.reports.naming import unit_of, with_unit
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.loops import forces_of
from fvi_cli.studies.reference import reference_of

_FINE_POINTS = 2001
MOST_COMPONENTS = 4
"""Most coordinates that are drawn, the first ones."""
_VISIBLE = 0.1  # least visible error, as a share of the largest position
_STEEP = 0.05  # an energy that falls below this share within a third of the time is logarithmic
_EPSILON = float(np.finfo(float).eps)
MOST_PANELS = 8
"""Most quantities that are drawn, the first ones."""


def trajectory_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the position of every method and the exact one, a panel for each component (up to 4)."""
    shown = select_runs(finished, only_distinct=True)
    names = coordinates_of(experiment, shown[0].trajectory.position.shape[1])
    exact, panels = experiment.problem.exact, []
    time = np.linspace(0.0, experiment.problem.final_time, _FINE_POINTS)
    for component, name in enumerate(names[:MOST_COMPONENTS]):
        columns = [item.trajectory.position[:, component] for item in shown]
        true = None if exact is None else (time, exact(time)[:, component])
        panels.append(
            Panel(
                y=_position_label(experiment, name),
                curves=run_curves(shown, columns, exact=true),
                height=2.0 if len(names) == 1 else 1.45,
                may_run_away=True,
            )
        )
    return _figure(experiment, shown, panels)


def energy_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the Hamiltonian without forcing of every method that has a momentum.

    The axis is logarithmic if the energy soon falls to a small share.
    """
    shown = select_runs(finished, has_momentum, only_distinct=True)
    columns = [item.trajectory.energy for item in shown if item.trajectory.energy is not None]
    first = columns[0]
    is_steep = bool(np.all(first > 0) and first[first.size // 3] < _STEEP * first.max())
    panel = Panel(
        y=with_unit("energy $H(x, p)$", experiment.units, "energy"),
        curves=run_curves(shown, columns, exact=exact_energy(experiment)),
        may_run_away=True,
        is_log=is_steep and all(np.all(values > 0) for values in columns),
    )
    return _figure(experiment, shown, [panel])


def error_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the largest absolute error of all components over time, logarithmically.

    If no exact solution is known, the error is measured against the refined run.
    """
    shown = select_runs(finished)
    reference, columns = reference_of(shown[0].run), []
    for item in shown:
        trajectory = item.trajectory
        with np.errstate(over="ignore", invalid="ignore"):
            error = np.abs(trajectory.position - reference.values(trajectory.time)).max(axis=1)
        columns.append(error)
    several = shown[0].trajectory.position.shape[1] > 1
    label = r"error $\max_i\,|x_i - x_i(t)|$" if several else "error $|x_k - x(t_k)|$"
    if experiment.problem.exact is None:
        label = "error against a refined run"
    curves = run_curves(shown, columns, floors=[item.floor for item in shown])
    label = with_unit(label, experiment.units, "length")
    return _figure(experiment, shown, [Panel(y=label, curves=curves, is_log=True)])


def quantities_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the first 8 quantities over time, a panel for each, with the last method's peak.

    For a sweep the first method is shown on the
    finest grid, and lines that belong to a single member have marks at their peaks.
    """
    is_sweep, remark = bool(experiment.members), ""
    if is_sweep:
        shown = finest_of_members([one for one in finished if has_quantities(one)])
        peaked = [] if len(shown) > MOST_LINES else shown
    else:
        shown = select_runs(finished, has_quantities)
        peaked = shown[-1:]
    every = list(observed_of(shown[0]).quantities)
    is_whole = len(every) <= MOST_PANELS
    more = "" if is_whole else f"the first {MOST_PANELS} of {len(every)} quantities"
    names = every[:MOST_PANELS]
    forces = forces_of(experiment)
    panels = []
    for name in names:
        columns = [observed_of(item).quantities[name] for item in shown]
        kinds = (name, "force") if name in forces else (name,)
        if is_sweep:
            pairs = zip(shown, columns, strict=True)
            curves = [member_curve(one, one.trajectory.time, values) for one, values in pairs]
        else:
            curves = run_curves(shown, columns)
            extent = observed_of(shown[-1]).extents[name]
            height, unit = in_formula(_height(extent), 4), unit_of(experiment.units, *kinds)
            size = f"${height}$ {unit}".rstrip()
            when = f"$t = {extent.peak_time:.4g}$ {experiment.units.get('time', '')}".rstrip()
            remark = f"peak {size} at {when}" * (extent.peak > 0)
        for place in range(len(shown) - len(peaked), len(shown)):
            extent = observed_of(shown[place]).extents[name]
            peak = (extent.peak_time, _height(extent))
            # a quantity that is always 0 has no peak, such as the force of an absent damper
            if extent.peak > 0:
                curves[place] = replace(curves[place], peaks=[peak])
        panels.append(
            Panel(
                y=with_unit(quantity_in_words(experiment, name), experiment.units, *kinds),
                curves=curves,
                remark=remark,
                height=1.15 if len(names) <= 3 else 0.9,
                may_run_away=True,
            )
        )
    return _figure(experiment, shown, panels, title=more, is_sweep=is_sweep)


def balance_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw energy, works and their sum of the most accurate run, and the defect of every method.

    The work on dampers includes the energy that they store, so it may decrease.
    """
    shown = select_runs(finished, has_balance)
    best = most_accurate(shown)
    found, scene = _diagnostics(best), best.run.scene
    position, velocity = scene.initial_position, scene.initial_velocity
    start = scene.energy(position, scene.momentum(position, velocity, 0.0), 0.0)
    energy = start + found.energy_defect - found.dissipated_work + found.forcing_work
    parts = {"energy $E$": energy, "work on dampers $W_d$": found.dissipated_work}
    together = "$E + W_d$"
    if np.any(found.forcing_work):
        parts["work of forcing $W_f$"] = found.forcing_work
        together = "$E + W_d - W_f$"
    if found.stored_energy is not None and np.any(found.stored_energy):
        parts["stored part $E_s$ of $W_d$"] = found.stored_energy
    parts[together] = energy + found.dissipated_work - found.forcing_work
    defects = [np.abs(_diagnostics(item).energy_defect) for item in shown]
    times = [_diagnostics(item).time for item in shown]
    scale = max(float(max(np.abs(values).max() for values in parts.values())), 1e-300)
    dashes = [*LINE_STYLES[:3], *LINE_STYLES[4:]]
    curves = []
    for index, (label, values) in enumerate(parts.items()):
        look = Look(colour=COLOURS[index % len(COLOURS)], dashes=dashes[index % len(dashes)])
        if index == len(parts) - 1:
            look = Look(colour=INK, dashes=LINE_STYLES[3], width=1.6)
        curves.append(Curve(x=found.time, y=values, label=label, look=look))
    rounding = _EPSILON * scale * math.sqrt(best.run.n_steps)
    upper = with_unit("energy, work", experiment.units, "energy")
    lower = with_unit(f"defect $|{together.strip('$')} - E_0|$", experiment.units, "energy")
    panels = [
        Panel(y=upper, curves=curves, height=1.7),
        Panel(
            y=lower,
            curves=run_curves(shown, defects, times=times),
            height=1.2,
            is_log=True,
            rounding=rounding,
        ),
    ]
    return _figure(experiment, [best], panels)


def sweep_trajectory_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    """Draw the first coordinate of members over time on the finest grid, a panel per method.

    Runs for a tolerance share a panel, since each has its own method and grid.
    """
    moving = [one for one in finished if one.trajectory.time.size > 1]
    looks = method_looks([one.run.method for one in moving])
    names = {"": ""} if experiment.accuracy else {case: one.label for case, one in looks.items()}
    panels = [
        Panel(
            title=label if len(names) > 1 else "",
            y=_position_label(experiment, coordinates_of(experiment)[0]),
            is_ensemble=True,
            height=2.0 if len(names) == 1 else 1.7,
            curves=[
                member_curve(one, one.trajectory.time, one.trajectory.position[:, 0])
                for one in finest_of_members([o for o in moving if case in ("", o.run.method.case)])
            ],
        )
        for case, label in names.items()
    ]
    return _figure(experiment, (), panels, is_sweep=True, columns=min(2, len(panels)))


def _figure(
    experiment: Experiment,
    shown: Sequence[FinishedRun],
    panels: Sequence[Panel],
    *,
    title: str = "",
    is_sweep: bool = False,
    columns: int = 1,
) -> Figure:
    """Draw panels over the time of an experiment."""
    words = [members_title(experiment)] if is_sweep else []
    return over_time(
        panels,
        x=time_label(experiment, shown),
        span=(0.0, experiment.problem.final_time),
        title="; ".join(filter(None, [*words, title])),
        bar=bar_of(experiment, panels) if is_sweep else "",
        columns=columns,
    )


def run_curves(
    shown: Sequence[FinishedRun],
    columns: Sequence[Array],
    *,
    exact: tuple[Array, Array] | None = None,
    floors: Sequence[float] = (),
    times: Sequence[Array] = (),
) -> list[Curve]:
    """Curves over time: first the exact one if it is given, then a column for every run."""
    names = method_looks([item.run.method for item in shown])
    curves = [] if exact is None else [Curve(x=exact[0], y=exact[1], label="exact", look=EXACT)]
    for index, (item, values) in enumerate(zip(shown, columns, strict=True)):
        own = names[item.run.method.case]
        floor = floors[index] if floors and math.isfinite(floors[index]) else 0.0
        time = times[index] if times else item.trajectory.time
        curves.append(Curve(x=time, y=values, label=own.label, look=own.look, floor=floor))
    return curves


def _position_label(experiment: Experiment, name: str) -> str:
    inner = typeset_name(name).strip("$")
    return with_unit(f"position ${inner}(t)$", experiment.units, name, "length")


def _height(extent: Extent) -> float:
    return extent.greatest if extent.greatest == extent.peak else extent.least


def has_momentum(item: FinishedRun) -> bool:
    """Whether the method of a run has a momentum, and so an energy."""
    return item.trajectory.momentum is not None and item.trajectory.energy is not None


def has_balance(item: FinishedRun) -> bool:
    """Whether a run was stored with its energy balance."""
    return item.trajectory.diagnostics is not None


def has_quantities(item: FinishedRun) -> bool:
    """Whether a run has requested quantities."""
    return bool(observed_of(item).quantities)


def observed_of(item: FinishedRun) -> Observed:
    """The quantities and events of a run; empty if none were requested."""
    observed = item.trajectory.observed
    return Observed(mesh=item.trajectory.time) if observed is None else observed


def _diagnostics(item: FinishedRun) -> Diagnostics:
    found = item.trajectory.diagnostics
    if found is None:  # pragma: no cover - runs with a balance are chosen
        raise ValueError("balance: the run has no energy")
    return found


def select_runs(
    finished: Sequence[FinishedRun],
    is_drawable: Callable[[FinishedRun], bool] = lambda item: True,
    *,
    only_distinct: bool = False,
) -> list[FinishedRun]:
    """One run for every method, on the finest steps with which most methods succeeded.

    `only_distinct`: on the finest of these steps for which some error is 10 % of the largest
    position, so that the curves of a figure differ visibly.
    """
    usable = [item for item in finished if is_drawable(item) and item.trajectory.time.size > 1]
    if not usable:
        raise ValueError("no run has what is drawn")
    there = sorted({item.run.n_steps for item in usable})
    reached = [item.run.n_steps for item in usable if item.status in ("ok", "floor")]
    most = max(map(reached.count, there))
    choices = [n for n in there if reached.count(n) == most]
    distance = [n for n in choices if any(f.run.n_steps == n and _is_off(f) for f in usable)]
    n_steps = max(distance if only_distinct and distance else choices)
    return [item for item in usable if item.run.n_steps == n_steps]


def _is_off(item: FinishedRun) -> bool:
    largest = float(np.abs(item.trajectory.position).max())
    return bool(np.isfinite(item.error) and item.error >= _VISIBLE * largest)


def most_accurate(shown: Sequence[FinishedRun]) -> FinishedRun:
    """The run with the smallest error; the last run if none has an error."""
    measured = [item for item in shown if np.isfinite(item.error)]
    return min(measured, key=lambda item: item.error) if measured else shown[-1]


def exact_energy(experiment: Experiment) -> tuple[Array, Array] | None:
    """Time and energy of the exact solution; its velocity by finite differences on a fine grid."""
    problem = experiment.problem
    if not isinstance(problem, Problem) or problem.exact is None:
        return None
    if problem.scene.lagrangian is not None:
        return None
    time = np.linspace(0.0, problem.final_time, 4 * (_FINE_POINTS - 1) + 1)
    position = problem.exact(time)
    velocity = np.gradient(position, time[1], axis=0, edge_order=2)
    momentum = velocity @ problem.scene.inertia.mass.T
    return time[::4], problem.scene.energy(position, momentum)[::4]
