"""Figures of finished runs, made without pyplot and without global state."""

from fvi_cli.plotting.interpolation import interpolation_figure
from fvi_cli.plotting.ladders.convergence import Study, convergence_figure, saturation_figure
from fvi_cli.plotting.motions.time_series import error_figure, trajectory_figure
from fvi_cli.plotting.planner import figure_kinds, figures_for, left_out
from fvi_cli.plotting.save import FORMATS, save_figure
from fvi_cli.plotting.style import styled

__all__ = [
    "FORMATS",
    "Study",
    "convergence_figure",
    "error_figure",
    "figure_kinds",
    "figures_for",
    "interpolation_figure",
    "left_out",
    "saturation_figure",
    "save_figure",
    "styled",
    "trajectory_figure",
]
