"""Remarks on valid settings that are surely not meant, each with a number and advice.

All but the first concern buildings and structures, whose numbers have units; problems without
units, as in studies of methods, get no such remarks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.forces import STANDARD_GRAVITY
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.records.inputs import numbers_of
from fvi_cli.scenes.structures.rayleigh import natural_frequencies

BUILDINGS: Final = ("frame", "structure")
STRONGEST: Final = 3.0
"""Peak ground accelerations in units of g above which a scale is likely to be wrong."""
WEAKEST, WEAKEST_IN_G = 1e-3, 0.05
"""Peaks in units of g: a record below the first is no load; a record without a scale below the
second may be in g."""
PERIODS: Final = (0.01, 100.0)
LONGEST_OF_BUILDINGS: Final = 15.0
"""Longest plausible period of a building in seconds; those of 800 m have 12. For few storeys it is
5, as of isolated buildings, plus their number (guessed)."""
LEAST_LOSS: Final = 1e-3
"""A law with a smaller loss factor damps nothing; bare steel has as much."""
MOST_MODES: Final = 400
"""Coordinates up to which all periods are computed."""
_METRES: Final = {"m": 1.0, "cm": 0.01, "mm": 1e-3, "km": 1e3, "in": 0.0254, "ft": 0.3048}


def implausible_settings(
    problem: Problem,
    specified: Mapping[str, Any],
    quantities: Mapping[str, Expression],
    units: Mapping[str, str],
    *,
    is_moved: bool = False,
) -> Iterator[str]:
    """Remarks on a problem, as it was `specified`, and on quantities along its motion.

    `is_moved`: forces outside of the problem move it, as in fits of a response.
    """
    if not is_moved and _is_at_rest(problem.scene):
        yield (
            "problem: it stays at rest: it begins in equilibrium, and no force acts; give "
            "ground_acceleration, forcing or initial (modes and response need none)"
        )
    if problem.kind not in BUILDINGS:
        return
    metres = _METRES.get(units.get("length", "m"), math.nan)
    yield from _of_record(specified.get("ground_acceleration"), metres)
    if problem.kind == "frame":
        yield from _of_laws_to_ground(specified.get("damping"))
        yield from _of_relative_accelerations(problem, quantities)
    yield from _of_periods(problem, units, has_record=_peak(specified) is not None)


def _is_at_rest(scene: Scene) -> bool:
    is_still = not scene.initial_velocity.any() and scene.forcing is None
    if not is_still or scene.prescribed is not None or scene.lagrangian is not None:
        return False
    return scene.potential is None or not np.any(
        scene.potential.gradient(scene.initial_position[None])
    )


def _peak(specified: Mapping[str, Any]) -> tuple[float, float] | None:
    """Largest acceleration of a record of the ground, and its scale; None without a record."""
    given = specified.get("ground_acceleration")
    if not isinstance(given, Mapping) or "digest" not in given:
        return None
    values = numbers_of(given)[:, 1]
    scale = float(given.get("scale", 1.0))
    return float(np.abs(scale * values).max()), scale


def _of_record(given: object, metres: float) -> Iterator[str]:
    found = _peak({"ground_acceleration": given})
    if found is None or not math.isfinite(metres):
        return
    peak, scale = found
    in_g = peak * metres / STANDARD_GRAVITY
    words = f"problem.ground_acceleration: the ground reaches {peak:.4g}, which is {in_g:.3g} g"
    if in_g > STRONGEST:
        yield (f"{words}; for a record in g write scale: g, in cm/s^2 scale: 0.01 (lengths in m)")
    elif in_g < (WEAKEST_IN_G if scale == 1.0 else WEAKEST):
        yield f"{words}; for a record in g write scale: g"


def _of_laws_to_ground(terms: object) -> Iterator[str]:
    for index, term in enumerate(terms if isinstance(terms, list | tuple) else ()):
        if isinstance(term, Mapping) and "law" in term and "acts_on" not in term:
            yield (
                f"problem.damping.{index}: {term['law']} acts on every floor against the ground; "
                "a damper between floors stands under dampers: [{storey: 1, ...}]"
            )


def _of_relative_accelerations(
    problem: Problem, quantities: Mapping[str, Expression]
) -> Iterator[str]:
    ground = "ground_acceleration"
    if problem.inputs.get(ground) is None:
        return
    relative = {f"a{name}" for name in problem.coordinates}
    names = [
        name
        for name, formula in quantities.items()
        if formula.names & relative and ground not in formula.names
    ]
    if names:
        shown = ", ".join(names[:4]) + ", ..." * (len(names) > 4)
        yield (
            f"quantities: {shown}: {min(relative)} and the like are accelerations against the "
            "ground; with it they are acceleration_1, ..., and base_shear is ready as well"
        )


def _of_periods(problem: Problem, units: Mapping[str, str], *, has_record: bool) -> Iterator[str]:
    periods = _periods(problem.scene)
    if not periods.size:
        return
    first = float(periods.max())
    in_seconds = has_record or units.get("time") in ("s", "sec")
    longest = PERIODS[1]
    if in_seconds and problem.kind == "frame":
        longest = min(5.0 + len(problem.coordinates), LONGEST_OF_BUILDINGS)
    if not PERIODS[0] <= first <= longest:
        yield (
            f"problem: the first period is {first:.3g}; are masses and stiffnesses in units that "
            "fit together (kg with N/m, t with kN/m), and not exchanged?"
        )
    rates = 2j * math.pi / periods
    for law in problem.scene.active_laws:
        moduli = law.spring + np.array([law.symbol(complex(s)) for s in rates])
        loss = float((moduli.imag / np.abs(moduli)).max())
        if loss < LEAST_LOSS:
            yield (
                f"problem: damper {law.name or law.number} damps nothing: its loss factor is "
                f"{loss:.1g} at most at periods of {periods.min():.3g} to {first:.3g}; is its time "
                "constant in the same unit?"
            )


def _periods(scene: Scene) -> Array:
    """Periods without damping, for large structures only the first; may be empty."""
    if not isinstance(scene.potential, QuadraticPotential):
        return np.zeros(0)
    count = scene.dimension if scene.dimension <= MOST_MODES else 1
    try:
        rates = natural_frequencies(scene.inertia.form, scene.potential.form, count)
    except (np.linalg.LinAlgError, RuntimeError):
        # mass or stiffness is singular
        return np.zeros(0)
    rates = rates[np.isfinite(rates) & (rates > 1e-9 * rates.max(initial=0.0))]
    return np.asarray(2.0 * math.pi / rates)
