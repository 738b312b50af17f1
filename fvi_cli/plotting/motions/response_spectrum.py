"""Response spectra: the largest displacement of oscillators of many periods under one record."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.plotting.motions.labels import finest_of_first
from fvi_cli.plotting.style import COLOURS, LINE_STYLES, journal_style, new_figure, short_numbers
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.members import Member, value_in_words

OF_PERIOD = ("mass", "stiffness")
"""Ends of the keys that change the period; lines differ in the others."""


def response_spectrum_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    r"""Largest displacement, and :math:`\omega^2` times it, against the period without damping.

    A line for every combination of the other swept values; of the runs those of the first method
    on the finest grid.

    Raises
    ------
    ValueError
        If a member has more degrees of freedom, or nothing that swings.
    """
    lines: dict[str, list[tuple[float, float]]] = {}
    for one in finest_of_first(finished):
        largest = float(np.abs(one.trajectory.position).max())
        if (member := one.run.member) is not None:
            lines.setdefault(_label(member), []).append((period(member), largest))
    with journal_style():
        figure = new_figure(4.2 + 0.17 * len(lines))
        upper, lower = figure.subplots(2, 1, sharex=True)
        for index, (label, points) in enumerate(lines.items()):
            at, largest = np.array(sorted(points)).T
            colour = COLOURS[index % len(COLOURS)]
            style = LINE_STYLES[(index // len(COLOURS)) % len(LINE_STYLES)]
            upper.plot(at, largest, color=colour, linestyle=style, label=label)
            lower.plot(at, (2 * math.pi / at) ** 2 * largest, color=colour, linestyle=style)
        lower.set_xscale("log")
        short_numbers(lower.xaxis)
        upper.set_ylim(bottom=0.0)
        lower.set_ylim(bottom=0.0)
        upper.set_ylabel(r"displacement $\max |x|$")
        lower.set_ylabel(r"pseudo-acceleration $\omega^2 \max |x|$")
        lower.set_xlabel("period without damping")
        if any(lines):
            figure.legend(*upper.get_legend_handles_labels(), loc="outside upper center")
    return figure


def period(member: Member) -> float:
    r"""The period :math:`2 \pi \sqrt{m / k}` of a member.

    Raises
    ------
    ValueError
        If it has more than one degree of freedom, or no spring.
    """
    scene = build_scene(member.specification)
    if scene.dimension != 1 or not isinstance(scene.potential, QuadraticPotential):
        raise ValueError("spectrum: a member is no oscillator of one degree of freedom")
    square = float(scene.potential.stiffness[0, 0]) / float(scene.inertia.mass[0, 0])
    if not square > 0:
        raise ValueError("spectrum: a member has no spring that pulls back")
    return 2.0 * math.pi / math.sqrt(square)


def _label(member: Member) -> str:
    """What tells a line from the others; empty where only periods differ."""
    others = [
        (key, value)
        for key, value in member.values.items()
        if key.removeprefix("problem.") not in OF_PERIOD
    ]
    words = [f"{key.removeprefix('problem.')} = {value_in_words(value)}" for key, value in others]
    return ", ".join(words)
