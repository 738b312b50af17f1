"""Complex frequencies of modes, and magnitude and phase of harmonic responses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from fvi_cli.plotting.style import (
    COLOURS,
    GUIDE_COLOUR,
    INK,
    LINE_STYLES,
    SMALL_TEXT,
    journal_style,
    new_figure,
    short_numbers,
)
from fvi_cli.studies.vibration.modes import ModeTable
from fvi_cli.studies.vibration.response import ResponseTable

MOST_NUMBERED = 12
"""Modes that are numbered in a figure."""


def mode_figures(name: str, tables: Sequence[ModeTable]) -> dict[str, Figure]:
    """A figure of the spectrum of every experiment, by the name of its files."""
    several = len(tables) > 1
    return {f"{one.name if several else name}-modes": spectrum_figure(one) for one in tables}


def spectrum_figure(table: ModeTable) -> Figure:
    """Frequency against decay rate above, damping ratio against frequency below."""
    hertz = np.array([mode.hertz for mode in table.modes])
    decay = np.array([mode.decay_rate for mode in table.modes])
    ratio = np.array([mode.damping_ratio for mode in table.modes])
    with journal_style():
        figure = new_figure(4.4)
        plane, ratios = figure.subplots(2, 1, height_ratios=(1.5, 1.0))
        plane.plot(-decay, hertz, "o", color=COLOURS[0], markersize=3.5)
        plane.axvline(0.0, color=GUIDE_COLOUR, linewidth=0.6, gid="decoration")
        plane.set_ylim(0.0, 1.08 * hertz.max())
        plane.set_xlim(-1.12 * max(decay.max(), 1e-3 * hertz.max()), 0.06 * max(decay.max(), 1e-3))
        for number in range(min(len(table.modes), MOST_NUMBERED)):
            plane.annotate(
                str(number + 1),
                (-decay[number], hertz[number]),
                xytext=(4, 2),
                textcoords="offset points",
                fontsize=SMALL_TEXT - 1,
                color=INK,
            )
        plane.set_xlabel(r"$\mathrm{Re}\, s$")
        plane.set_ylabel(r"frequency $\mathrm{Im}\, s / 2\pi$")
        ratios.plot(hertz, 100.0 * ratio, "o", color=COLOURS[1], markersize=3.5)
        ratios.vlines(hertz, 0.0, 100.0 * ratio, color=COLOURS[1], linewidth=0.8)
        ratios.set_xlim(0.0, 1.05 * hertz.max())
        ratios.set_ylim(0.0, max(1.15 * 100.0 * ratio.max(), 1e-6))
        ratios.set_xlabel("frequency")
        ratios.set_ylabel("damping ratio, %")
    return figure


def response_figures(name: str, tables: Sequence[ResponseTable]) -> dict[str, Figure]:
    """A figure of the response of every experiment, by the name of its files."""
    several = len(tables) > 1
    return {f"{one.name if several else name}-response": response_figure(one) for one in tables}


def response_figure(table: ResponseTable) -> Figure:
    """Magnitude with peaks and half-power widths above, phase below."""
    steps = np.diff(table.hertz)
    is_log = bool(steps[-1] > 2.0 * steps[0])
    with journal_style():
        figure = new_figure(4.2 + 0.17 * ((len(table.outputs) + 2) // 3))
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.0))
        for index, output in enumerate(table.outputs):
            colour = COLOURS[index % len(COLOURS)]
            style = LINE_STYLES[(index // len(COLOURS)) % len(LINE_STYLES)]
            size, phase = table.magnitude[:, index], table.phase[:, index]
            upper.plot(table.hertz, size, color=colour, linestyle=style, label=output)
            lower.plot(table.hertz, phase, color=colour, linestyle=style)
            for peak in table.peaks:
                if peak.at == output:
                    level = peak.magnitude / np.sqrt(2.0)
                    upper.plot(
                        [peak.low, peak.high], [level, level], "|-", color=colour, markersize=4
                    )
        upper.set_yscale("log")
        if is_log:
            upper.set_xscale("log")
            short_numbers(lower.xaxis)
        upper.set_xlim(table.hertz[0], table.hertz[-1])
        upper.set_ylabel(f"magnitude, load {table.load}")
        lower.set_ylabel("phase, degrees")
        lower.set_xlabel("frequency")
        lower.yaxis.set_major_locator(MultipleLocator(_phase_step(table)))
        figure.legend(*upper.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def _phase_step(table: ResponseTable) -> float:
    """Degrees between two ticks: multiples of 90."""
    span = float(np.ptp(table.phase))
    return 90.0 * max(1, round(span / 450.0))
