"""The choice of the figures of an experiment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from matplotlib.figure import Figure

from fvi_cli.plotting.kinds.against import against_figure, ensemble_figure, spectrum_figure
from fvi_cli.plotting.kinds.convergence import (
    Study,
    convergence_figure,
    has_errors,
    saturation_figure,
    sweep_convergence_figure,
)
from fvi_cli.plotting.kinds.motions import (
    balance_figure,
    energy_figure,
    error_figure,
    quantities_figure,
    trajectory_figure,
)
from fvi_cli.plotting.kinds.planes import (
    hysteresis_figure,
    path_figure,
    phase_figure,
    section_figure,
    waterfall_figure,
)
from fvi_cli.plotting.panels import NothingToDraw
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.settings import FigureSettings

_DRAWINGS: Mapping[str, Callable[[Experiment, Sequence[FinishedRun]], Figure]] = {
    "convergence": sweep_convergence_figure,
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
    "spectrum": spectrum_figure,
}
_USUAL = ("trajectory", "energy", "error", "quantities")
_LEAST_LADDER = 3


def draw_figures(studies: Sequence[Study], *, name: str) -> tuple[dict[str, Figure], list[str]]:
    """The figures of the experiments of one configuration, by file name without suffix.

    An experiment that names its figures gets these, or a line with the reason why it does not.
    Otherwise a ladder of three or more step counts gets ``convergence``, a shorter one
    ``trajectory``, ``energy``, ``error`` and ``quantities``, as far as there is something to draw.
    Experiments of kind ``fractional-derivative`` share one figure, and all ladders the figure
    ``<name>-convergence``.
    """
    figures: dict[str, Figure] = {}
    reasons: list[str] = []
    ladders: list[Study] = []
    derivatives = [s for s in studies if s[1] and isinstance(s[0].problem, DerivativeProblem)]
    if derivatives:
        title = name if name.endswith("saturation") else f"{name}-saturation"
        figures[title] = saturation_figure(derivatives)
    for study in studies:
        experiment, finished = study
        for one in experiment.figures or _usual(finished):
            title = one.file_name if isinstance(one, FigureSettings) else one
            is_ladder = title == "convergence" and not experiment.members
            try:
                if is_ladder and study in derivatives:
                    continue
                if is_ladder and has_errors(finished):
                    ladders.append(study)
                else:
                    figures[f"{experiment.name}-{title}"] = _draw(experiment, finished, one)
            except NothingToDraw as reason:
                if experiment.figures:
                    reasons.append(f"{experiment.name}: no {title} figure, since {reason}")
    if ladders:
        figures[f"{name}-convergence"] = convergence_figure(ladders)
    return figures, reasons


def _usual(finished: Sequence[FinishedRun]) -> tuple[str, ...]:
    is_ladder = len({one.run.n_steps for one in finished}) >= _LEAST_LADDER
    return ("convergence",) if is_ladder and has_errors(finished) else _USUAL


def _draw(
    experiment: Experiment, finished: Sequence[FinishedRun], one: str | FigureSettings
) -> Figure:
    """One figure, if there is something to draw."""
    if isinstance(experiment.problem, DerivativeProblem):
        raise NothingToDraw("a fractional derivative has the figure of its orders only")
    if not finished:
        raise NothingToDraw("no run was finished")
    if isinstance(one, str):
        return _DRAWINGS[one](experiment, finished)
    if one.section is not None:
        return section_figure(experiment, finished, one.section, one.after)
    if one.ensemble is not None:
        return ensemble_figure(experiment, finished, one.ensemble)
    return against_figure(experiment, finished, one)
