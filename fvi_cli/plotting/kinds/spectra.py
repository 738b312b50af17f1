"""Damping of modes over their frequencies, and magnitude and phase of harmonic responses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.draw import figure, lines
from fvi_cli.plotting.kinds.members import MOST_NAMED
from fvi_cli.plotting.looks import Look, cycled
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.style import COLOURS
from fvi_cli.plotting.words import load_in_words, swept_number, typeset_sum
from fvi_cli.reports.kinds.vibration import magnitude_label
from fvi_cli.reports.naming import key_label, with_unit
from fvi_cli.studies.vibration.modes import ModeTable
from fvi_cli.studies.vibration.response import ResponseTable

Table = TypeVar("Table", ModeTable, ResponseTable)

MOST_NUMBERED = 12
"""Up to so many modes are numbered, and so many peaks have their loss factor."""


def mode_figures(name: str, tables: Sequence[ModeTable]) -> dict[str, Figure]:
    """A figure of the modes of every experiment, by the name of its files."""
    groups = _by_experiment(name, tables)
    return {f"{title}-modes": modes_figure(own) for title, own in groups.items()}


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
    if len(tables) <= MOST_NAMED:
        return [math.nan] * len(tables), ""
    swept = [number for one in tables if (number := swept_number(one.of_member)) is not None]
    member = tables[0].of_member
    if member is None or len(swept) < len(tables):
        return list(map(float, range(1, len(tables) + 1))), "member"
    return swept, key_label(next(iter(member.unnamed)), tables[0].units)


def modes_figure(tables: Sequence[ModeTable]) -> Figure:
    """Damping ratio over frequency of every mode, on a stem with its number."""
    units, is_one = tables[0].units, len(tables) == 1
    numbers, bar = _numbers(tables)
    curves = []
    for place, (table, by) in enumerate(zip(tables, numbers, strict=True)):
        hertz = np.array([mode.hertz for mode in table.modes])
        ratio = 100.0 * np.array([mode.damping_ratio for mode in table.modes])
        stems = np.stack([0.0 * ratio, ratio, np.full(ratio.size, np.nan)], axis=1).ravel()
        colour = cycled(place).colour
        label = "" if is_one or bar else table.member or table.name
        named = zip(hertz, ratio, strict=True) if is_one else ()
        curves += [
            Curve(x=np.repeat(hertz, 3), y=stems, by=by, look=Look(colour=colour, width=0.9)),
            Curve(
                x=hertz,
                y=ratio,
                by=by,
                label=label,
                look=Look(colour=colour, marker="o", has_line=False, size=3.5),
                marks=[
                    (float(x), float(y), str(number))
                    for number, (x, y) in enumerate(list(named)[:MOST_NUMBERED], start=1)
                ],
            ),
        ]
    panel = Panel(
        curves=curves,
        x=with_unit("frequency", units, "frequency"),
        y="damping ratio (%)",
        levels=[0.0],
        xlim=(0.0, 1.06 * max(float(curve.x.max()) for curve in curves)),
    )
    return figure([[panel]], lines, height=2.0, bar=bar)


def response_figure(tables: Sequence[ResponseTable]) -> Figure:
    """Magnitude with half-power widths of its peaks above, phase below.

    A single response has the loss factors beside its peaks.
    """
    first, is_one = tables[0], len(tables) == 1
    numbers, bar = _numbers(tables)
    upper, lower = [], []
    for place, (table, by) in enumerate(zip(tables, numbers, strict=True)):
        for index, output in enumerate(table.outputs):
            look = Look(colour=COLOURS[(index if is_one else place) % len(COLOURS)])
            look = Look(colour=look.colour, width=0.8) if bar else look
            words = [typeset_sum(output)] if is_one or len(table.outputs) > 1 else []
            words += [] if is_one or bar else [table.member]
            peaks = [peak for peak in table.peaks if peak.at == output]
            upper.append(
                Curve(
                    x=table.hertz,
                    y=table.magnitude[:, index],
                    label=", ".join(words),
                    by=by,
                    look=look,
                    spans=[
                        (peak.low, peak.high, peak.magnitude / math.sqrt(2.0))
                        for peak in peaks
                        if is_one and math.isfinite(peak.high - peak.low)
                    ],
                    marks=[
                        (peak.hertz, peak.magnitude, rf"$\eta = {peak.loss_factor:.2g}$")
                        for peak in peaks[:MOST_NUMBERED]
                        if is_one and index == 0 and math.isfinite(peak.loss_factor)
                    ],
                )
            )
            phase = table.phase[:, index] / 180.0
            lower.append(Curve(x=table.hertz, y=phase, by=by, look=look))
    steps = np.diff(first.hertz)
    log = "x" * bool(steps[-1] > 2.0 * steps[0])
    x = with_unit("frequency", first.units, "frequency")
    ends = (float(first.hertz[0]), float(first.hertz[-1]))
    rows = [
        [Panel(curves=upper, y=magnitude_label(first), x=x, log=f"{log}y", xlim=ends)],
        [Panel(curves=lower, y=r"phase ($\pi$)", x=x, log=log, xlim=ends)],
    ]
    heading = f"load: {load_in_words(first.load)}"
    return figure(rows, lines, height=(2.3, 1.2), sharex=True, heading=heading, bar=bar)
