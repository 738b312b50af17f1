"""The choice of the figures of an experiment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from matplotlib.figure import Figure

from fvi_cli.plotting.kinds.against import response_spectrum_figure, settings_figure
from fvi_cli.plotting.kinds.convergence import (
    Study,
    check_errors,
    convergence_figure,
    sweep_convergence_figure,
)
from fvi_cli.plotting.kinds.motions import (
    balance_figure,
    energy_figure,
    error_figure,
    sweep_trajectory_figure,
    trajectory_figure,
)
from fvi_cli.plotting.kinds.paths import path_figure, phase_figure, waterfall_figure
from fvi_cli.plotting.kinds.planes import hysteresis_figure, section_figure
from fvi_cli.plotting.kinds.quantities import quantities_figure
from fvi_cli.plotting.kinds.saturation import saturation_figure
from fvi_cli.plotting.panels import NothingToDraw
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.figure_settings import FigureSettings

Draw = Callable[[Experiment, Sequence[FinishedRun]], Figure]

_OF_SCENES: Mapping[str, Draw] = {
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
_OF_MEMBERS: Mapping[str, Draw] = {
    "convergence": sweep_convergence_figure,
    "trajectory": sweep_trajectory_figure,
    "quantities": quantities_figure,
    "section": section_figure,
    "hysteresis": hysteresis_figure,
    "spectrum": response_spectrum_figure,
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
        for one in experiment.figures or ("convergence", *_USUAL):
            title = one.file_name if isinstance(one, FigureSettings) else one
            if title == "convergence" and study in derivatives:
                continue
            try:
                made = _draw(experiment, finished, one)
            except NothingToDraw as reason:
                if experiment.figures:
                    reasons.append(f"{experiment.name}: no {title} figure, since {reason}")
                continue
            if made is None:
                ladders.append(study)
            else:
                figures[f"{experiment.name}-{title}"] = made
            if title == "convergence" and not experiment.figures:
                break
    if ladders:
        figures[f"{name}-convergence"] = convergence_figure(ladders)
    return figures, reasons


def _draw(
    experiment: Experiment, finished: Sequence[FinishedRun], one: str | FigureSettings
) -> Figure | None:
    """One figure; None for one of orders, which is drawn with those of other experiments."""
    if isinstance(experiment.problem, DerivativeProblem):
        raise NothingToDraw("a fractional derivative has the figure of its orders only")
    if not finished:
        raise NothingToDraw("no run was finished")
    if isinstance(one, FigureSettings):
        return settings_figure(experiment, finished, one)
    if one == "convergence":
        if not experiment.figures and len({item.run.n_steps for item in finished}) < _LEAST_LADDER:
            raise NothingToDraw("the ladder is short")
        check_errors(finished)
        return sweep_convergence_figure(experiment, finished) if experiment.members else None
    drawn = _OF_MEMBERS if experiment.members else _OF_SCENES
    if one in drawn:
        return drawn[one](experiment, finished)
    if one == "spectrum":
        raise NothingToDraw("it is drawn of a sweep over stiffness or mass")
    raise NothingToDraw(f"a sweep has {', '.join(_OF_MEMBERS)}; leave out sweep for one scene")
