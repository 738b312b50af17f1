"""Complex frequencies of modes, and magnitude and phase of harmonic responses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from fvi_cli.plotting.style import (
    COLOURS,
    GUIDE_COLOUR,
    INK,
    LINE_STYLES,
    SMALL_TEXT,
    journal_style,
    legend_columns,
    new_figure,
    short_numbers,
)
from fvi_cli.studies.vibration.modes import ModeTable
from fvi_cli.studies.vibration.response import ResponseTable

Table = TypeVar("Table", ModeTable, ResponseTable)

MOST_NUMBERED = 12
"""Modes that are numbered in a figure."""


MOST_NAMED = 12
"""Members of a sweep that are named in a figure."""


def mode_figures(name: str, tables: Sequence[ModeTable]) -> dict[str, Figure]:
    """A figure of the spectrum of every experiment, by the name of its files."""
    groups = _by_experiment(name, tables)
    return {f"{title}-modes": spectrum_figure(own) for title, own in groups.items()}


def _by_experiment(name: str, tables: Sequence[Table]) -> dict[str, list[Table]]:
    """Tables of each experiment, those of a sweep together, by the name of their files."""
    groups: dict[str, list[Table]] = {}
    for table in tables:
        groups.setdefault(table.name, []).append(table)
    return groups if len(groups) > 1 else {name: list(tables)}


def _colours(tables: Sequence[ModeTable] | Sequence[ResponseTable]) -> list[str]:
    """One for each member: distinct ones of a few, a range of many."""
    if len(tables) <= len(COLOURS):
        return list(COLOURS[: len(tables)])
    return [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 0.9, len(tables)))]


def spectrum_figure(tables: Sequence[ModeTable]) -> Figure:
    """Frequency against decay rate above, damping ratio against frequency below."""
    hertz = [np.array([mode.hertz for mode in table.modes]) for table in tables]
    decay = [np.array([mode.decay_rate for mode in table.modes]) for table in tables]
    ratio = [np.array([100.0 * mode.damping_ratio for mode in table.modes]) for table in tables]
    colours = _colours(tables)
    highest = max(one.max() for one in hertz)
    fastest = max(1e-3 * highest, *(np.abs(one).max() for one in decay))
    with journal_style():
        figure = new_figure(4.4)
        plane, ratios = figure.subplots(2, 1, height_ratios=(1.5, 1.0))
        for index, table in enumerate(tables):
            colour = colours[index]
            plane.plot(
                -decay[index],
                hertz[index],
                "o",
                color=colour,
                markersize=3.5,
                label=(table.member or table.name) if len(tables) > 1 else None,
            )
            ratio_colour = colour if len(tables) > 1 else COLOURS[1]
            ratios.plot(hertz[index], ratio[index], "o", color=ratio_colour, markersize=3.5)
            ratios.vlines(hertz[index], 0.0, ratio[index], color=ratio_colour, linewidth=0.8)
        plane.axvline(0.0, color=GUIDE_COLOUR, linewidth=0.6, gid="decoration")
        plane.set_ylim(0.0, 1.08 * highest)
        slowest = min(one.min() for one in decay)
        # modes that grow lie to the right of the axis
        right = 0.06 * fastest if slowest >= 0 else max(-1.12 * slowest, 0.06 * fastest)
        left = max(1.12 * max(one.max() for one in decay), 0.06 * fastest)
        plane.set_xlim(-left, right)
        for number in range(min(len(tables[0].modes), MOST_NUMBERED) if len(tables) == 1 else 0):
            plane.annotate(
                str(number + 1),
                (-decay[0][number], hertz[0][number]),
                xytext=(4, 2),
                textcoords="offset points",
                fontsize=SMALL_TEXT - 1,
                color=INK,
            )
        plane.set_xlabel(r"$\mathrm{Re}\, s$")
        plane.set_ylabel(r"frequency $\mathrm{Im}\, s / 2\pi$")
        ratios.set_xlim(0.0, 1.05 * highest)
        least, largest = min(one.min() for one in ratio), max(one.max() for one in ratio)
        ratios.set_ylim(min(1.15 * least, 0.0), max(1.15 * largest, 1e-6))
        if least < 0:
            ratios.axhline(0.0, color=GUIDE_COLOUR, linewidth=0.6, gid="decoration")
        ratios.set_xlabel("frequency")
        ratios.set_ylabel("damping ratio, %")
        _name_members(figure, plane, tables)
    return figure


def _name_members(figure: Figure, axes: Axes, tables: Sequence[ModeTable]) -> None:
    """A legend of a few members; of many the first and the last."""
    handles, labels = axes.get_legend_handles_labels()
    if len(tables) == 1:
        return
    if len(tables) > MOST_NAMED:
        handles, labels = [handles[0], handles[-1]], [labels[0], labels[-1]]
    figure.legend(handles, labels, loc="outside upper center", ncols=legend_columns(labels))


def response_figures(name: str, tables: Sequence[ResponseTable]) -> dict[str, Figure]:
    """A figure of the response of every experiment, by the name of its files."""
    groups = _by_experiment(name, tables)
    return {f"{title}-response": response_figure(own) for title, own in groups.items()}


def response_figure(tables: Sequence[ResponseTable]) -> Figure:
    """Magnitude with peaks and half-power widths above, phase below."""
    first = tables[0]
    steps = np.diff(first.hertz)
    is_log = bool(steps[-1] > 2.0 * steps[0])
    curves = [
        (table, index, output) for table in tables for index, output in enumerate(table.outputs)
    ]
    member_colours = _colours(tables)
    with journal_style():
        figure = new_figure(4.2 + 0.17 * ((min(len(curves), MOST_NAMED) + 2) // 3))
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.0))
        for number, (table, index, output) in enumerate(curves):
            colour = COLOURS[number % len(COLOURS)]
            style = LINE_STYLES[(number // len(COLOURS)) % len(LINE_STYLES)]
            label = output
            if len(tables) > 1:
                colour = member_colours[number // len(table.outputs)]
                style = LINE_STYLES[index % len(LINE_STYLES)]
                label = table.member if len(table.outputs) == 1 else f"{output}, {table.member}"
            size, phase = table.magnitude[:, index], table.phase[:, index]
            upper.plot(table.hertz, size, color=colour, linestyle=style, label=label)
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
        upper.set_xlim(first.hertz[0], first.hertz[-1])
        upper.set_ylabel(f"magnitude, load {first.load}")
        lower.set_ylabel("phase, degrees")
        lower.set_xlabel("frequency")
        lower.yaxis.set_major_locator(MultipleLocator(max(map(_phase_step, tables))))
        handles, labels = upper.get_legend_handles_labels()
        if len(curves) > MOST_NAMED and len(tables) > 1:
            handles, labels = [handles[0], handles[-1]], [labels[0], labels[-1]]
        columns = 3 if len(tables) == 1 else legend_columns(labels)
        figure.legend(handles, labels, loc="outside upper center", ncols=columns)
    return figure


def _phase_step(table: ResponseTable) -> float:
    """Degrees between two ticks: multiples of 90."""
    span = float(np.ptp(table.phase))
    return 90.0 * max(1, round(span / 450.0))
