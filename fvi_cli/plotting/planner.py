"""The choice of the figures of an experiment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.kinds.against import (
    OF_PERIOD,
    obstacle,
    period,
    response_spectrum_figure,
    settings_figure,
)
from fvi_cli.plotting.kinds.convergence import (
    Study,
    convergence_figure,
    sweep_convergence_figure,
)
from fvi_cli.plotting.kinds.motions import (
    balance_figure,
    energy_figure,
    error_figure,
    has_balance,
    has_momentum,
    sweep_trajectory_figure,
    trajectory_figure,
)
from fvi_cli.plotting.kinds.paths import (
    WATERFALL_KINDS,
    has_velocity,
    path_figure,
    phase_figure,
    waterfall_figure,
)
from fvi_cli.plotting.kinds.planes import has_events, hysteresis_figure, section_figure
from fvi_cli.plotting.kinds.quantities import has_quantities, quantities_figure
from fvi_cli.plotting.kinds.saturation import saturation_figure
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.figure_settings import FigureSettings
from fvi_cli.studies.loops import forces_of

Draw = Callable[[Experiment, Sequence[FinishedRun]], Figure]
_LEAST_LADDER = 3
_USUAL = ("trajectory", "energy", "error", "quantities")


@dataclass(frozen=True, kw_only=True)
class _Kind:
    """A kind of figure: for one scene and for the members of a sweep, and what it needs."""

    draw: Draw | None = None
    of_members: Draw | None = None
    needs: Callable[[FinishedRun], bool] = lambda item: True  # of some run
    reason: str = ""  # why there is no figure where no run has it


_NO_MOMENTUM = "no method of the experiment has a momentum; write method: gauss3"
_KINDS: Mapping[str, _Kind] = {
    "convergence": _Kind(
        draw=lambda experiment, finished: convergence_figure([(experiment, finished)]),
        of_members=sweep_convergence_figure,
        needs=lambda item: bool(np.isfinite(item.error)) or item.status != "ok",
        reason="no error is known; write exact: 1 - cos(t), or a ladder",
    ),
    "trajectory": _Kind(draw=trajectory_figure, of_members=sweep_trajectory_figure),
    "energy": _Kind(draw=energy_figure, needs=has_momentum, reason=_NO_MOMENTUM),
    "error": _Kind(
        draw=error_figure,
        needs=lambda item: item.run.problem.exact is not None,
        reason="no exact solution is known; write exact: 1 - cos(t)",
    ),
    "balance": _Kind(
        draw=balance_figure,
        needs=has_balance,
        reason="it needs store: {diagnostics: [energy-balance]} and a method such as gauss3",
    ),
    "phase": _Kind(draw=phase_figure, needs=has_velocity, reason=_NO_MOMENTUM),
    "path": _Kind(
        draw=path_figure,
        needs=lambda item: item.trajectory.position.shape[1] > 1,
        reason="the scene has one coordinate only",
    ),
    "waterfall": _Kind(
        draw=waterfall_figure,
        needs=lambda item: item.run.problem.kind in WATERFALL_KINDS,
        reason=f"it is made for {', '.join(WATERFALL_KINDS)}",
    ),
    "quantities": _Kind(
        draw=quantities_figure,
        of_members=quantities_figure,
        needs=has_quantities,
        reason="there are none; write quantities: {drift: x2 - x1}",
    ),
    "section": _Kind(
        draw=section_figure,
        of_members=section_figure,
        needs=has_events,
        reason="no event happened",
    ),
    "hysteresis": _Kind(
        draw=hysteresis_figure,
        of_members=hysteresis_figure,
        needs=lambda item: has_quantities(item) and bool(forces_of(item.run.experiment)),
        reason="no quantity is the force of a damper; write quantities: {force: force_1}",
    ),
    "spectrum": _Kind(
        of_members=response_spectrum_figure,
        needs=lambda item: bool(set(OF_PERIOD).intersection(item.run.experiment.swept)),
        reason="it is drawn of a sweep over stiffness or mass; write "
        "sweep: {problem.stiffness: {from: 1, to: 100, number: 30, spacing: log}}",
    ),
}


def figures_for(studies: Sequence[Study], *, name: str) -> dict[str, Figure]:
    """The figures of the experiments of one configuration, by file name without suffix.

    An experiment that names its figures gets these. Otherwise a ladder of three or more step
    counts gets ``convergence``, a shorter one ``trajectory``, ``energy``, ``error`` and
    ``quantities``, as far as there is something to draw. Experiments of kind
    ``fractional-derivative`` share one saturation figure, and all ladders the figure
    ``<name>-convergence``.
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
        for kind in figure_kinds(experiment, finished):
            draw = _KINDS[kind].of_members if experiment.members else _KINDS[kind].draw
            if kind == "convergence" and not experiment.members:
                ladders.append((experiment, finished))
            elif draw is not None:
                figures[f"{experiment.name}-{kind}"] = draw(experiment, finished)
    if ladders:
        figures[f"{name}-convergence"] = convergence_figure(ladders)
    return figures


def figure_kinds(experiment: Experiment, finished: Sequence[FinishedRun]) -> tuple[str, ...]:
    """Kinds of figures for which the runs of an experiment have data, in the order of drawing."""
    wanted = [kind for kind in experiment.figures if isinstance(kind, str)]
    if not experiment.figures:
        is_ladder = len({item.run.n_steps for item in finished}) >= _LEAST_LADDER
        is_ladder = is_ladder and not _obstacle(experiment, finished, "convergence")
        wanted = ["convergence"] if is_ladder else list(_USUAL)
    return tuple(kind for kind in wanted if not _obstacle(experiment, finished, kind))


def left_out(studies: Sequence[Study]) -> list[str]:
    """One line with the reason for every requested figure that cannot be drawn."""
    lines = []
    for experiment, finished in studies:
        for one in experiment.figures:
            if isinstance(one, str):
                title, reason = one, _obstacle(experiment, finished, one)
            else:
                title = one.file_name
                reason = obstacle(finished, one) if finished else "no run was finished"
            if reason:
                lines.append(f"{experiment.name}: no {title} figure, since {reason}")
    return lines


def _obstacle(experiment: Experiment, finished: Sequence[FinishedRun], name: str) -> str:
    """Why a figure cannot be drawn; empty: it can."""
    if name not in _KINDS:
        raise ValueError(f"figures: {name!r} is not one of {', '.join(_KINDS)}")
    kind = _KINDS[name]
    if isinstance(experiment.problem, DerivativeProblem):
        is_orders = name == "convergence"
        return "" if is_orders else "a fractional derivative has the figure of its orders only"
    if not finished:
        return "no run was finished"
    if experiment.members and kind.of_members is None:
        known = [one for one, its in _KINDS.items() if its.of_members]
        return f"a sweep has {', '.join(known)}; leave out sweep for one scene"
    moving = [item for item in finished if item.trajectory.time.size > 1]
    if not moving and name != "convergence":
        return f"every run failed at its start ({finished[-1].status})"
    if not any(map(kind.needs, moving or finished)):
        return kind.reason
    if name == "spectrum":
        try:
            for member in experiment.members:
                period(member)
        except ValueError as error:
            return str(error)
    if name == "convergence" and experiment.members:
        is_there = any(np.isfinite(item.error) and item.error > 0 for item in finished)
        return "" if is_there else "no member has an error above 0"
    return ""
