"""Response spectra: the largest displacement of oscillators of many periods under one record."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.panels import over_time
from fvi_cli.plotting.words import with_unit
from fvi_cli.reports.naming import key_in_words
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.experiment import Experiment, FinishedRun, finest_of_members
from fvi_cli.studies.members import Member, value_in_words

OF_PERIOD = ("problem.mass", "problem.stiffness")
"""Keys that change the period; lines differ in the others."""


def response_spectrum_figure(experiment: Experiment, finished: Sequence[FinishedRun]) -> Figure:
    r"""Largest displacement, and :math:`\omega^2` times it, against the period without damping.

    A line for every combination of the other swept values; of the runs those of the first method
    on the finest grid.

    Raises
    ------
    ValueError
        If a member has more degrees of freedom, or nothing that swings.
    """
    others = [key for key in experiment.swept if key not in OF_PERIOD]
    lines: dict[str, list[tuple[float, float]]] = {}
    for one in finest_of_members(finished):
        if (member := one.run.member) is not None:
            label = ", ".join(value_in_words(member.values[key]) for key in others)
            largest = float(np.abs(one.trajectory.position).max())
            lines.setdefault(label, []).append((period(member), largest))
    points = {label: np.array(sorted(own)).T for label, own in lines.items()}
    upper = [Curve(x=at, y=most, label=label) for label, (at, most) in points.items()]
    lower = [
        Curve(x=at, y=(2 * math.pi / at) ** 2 * most, label=label)
        for label, (at, most) in points.items()
    ]
    units = experiment.units
    acceleration = r"pseudo-acceleration $\omega^2 \max |x|$"
    return over_time(
        [
            Panel(curves=upper, y=with_unit(r"displacement $\max |x|$", units, "length")),
            Panel(curves=lower, y=with_unit(acceleration, units, "acceleration")),
        ],
        x=with_unit("period without damping", units, "time"),
        logarithmic=True,
        from_zero=True,
        title=", ".join(key_in_words(key) for key in others),
    )


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
