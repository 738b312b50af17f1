"""Complex frequencies of modes, and magnitude and phase of harmonic responses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.looks import Look
from fvi_cli.plotting.panels import over_time
from fvi_cli.plotting.style import (
    COLOURS,
    GUIDE_COLOUR,
    INK,
    LINE_STYLES,
    MARKERS,
    journal_style,
    legend_of,
    new_figure,
    small,
)
from fvi_cli.plotting.words import typeset_sum
from fvi_cli.reports.kinds.vibration import magnitude_label
from fvi_cli.reports.naming import with_unit
from fvi_cli.studies.vibration.modes import Mode, ModeTable
from fvi_cli.studies.vibration.response import GROUND, ResponseTable

Table = TypeVar("Table", ModeTable, ResponseTable)

MOST_NUMBERED = 12
"""Modes that are numbered in a figure."""
MOST_NAMED = 12
"""Members of a sweep that are named in a figure."""


def mode_figures(name: str, tables: Sequence[ModeTable]) -> dict[str, Figure]:
    """A figure of the spectrum of every experiment, by the name of its files."""
    groups = _by_experiment(name, tables)
    return {f"{title}-modes": spectrum_figure(own) for title, own in groups.items()}


def response_figures(name: str, tables: Sequence[ResponseTable]) -> dict[str, Figure]:
    """A figure of the response of every experiment, by the name of its files."""
    groups = _by_experiment(name, tables)
    return {f"{title}-response": response_figure(own) for title, own in groups.items()}


def _by_experiment(name: str, tables: Sequence[Table]) -> dict[str, list[Table]]:
    """Tables of each experiment, those of a sweep together, by the name of their files."""
    groups: dict[str, list[Table]] = {}
    for table in tables:
        groups.setdefault(table.name, []).append(table)
    return groups if len(groups) > 1 else {name: list(tables)}


def _colours(count: int) -> list[str]:
    """One for each member: distinct ones of a few, a range of many."""
    if count <= len(COLOURS):
        return list(COLOURS[:count])
    return [to_hex(colour) for colour in colormaps["viridis"](np.linspace(0, 0.9, count))]


def _labels(names: Sequence[str]) -> list[str]:
    """Entries of a legend; of many members only the first and the last."""
    ends = (0, len(names) - 1)
    return [n if len(names) <= MOST_NAMED or k in ends else f"_{n}" for k, n in enumerate(names)]


@journal_style()
def spectrum_figure(tables: Sequence[ModeTable]) -> Figure:
    """Frequency against decay rate above, damping ratio against frequency below.

    Modes that grow lie to the right of the axis, and below it.
    """

    def of(get: Callable[[Mode], float]) -> list[Array]:
        return [np.array([get(mode) for mode in table.modes]) for table in tables]

    hertz, real = of(lambda mode: mode.hertz), of(lambda mode: -mode.decay_rate)
    ratio = of(lambda mode: 100.0 * mode.damping_ratio)
    highest = max(one.max() for one in hertz)
    extent = max(1e-3 * highest, *(np.abs(one).max() for one in real))
    units, is_one = tables[0].units, len(tables) == 1
    figure = new_figure(4.2)
    plane, ratios = figure.subplots(2, 1, height_ratios=(1.5, 1.0))
    labels = _labels([table.member or table.name for table in tables])
    for index, (colour, label) in enumerate(zip(_colours(len(tables)), labels, strict=True)):
        marker = MARKERS[index % len(MARKERS)] if len(tables) <= len(COLOURS) else "o"
        dots = {"linestyle": "none", "marker": marker, "color": colour, "markersize": 3.5}
        plane.plot(real[index], hertz[index], label="_modes" if is_one else label, **dots)
        ratios.plot(hertz[index], ratio[index], label=f"_{label}", **dots)
        ratios.vlines(hertz[index], 0.0, ratio[index], color=colour, linewidth=0.8)
    plane.axvline(0.0, color=GUIDE_COLOUR, linewidth=0.6, gid="decoration")
    ratios.axhline(0.0, color=GUIDE_COLOUR, linewidth=0.6, gid="decoration")
    plane.set_ylim(0.0, 1.08 * highest)
    ends = [min(one.min() for one in real), max(one.max() for one in real)]
    plane.set_xlim(
        min(1.12 * ends[0], -0.06 * extent) - 0.06 * extent, max(1.12 * ends[1], 0.06 * extent)
    )
    for number, mode in enumerate(tables[0].modes[:MOST_NUMBERED] if is_one else ()):
        text = plane.annotate(str(number + 1), (-mode.decay_rate, mode.hertz), xytext=(-4, 2))
        text.set(fontsize=small() - 1, color=INK, ha="right")
        text.anncoords = "offset points"
    plane.set_xlabel(with_unit(r"$\mathrm{Re}\, s$", units, "rate"))
    plane.set_ylabel(with_unit(r"frequency $\mathrm{Im}\, s / 2\pi$", units, "frequency"))
    ratios.set_xlim(0.0, 1.05 * highest)
    least, largest = min(one.min() for one in ratio), max(one.max() for one in ratio)
    ratios.set_ylim(min(1.15 * least, 0.0), max(1.15 * largest, 1e-6))
    ratios.set_xlabel(with_unit("frequency", units, "frequency"))
    ratios.set_ylabel("damping ratio (%)")
    figure.align_ylabels([plane, ratios])
    legend_of(figure, plane.get_legend_handles_labels()[0])
    return figure


def response_figure(tables: Sequence[ResponseTable]) -> Figure:
    """Magnitude with half-power widths of its peaks above, phase below."""
    first, count = tables[0], len(tables[0].outputs)
    curves = [(table, index) for table in tables for index in range(count)]
    names = [typeset_sum(table.outputs[index]) for table, index in curves]
    if len(tables) > 1:
        members = [table.member for table, _ in curves]
        names = (
            members if count == 1 else [f"{a}, {b}" for a, b in zip(names, members, strict=True)]
        )
    labels = _labels(names) if len(tables) > 1 else names
    colours = _colours(len(tables) if len(tables) > 1 else count)
    upper, lower, widths = [], [], []
    for number, (table, index) in enumerate(curves):
        look = Look(
            colour=colours[number // count if len(tables) > 1 else index % len(colours)],
            dashes=LINE_STYLES[index % len(LINE_STYLES)],
        )
        size, phase = table.magnitude[:, index], table.phase[:, index]
        upper.append(Curve(x=table.hertz, y=size, label=labels[number], look=look))
        lower.append(Curve(x=table.hertz, y=phase, label=labels[number], look=look))
        own = [peak for peak in table.peaks if peak.at == table.outputs[index]]
        widths += [(peak, look.colour) for peak in own]
    steps = np.diff(first.hertz)
    what = "ground acceleration" if first.load.split(" ")[0] == GROUND else typeset_sum(first.load)
    figure = over_time(
        [
            Panel(curves=upper, y=magnitude_label(first), is_log=True, height=2.3),
            Panel(curves=lower, y="phase (degrees)", height=1.4),
        ],
        x=with_unit("frequency", first.units, "frequency"),
        logarithmic=bool(steps[-1] > 2.0 * steps[0]),
        title=f"load: {what}",
    )
    with journal_style():
        for peak, colour in widths:
            if not np.isfinite(peak.high - peak.low):
                continue
            level = peak.magnitude / np.sqrt(2.0)
            line = figure.axes[0].plot([peak.low, peak.high], [level, level], "|-", color=colour)[0]
            line.set(markersize=4, label="_half power")
        step = 90.0 * max(max(1, round(float(np.ptp(one.phase)) / 450.0)) for one in tables)
        figure.axes[1].yaxis.set_major_locator(MultipleLocator(step))
    return figure
