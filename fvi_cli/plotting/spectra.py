"""Complex frequencies of modes, and magnitude and phase of harmonic responses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.looks import Look
from fvi_cli.plotting.panels import MOST_LINES, over_time, plane
from fvi_cli.plotting.style import (
    COLOURS,
    GUIDE_COLOUR,
    INK,
    LINE_STYLES,
    MARKERS,
    journal_style,
)
from fvi_cli.plotting.words import load_in_words, swept_number, typeset_sum
from fvi_cli.reports.kinds.vibration import magnitude_label
from fvi_cli.reports.naming import key_label, with_unit
from fvi_cli.studies.vibration.modes import ModeTable
from fvi_cli.studies.vibration.response import ResponseTable

Table = TypeVar("Table", ModeTable, ResponseTable)

MOST_NUMBERED = 12
"""Up to so many modes are numbered in a figure."""


def mode_figures(name: str, tables: Sequence[ModeTable]) -> dict[str, Figure]:
    """A figure of the spectrum of every experiment, by the name of its files."""
    groups = _by_experiment(name, tables)
    return {f"{title}-modes": spectrum_figure(own) for title, own in groups.items()}


def response_figures(name: str, tables: Sequence[ResponseTable]) -> dict[str, Figure]:
    """A figure of the response of every experiment, by the name of its files."""
    groups = _by_experiment(name, tables)
    return {f"{title}-response": response_figure(own) for title, own in groups.items()}


def _by_experiment(name: str, tables: Sequence[Table]) -> dict[str, list[Table]]:
    """Tables of each experiment (of all members of a sweep) by the name of their files."""
    groups: dict[str, list[Table]] = {}
    for table in tables:
        groups.setdefault(table.name, []).append(table)
    return groups if len(groups) > 1 else {name: list(tables)}


def _numbers(tables: Sequence[ModeTable] | Sequence[ResponseTable]) -> tuple[list[float], str]:
    """Numbers that colours show for many members (swept or member number), and their name."""
    if len(tables) <= MOST_LINES:
        return [math.nan] * len(tables), ""
    swept = [number for one in tables if (number := swept_number(one.of_member)) is not None]
    member = tables[0].of_member
    if member is None or len(swept) < len(tables):
        return list(map(float, range(1, len(tables) + 1))), "member"
    return swept, key_label(next(iter(member.unnamed)), tables[0].units)


@journal_style()
def spectrum_figure(tables: Sequence[ModeTable]) -> Figure:
    """Frequency against decay rate above, damping ratio against frequency below.

    Modes that grow lie to the right of the axis, or below it in the lower panel. For more than 6
    members a colour bar shows the swept number.
    """
    units, is_one = tables[0].units, len(tables) == 1
    numbers, bar = _numbers(tables)
    upper, lower = [], []
    for place, (table, by) in enumerate(zip(tables, numbers, strict=True)):
        colour = COLOURS[place % len(COLOURS)]
        marker = "o" if bar else MARKERS[place]
        dots = Look(colour=colour, marker=marker, has_line=False, size=3.5)
        label = "_modes" if is_one or bar else table.member or table.name
        hertz = np.array([mode.hertz for mode in table.modes])
        rate = np.array([-mode.decay_rate for mode in table.modes])
        ratio = 100.0 * np.array([mode.damping_ratio for mode in table.modes])
        upper.append(Curve(x=rate, y=hertz, label=label, by=by, look=dots))
        stems = np.stack([0.0 * ratio, ratio, np.full(ratio.size, np.nan)], axis=1).ravel()
        stem = Look(colour=colour, width=0.8)
        lower.append(Curve(x=np.repeat(hertz, 3), y=stems, label="_stems", by=by, look=stem))
        lower.append(Curve(x=hertz, y=ratio, label=f"_{label}", by=by, look=dots))
    frequency, growth = r"frequency $\mathrm{Im}\, s / 2\pi$", r"growth rate $\mathrm{Re}\, s$"
    figure = plane(
        [
            Panel(
                curves=upper,
                x=with_unit(growth, units, "rate"),
                y=with_unit(frequency, units, "frequency"),
                height=2.3,
            ),
            Panel(
                curves=lower,
                x=with_unit("frequency", units, "frequency"),
                y="damping ratio (%)",
                height=1.6,
                levels=(0.0,),
            ),
        ],
        bar=bar,
    )
    above, below = figure.axes[:2]
    for number, mode in enumerate(tables[0].modes[:MOST_NUMBERED] if is_one else ()):
        gaps = [one.hertz - mode.hertz for one in tables[0].modes if one is not mode]
        # on the side of a stem that is opposite to the nearest other stem
        side = -math.copysign(1.0, min(gaps, key=abs, default=1.0))
        places = (-mode.decay_rate, mode.hertz), (mode.hertz, 100.0 * mode.damping_ratio)
        for axes, at, to in zip((above, below), places, ((-3, -3), (3 * side, 0)), strict=True):
            text = axes.annotate(str(number + 1), at, xytext=to)
            text.set(ha="right" if to[0] < 0 else "left", va="bottom")
            text.set(fontsize="small", color=INK)
            text.anncoords = "offset points"
    above.axvline(0.0, color=GUIDE_COLOUR, linewidth=0.6)
    rates = np.concatenate([curve.x for curve in upper])
    highest = max(curve.y.max() for curve in upper)
    wide = 0.06 * max(1e-3 * highest, np.abs(rates).max())
    above.set_xlim(min(1.12 * rates.min(), -wide) - wide, max(1.12 * rates.max(), wide))
    above.set_ylim(0.0, 1.08 * highest)
    below.set_xlim(0.0, 1.05 * highest)
    ratios = np.concatenate([curve.y for curve in lower])
    below.set_ylim(min(1.15 * np.nanmin(ratios), 0.0), max(1.15 * np.nanmax(ratios), 1e-6))
    figure.align_ylabels([above, below])
    return figure


def response_figure(tables: Sequence[ResponseTable]) -> Figure:
    """Magnitude with half-power widths of its peaks above, phase below.

    For more than 6 members a colour bar shows the swept number.
    """
    first, is_one = tables[0], len(tables) == 1
    numbers, bar = _numbers(tables)
    upper, lower, widths = [], [], []
    for place, (table, by) in enumerate(zip(tables, numbers, strict=True)):
        for index, output in enumerate(table.outputs):
            look = Look(
                colour=COLOURS[(index if is_one else place) % len(COLOURS)],
                dashes=LINE_STYLES[index % len(LINE_STYLES)],
                width=0.8 if bar else None,
            )
            words = [typeset_sum(output)] if is_one or len(table.outputs) > 1 else []
            words += [] if is_one or bar else [table.member]
            label = ", ".join(words) or "_members"
            size, phase = table.magnitude[:, index], table.phase[:, index]
            upper.append(Curve(x=table.hertz, y=size, label=label, by=by, look=look))
            lower.append(Curve(x=table.hertz, y=phase, label=label, by=by, look=look))
            mark = Look(colour=look.colour, marker="|", size=4.0)
            widths += [
                Curve(
                    x=np.array([peak.low, peak.high]),
                    y=np.full(2, peak.magnitude / math.sqrt(2.0)),
                    label="half-power width",
                    by=by,
                    look=mark,
                )
                for peak in table.peaks
                if peak.at == output and np.isfinite(peak.high - peak.low)
            ]
    steps = np.diff(first.hertz)
    what = load_in_words(first.load)
    figure = over_time(
        [
            Panel(curves=[*upper, *widths], y=magnitude_label(first), is_log=True, height=2.3),
            Panel(curves=lower, y="phase (degrees)", height=1.4),
        ],
        x=with_unit("frequency", first.units, "frequency"),
        span=(float(first.hertz[0]), float(first.hertz[-1])),
        logarithmic=bool(steps[-1] > 2.0 * steps[0]),
        title=f"load: {what}",
        # with several outputs the load stands above their legend
        bar=f"{bar}; load: {what}" if bar and len(first.outputs) == 1 else bar,
    )
    step = 90.0 * max(max(1, round(float(np.ptp(one.phase)) / 450.0)) for one in tables)
    figure.axes[1].yaxis.set_major_locator(MultipleLocator(step))
    return figure
