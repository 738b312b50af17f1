"""The choice of the figures of an experiment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.ladders.convergence import (
    Study,
    convergence_figure,
    saturation_figure,
    sweep_convergence_figure,
)
from fvi_cli.plotting.motions.against import (
    OF_PERIOD,
    obstacle,
    period,
    response_spectrum_figure,
    settings_figure,
)
from fvi_cli.plotting.motions.paths import (
    WATERFALL_KINDS,
    path_figure,
    phase_figure,
    waterfall_figure,
)
from fvi_cli.plotting.motions.section import (
    has_events,
    hysteresis_figure,
    section_figure,
)
from fvi_cli.plotting.motions.time_series import (
    MOST_COMPONENTS,
    MOST_PANELS,
    balance_figure,
    energy_figure,
    error_figure,
    has_balance,
    has_momentum,
    has_quantities,
    observed_of,
    quantities_figure,
    sweep_trajectory_figure,
    trajectory_figure,
)
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.experiment import FIGURE_KINDS, Experiment, FinishedRun
from fvi_cli.studies.figure_settings import FigureSettings
from fvi_cli.studies.loops import forces_of

Draw = Callable[[Experiment, Sequence[FinishedRun]], Figure]
"""Draws a figure of an experiment and its finished runs.

:func:`_obstacles` has checked before, once for all figures, that it can be drawn.
"""
_OVER_TIME: dict[str, Draw] = {
    "trajectory": trajectory_figure,
    "energy": energy_figure,
    "error": error_figure,
    "balance": balance_figure,
    "phase": phase_figure,
    "path": path_figure,
    "waterfall": waterfall_figure,
    "quantities": quantities_figure,
    "section": section_figure,
    "hysteresis": hysteresis_figure,
}
_OF_MEMBERS: dict[str, Draw] = {
    "convergence": sweep_convergence_figure,
    "trajectory": sweep_trajectory_figure,
    "quantities": quantities_figure,
    "section": section_figure,
    "hysteresis": hysteresis_figure,
    "spectrum": response_spectrum_figure,
}
_LEAST_LADDER = 3


def figures_for(studies: Sequence[Study], *, name: str) -> dict[str, Figure]:
    """The figures of the experiments of one configuration, by file name without suffix.

    An experiment that names its figures gets these. Otherwise a ladder of three or more step
    counts gets ``convergence``, a shorter one ``trajectory``, ``energy``, ``error`` and
    ``quantities``, as far as there are an energy, a reference for errors, and quantities. A sweep
    has figures ``convergence``, ``trajectory``, ``quantities``, ``section`` and ``spectrum`` of its
    own. Experiments of kind ``fractional-derivative`` share one saturation figure, and all ladders
    the figure ``<name>-convergence``.
    """
    figures: dict[str, Figure] = {}
    derivatives = [study for study in studies if isinstance(study[0].problem, DerivativeProblem)]
    if derivatives:
        title = name if name.endswith("saturation") else f"{name}-saturation"
        figures[title] = saturation_figure(derivatives)
    ladders: list[Study] = []
    for experiment, finished in studies:
        if isinstance(experiment.problem, DerivativeProblem) or not finished:
            continue
        for one in experiment.figures:
            if isinstance(one, FigureSettings) and not obstacle(finished, one):
                title = f"{experiment.name}-{one.file_name}"
                figures[title] = settings_figure(experiment, finished, one)
        draw = _OF_MEMBERS if experiment.members else _OVER_TIME
        for kind in figure_kinds(experiment, finished):
            if kind in draw:
                figures[f"{experiment.name}-{kind}"] = draw[kind](experiment, finished)
            else:
                ladders.append((experiment, finished))
    if ladders:
        figures[f"{name}-convergence"] = convergence_figure(ladders)
    return figures


def figure_kinds(experiment: Experiment, finished: Sequence[FinishedRun]) -> tuple[str, ...]:
    """Kinds of figures for which the runs of an experiment have data, in the order of drawing."""
    wanted = _words(experiment)
    for kind in wanted:
        if kind not in FIGURE_KINDS:
            raise ValueError(f"figures: {kind!r} is not one of {', '.join(FIGURE_KINDS)}")
    obstacles = _obstacles(experiment, finished)
    if not experiment.figures:
        is_ladder = len({item.run.n_steps for item in finished}) >= _LEAST_LADDER
        wanted = ("trajectory", "energy", "error", "quantities")
        if is_ladder and "convergence" not in obstacles:
            wanted = ("convergence",)
    return tuple(kind for kind in wanted if kind not in obstacles)


def _words(experiment: Experiment) -> tuple[str, ...]:
    """The requested figures that are given by a single word."""
    return tuple(kind for kind in experiment.figures if isinstance(kind, str))


def left_out(studies: Sequence[Study]) -> list[str]:
    """One line for every requested figure that cannot be drawn (with the reason) or completely."""
    lines = []
    for experiment, finished in studies:
        is_derivative = isinstance(experiment.problem, DerivativeProblem)
        obstacles = _obstacles(experiment, finished)
        if is_derivative:
            reason = "a fractional derivative has the figure of its orders only"
            obstacles = {kind: reason for kind in FIGURE_KINDS if kind != "convergence"}
        missing = {kind: obstacles[kind] for kind in _words(experiment) if kind in obstacles}
        for one in experiment.figures if finished else ():
            if isinstance(one, FigureSettings) and (reason := obstacle(finished, one)):
                missing[one.file_name] = reason
        lines += [
            f"{experiment.name}: no {one} figure, since {why}" for one, why in missing.items()
        ]
        if finished and not is_derivative:
            lines += _shortened(experiment, finished)
    return lines


_OF_FIRST_METHOD = ("quantities", "section", "hysteresis", "spectrum")
"""Figures of sweeps that show one method."""


def _shortened(experiment: Experiment, finished: Sequence[FinishedRun]) -> Iterator[str]:
    """One line for every figure that leaves out quantities, coordinates or methods."""
    quantities = max(len(observed_of(item).quantities) for item in finished)
    coordinates = finished[0].trajectory.position.shape[1]
    most = 1 if experiment.members else MOST_COMPONENTS
    counts = {
        "quantities": (quantities, MOST_PANELS, "quantities"),
        "hysteresis": (len(forces_of(experiment)), MOST_COMPONENTS, "forces"),
        "trajectory": (coordinates, most, "coordinates"),
        "phase": (coordinates, MOST_COMPONENTS, "coordinates"),
        "section": (coordinates, most, "coordinates"),
    }
    methods = len({item.run.method for item in finished})
    for kind in figure_kinds(experiment, finished):
        start = f"{experiment.name}: the {kind} figure shows"
        count, shown, what = counts.get(kind, (0, 0, ""))
        if count > shown:
            yield f"{start} {shown} of {count} {what}"
        is_sweep = experiment.members and experiment.accuracy is None
        if is_sweep and methods > 1 and kind in _OF_FIRST_METHOD:
            yield f"{start} the first of {methods} methods"


_NO_MOMENTUM = "no method of the experiment has a momentum; write method: gauss3"
_NEEDS_STORE = (
    "it needs store: {diagnostics: [energy-balance]} and a method that keeps its steps, such as "
    "gauss3"
)
_NEEDS_PERIODS = (
    "it is drawn of a sweep over stiffness or mass; write "
    "sweep: {problem.stiffness: {from: 1, to: 100, number: 30, spacing: log}}"
)
_NEEDS: Mapping[str, tuple[Callable[[FinishedRun], bool], str]] = {
    "energy": (has_momentum, _NO_MOMENTUM),
    "phase": (has_momentum, _NO_MOMENTUM),
    "balance": (has_balance, _NEEDS_STORE),
    "quantities": (has_quantities, "there are none; write quantities: {drift: x2 - x1}"),
    "hysteresis": (
        lambda item: has_quantities(item) and bool(forces_of(item.run.experiment)),
        "no quantity is the force of a damper; write quantities: {force: force_1}",
    ),
    "section": (has_events, "no event happened"),
    "path": (
        lambda item: item.trajectory.position.shape[1] > 1,
        "the scene has one coordinate only",
    ),
    "waterfall": (
        lambda item: item.run.problem.kind in WATERFALL_KINDS,
        f"it is made for {', '.join(WATERFALL_KINDS)}",
    ),
}
"""By kind of figure: (condition that some run must meet, reason if none does)."""


def _spectrum_obstacle(experiment: Experiment) -> dict[str, str]:
    if not set(OF_PERIOD).intersection(experiment.swept):
        return {"spectrum": _NEEDS_PERIODS}
    try:
        for member in experiment.members:
            period(member)
    except ValueError as error:
        return {"spectrum": str(error)}
    return {}


def _obstacles(experiment: Experiment, finished: Sequence[FinishedRun]) -> dict[str, str]:
    """Reasons by kind of figure, for the kinds that cannot be drawn."""
    if not finished:
        return dict.fromkeys(FIGURE_KINDS, "no run was finished")
    obstacles: dict[str, str] = {}
    if experiment.members:
        *others, last = _OF_MEMBERS
        reason = f"a sweep has {', '.join(others)} and {last}; leave out sweep for one scene"
        obstacles = {kind: reason for kind in FIGURE_KINDS if kind not in _OF_MEMBERS}
    if "spectrum" in experiment.figures:
        obstacles |= _spectrum_obstacle(experiment)
    unknown = f"no error is known: the reference is {finished[0].reference}"
    is_compared = any(np.isfinite(item.error) for item in finished)
    if not is_compared and all(item.status == "ok" for item in finished):
        obstacles["convergence"] = unknown
    elif experiment.members and not any(np.isfinite(f.error) and f.error > 0 for f in finished):
        obstacles["convergence"] = "no member has an error, or one above 0"
    moving = [item for item in finished if item.trajectory.time.size > 1]
    if not moving:
        reason = f"every run failed at its start ({finished[-1].status})"
        return {**obstacles, **dict.fromkeys(_OVER_TIME, reason)}
    obstacles |= {
        kind: reason
        for kind, (is_there, reason) in _NEEDS.items()
        if kind not in obstacles and not any(map(is_there, moving))
    }
    if experiment.problem.exact is None and not is_compared:
        obstacles.setdefault("error", unknown)
    elif experiment.problem.exact is None and experiment.observations.times is not None:
        reason = "a refined run is known on the mesh only, not at the times of output"
        obstacles.setdefault("error", reason)
    return obstacles
