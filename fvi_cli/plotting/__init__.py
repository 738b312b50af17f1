"""Figures of finished runs, made without pyplot and without global state."""

from fvi_cli.plotting.kinds.convergence import Study, convergence_figure
from fvi_cli.plotting.kinds.interpolation import interpolation_figure
from fvi_cli.plotting.planner import draw_figures
from fvi_cli.plotting.save import FORMATS, save_figure
from fvi_cli.plotting.style import styled

__all__ = [
    "FORMATS",
    "Study",
    "convergence_figure",
    "draw_figures",
    "interpolation_figure",
    "save_figure",
    "styled",
]
