"""Damping of modes over their frequencies, and magnitude and phase of harmonic responses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.plotting.draw import figure, lines
from fvi_cli.plotting.kinds.runs import distinguish
from fvi_cli.plotting.panels import Curve, Panel
from fvi_cli.plotting.style import Look, cycled, dots
from fvi_cli.plotting.words import load_in_words
from fvi_cli.reports.kinds.vibration import magnitude_label
from fvi_cli.reports.naming import with_unit
from fvi_cli.studies.vibration.modes import ModeTable
from fvi_cli.studies.vibration.response import Peak, ResponseTable

Table = TypeVar("Table", ModeTable, ResponseTable)

_MOST_NUMBERED = 12  # up to so many modes are numbered, and so many peaks have their loss factor


def mode_figures(name: str, tables: Sequence[ModeTable]) -> dict[str, Figure]:
    """A figure of the modes of every experiment, by the name of its files."""
    return {f"{own}-modes": modes_figure(few) for own, few in _by_experiment(name, tables)}


def response_figures(name: str, tables: Sequence[ResponseTable]) -> dict[str, Figure]:
    """A figure of the response of every experiment, by the name of its files."""
    return {f"{own}-response": response_figure(few) for own, few in _by_experiment(name, tables)}


def _by_experiment(name: str, tables: Sequence[Table]) -> list[tuple[str, list[Table]]]:
    """Tables of each experiment (of all members of a sweep) by the name of their files."""
    names = dict.fromkeys(one.name for one in tables)
    groups = [(own, [one for one in tables if one.name == own]) for own in names]
    return groups if len(groups) > 1 else [(name, list(tables))]


def modes_figure(tables: Sequence[ModeTable]) -> Figure:
    """Poles of every mode; below the damping ratio over frequency, on a stem, with its number."""
    names, titles = distinguish([one.of_member for one in tables], tables[0].units)
    poles: list[Curve] = []
    curves: list[Curve] = []
    for place, (table, words) in enumerate(zip(tables, names, strict=True)):
        hertz = np.array([mode.hertz for mode in table.modes])
        growth = np.array([mode.frequency.real for mode in table.modes])
        ratio = 100.0 * np.array([mode.damping_ratio for mode in table.modes])
        most = _MOST_NUMBERED * (len(tables) == 1)
        own = {**words, "look": dots(cycled(place).colour, 3.5)}
        for few, x, y in ((poles, growth, hertz), (curves, hertz, ratio)):
            numbers = enumerate(zip(x.tolist(), y.tolist(), strict=True), start=1)
            marks = [(*point, str(number)) for number, point in numbers][:most]
            few.append(Curve(x=x, y=y, **own, marks=marks))
        own |= {"look": Look(colour=own["look"].colour, width=0.8), "label": ""}
        stems = np.outer(ratio, (0.0, 1.0, np.nan)).ravel()
        curves.append(Curve(x=hertz.repeat(3), y=stems, **own))
    frequency = with_unit("frequency", tables[0].units, "frequency")
    growth_rate = with_unit(r"growth rate $\mathrm{Re}\,s$", tables[0].units, "rate")
    upper = Panel(curves=poles, x=growth_rate, y=frequency)
    lower = Panel(curves=curves, x=frequency, y="damping ratio (%)", levels=[0.0])
    return figure([upper, lower], lines, height=(2.0, 1.6), **titles)


def response_figure(tables: Sequence[ResponseTable]) -> Figure:
    """Magnitude above, phase below.

    The first output of a single response has half-power widths with loss factors beside them.
    """
    first, is_one = tables[0], len(tables) == 1
    names, titles = distinguish([one.of_member for one in tables], tables[0].units)
    upper, lower = [], []
    for place, (table, words) in enumerate(zip(tables, names, strict=True)):
        for index, output in enumerate(table.outputs):
            own = {"look": cycled(index if is_one else place), **words}
            if "by" not in own and (is_one or len(table.outputs) > 1):
                own["label"] = ", ".join(filter(None, [output, words.get("label")]))
            peaks = [peak for peak in table.peaks if is_one and peak.at == output and index == 0]
            upper.append(Curve(x=table.hertz, y=table.magnitude[:, index], **own))
            lower.append(replace(upper[-1], y=table.phase[:, index] / 180.0, label=""))
            found = [peak for peak in peaks if math.isfinite(peak.loss_factor)]
            upper += [_half_power(peak, cycled(index).colour) for peak in found[:_MOST_NUMBERED]]
    steps = np.diff(first.hertz)
    log = "x" * bool(steps[-1] > 2.0 * steps[0])
    x = with_unit("frequency", first.units, "frequency")
    ends = (float(first.hertz[0]), float(first.hertz[-1]))
    panels = [
        Panel(curves=upper, y=magnitude_label(first), x=x, log=f"{log}y", xlim=ends),
        Panel(curves=lower, y=r"phase ($\pi$)", x=x, log=log, xlim=ends),
    ]
    heading = ", ".join(filter(None, [f"load: {load_in_words(first.load)}", titles.get("heading")]))
    return figure(panels, lines, height=(2.3, 1.2), sharex=True, **{**titles, "heading": heading})


def _half_power(peak: Peak, colour: str) -> Curve:
    ends, height = np.array([peak.low, peak.high]), peak.magnitude / math.sqrt(2.0)
    look = Look(colour=colour, marker="|", width=0.8, size=4.0)
    words = (peak.high, height, rf"$\eta = {peak.loss_factor:.2g}$")
    return Curve(x=ends, y=np.full(2, height), look=look, marks=[words])
