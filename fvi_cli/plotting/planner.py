"""Which figures an experiment calls for."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.ladders.convergence import (
    Study,
    convergence_figure,
    saturation_figure,
    sweep_convergence_figure,
)
from fvi_cli.plotting.motions.against import obstacle, response_spectrum_figure, settings_figure
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
    has_momenta,
    has_quantities,
    momenta_figure,
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
"""A figure of an experiment and its finished runs, for which there is no obstacle.

What all of these are called with is looked at once, by :func:`_obstacles`.
"""
_OVER_TIME: dict[str, Draw] = {
    "trajectory": trajectory_figure,
    "energy": energy_figure,
    "error": error_figure,
    "balance": balance_figure,
    "momenta": momenta_figure,
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


def figures_for(studies: Sequence[Study], *, name: str | None = None) -> dict[str, Figure]:
    """Figures that the experiments of one configuration call for, by file name without suffix.

    An experiment that names its figures gets these. Otherwise a ladder of three or more step
    counts gets ``convergence``, a shorter one ``trajectory``, ``energy``, ``error`` and
    ``quantities``, as far as there are an energy, something to measure errors against, and
    quantities. Of a sweep there are ``convergence``, ``trajectory``, ``quantities``, ``section``
    and ``spectrum``, in figures of their own. Experiments of kind ``fractional-derivative`` share
    one saturation figure. With the `name` of the configuration all convergence panels stand in one
    figure ``<name>-convergence``; without it every experiment has its own.
    """
    figures: dict[str, Figure] = {}
    derivatives = [study for study in studies if isinstance(study[0].problem, DerivativeProblem)]
    if derivatives:
        title = (name or _common_name(derivatives)).removesuffix("-saturation")
        title = title if title == "saturation" else f"{title}-saturation"
        figures[title] = saturation_figure(derivatives)
    ladders = []
    for experiment, finished in studies:
        if isinstance(experiment.problem, DerivativeProblem) or not finished:
            continue
        for one in experiment.figures:
            if isinstance(one, FigureSettings) and not obstacle(finished, one):
                title = f"{experiment.name}-{one.file_name}"
                figures[title] = settings_figure(experiment, finished, one)
        for kind in figure_kinds(experiment, finished):
            if experiment.members:
                figures[f"{experiment.name}-{kind}"] = _OF_MEMBERS[kind](experiment, finished)
                continue
            if kind == "convergence":
                ladders.append((experiment, finished))
            else:
                figures[f"{experiment.name}-{kind}"] = _OVER_TIME[kind](experiment, finished)
    if name is not None and ladders:
        figures[f"{name}-convergence"] = convergence_figure(ladders)
    else:
        for study in ladders:
            figures[f"{study[0].name}-convergence"] = convergence_figure([study])
    return figures


def figure_kinds(experiment: Experiment, finished: Sequence[FinishedRun]) -> tuple[str, ...]:
    """Kinds of figures of one experiment that its runs have the data for, in order of drawing."""
    wanted = _words(experiment)
    for kind in wanted:
        if kind not in FIGURE_KINDS:
            raise ValueError(f"figures: {kind!r} is not one of {', '.join(FIGURE_KINDS)}")
    obstacles = _obstacles(experiment, finished)
    if experiment.figures:
        pass
    elif "convergence" not in obstacles and len({f.run.n_steps for f in finished}) >= _LEAST_LADDER:
        wanted = ("convergence",)
    else:
        wanted = ("trajectory", "energy", "error", "quantities")
    return tuple(kind for kind in wanted if kind not in obstacles)


def _words(experiment: Experiment) -> tuple[str, ...]:
    """The figures that are named by one word."""
    return tuple(kind for kind in experiment.figures if isinstance(kind, str))


def left_out(studies: Sequence[Study]) -> list[str]:
    """One line for every figure that is named and cannot be drawn, with why, or is not complete."""
    lines = []
    for experiment, finished in studies:
        if isinstance(experiment.problem, DerivativeProblem):
            reason = "a fractional derivative has the figure of its orders only"
            obstacles = {kind: reason for kind in FIGURE_KINDS if kind != "convergence"}
        else:
            obstacles = _obstacles(experiment, finished)
        lines += [
            f"{experiment.name}: no {kind} figure, since {obstacles[kind]}"
            for kind in _words(experiment)
            if kind in obstacles
        ]
        lines += [
            f"{experiment.name}: no {one.file_name} figure, since {why}"
            for one in experiment.figures
            if isinstance(one, FigureSettings) and finished and (why := obstacle(finished, one))
        ]
        if not isinstance(experiment.problem, DerivativeProblem) and finished:
            lines += _shortened(experiment, finished)
    return lines


def _shortened(experiment: Experiment, finished: Sequence[FinishedRun]) -> Iterator[str]:
    """One line for every figure that does not show everything that there is."""
    quantities = max(len(observed_of(item).quantities) for item in finished)
    coordinates = finished[0].trajectory.position.shape[1]
    counts = {
        "quantities": (quantities, MOST_PANELS),
        "trajectory": (coordinates, 1 if experiment.members else MOST_COMPONENTS),
        "phase": (coordinates, MOST_COMPONENTS),
        "section": (coordinates, 1 if experiment.members else MOST_COMPONENTS),
    }
    for kind in figure_kinds(experiment, finished):
        count, most = counts.get(kind, (0, 0))
        if count > most:
            what = "quantities" if kind == "quantities" else "coordinates"
            yield f"{experiment.name}: the {kind} figure shows {most} of {count} {what}"


def _obstacles(experiment: Experiment, finished: Sequence[FinishedRun]) -> dict[str, str]:
    """Why a kind of figure cannot be drawn, for those that cannot."""
    if not finished:
        return dict.fromkeys(FIGURE_KINDS, "no run was finished")
    obstacles: dict[str, str] = {}
    if experiment.members:
        *others, last = _OF_MEMBERS
        reason = f"a sweep has {', '.join(others)} and {last}"
        obstacles = {kind: reason for kind in FIGURE_KINDS if kind not in _OF_MEMBERS}
        if experiment.members[0].dimension != 1:
            obstacles["spectrum"] = "it is for oscillators of one degree of freedom"
    else:
        obstacles["spectrum"] = "it is drawn of a sweep over stiffness or mass"
    compared = any(np.isfinite(item.error) for item in finished)
    if not compared and all(item.status == "ok" for item in finished):
        obstacles["convergence"] = f"no error is known: the reference is {finished[0].reference}"
    elif experiment.members and not any(np.isfinite(f.error) and f.error > 0 for f in finished):
        obstacles["convergence"] = "no member has an error, or one above 0"
    moving = [item for item in finished if item.trajectory.time.size > 1]
    if not moving:
        reason = f"every run failed at its start ({finished[-1].status})"
        return {**obstacles, **dict.fromkeys(_OVER_TIME, reason)}
    if all(item.trajectory.energy is None for item in moving):
        obstacles["energy"] = "no method of the experiment has a momentum"
        obstacles["phase"] = obstacles["energy"]
    if not any(has_balance(item) for item in moving):
        obstacles["balance"] = "it needs store: {diagnostics: [energy-balance]}"
    if not any(has_momenta(item) for item in moving):
        obstacles["momenta"] = "it needs store: {diagnostics: [momentum-maps]}"
    if not any(has_quantities(item) for item in moving):
        obstacles["quantities"] = "the experiment has no quantities"
    if not forces_of(experiment) or "quantities" in obstacles:
        obstacles["hysteresis"] = (
            "no quantity is the force of a damper; write quantities: {force: force_1}"
        )
    if not any(has_events(item) for item in moving):
        obstacles["section"] = "no event happened"
    if experiment.problem.exact is None and experiment.observations.times is not None:
        obstacles["error"] = "a refined run is known on the mesh only, not at the times of output"
    if moving[0].trajectory.position.shape[1] < 2:
        obstacles["path"] = "the scene has one coordinate only"
    if experiment.problem.kind not in WATERFALL_KINDS:
        obstacles["waterfall"] = f"it is made for {', '.join(WATERFALL_KINDS)}"
    if experiment.problem.exact is None and not compared:
        obstacles["error"] = f"no error is known: the reference is {finished[0].reference}"
    return obstacles


def _common_name(studies: Sequence[Study]) -> str:
    """The beginning that all names share, up to a ``-``."""
    names = [experiment.name for experiment, _ in studies]
    columns = zip(*(name.split("-") for name in names), strict=False)
    common = itertools.takewhile(lambda column: len(set(column)) == 1, columns)
    return "-".join(column[0] for column in common) or names[0]
