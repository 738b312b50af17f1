"""Two looks for forces that act between the points of a step.

A force F that acts unseen for a time d moves a scene by F d (T - t) / M until its end. Formulas of
the time are sampled once a scene; forces of the motion are evaluated along the path of every step.
The sum over those samples that a step's own interpolation misses by far is what the step may miss.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.effects.sampled import FunctionForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.forces import Places, StepForces, StepPath
from fvi_cli.integrator.tables import StepTables
from fvi_cli.mathematics.algebra.arithmetic import KINKED
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array, Integers
from fvi_cli.mathematics.expressions import Expression

SAMPLES: Final = 65_536  # times of a run at which formulas of the time are sampled
EVERY: Final = 64
"""A spline through every so many samples tells most of the others; these are left out."""
TOLD: Final = 1e-6
"""A sample is told by the spline up to this share of the largest."""
PLACES: Final = 8_192  # places of a run at which forces of the motion are evaluated
BEYOND: Final = 10.0
"""Samples count that are missed by more than so many times the median of their step."""
STEEP: Final = frozenset({"exp", "expm1", "tanh", "arctan", "cosh", "sinh", "gamma"})
"""Functions of which walls and pulses are made."""
GENTLE: Final = ("number", "variable", "+", "-", "*", "negate", "sin", "cos")
"""Operations that cannot rise and fall between two samples without a trace in these."""
LARGEST_GENTLE_POWER: Final = 8.0  # higher powers count as steep


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledFormula:
    """A formula of the time in one piece of a force."""

    formula: Expression
    weights: Array  # of its force on every coordinate, (d,)
    times: Array  # of the samples in the piece, ascending, and the values there
    values: Array
    kept: Integers  # numbers of the samples that are left where most are told by a spline


@lru_cache(maxsize=8)
def sample_forcing(forcing: Forcing, final_time: float) -> tuple[SampledFormula, ...]:
    """Samples of formulas that may hide a pulse; values that are not finite are left out."""
    spacing, begin, found = final_time / SAMPLES, 0.0, []
    for piece in forcing.pieces:
        end = min(piece.until, final_time)
        inside = spacing * (np.arange(round(begin / spacing), round(end / spacing)) + 0.5)
        for formula, weights in zip(piece.components, piece.weights.T, strict=True):
            if not isinstance(formula, Expression) or not may_hide(formula.bound):
                continue
            with np.errstate(all="ignore"):
                values = np.broadcast_to(formula.evaluate({"t": inside}), inside.shape)
            times, values = inside[np.isfinite(values)], values[np.isfinite(values)]
            found.append(
                SampledFormula(
                    formula=formula,
                    weights=weights,
                    times=times,
                    values=values,
                    kept=_not_told(times, values),
                )
            )
        begin = end
    return tuple(found)


def _not_told(times: Array, values: Array) -> Integers:
    """Samples with a spline through some of them, and those that it does not tell."""
    # most scenes need no spline
    from scipy.interpolate import CubicSpline

    is_kept = np.arange(times.size) % EVERY == 0
    is_kept[-1:] = True
    if is_kept.sum() < 4:
        return np.arange(times.size)
    told = CubicSpline(times[is_kept], values[is_kept])(times)
    return np.flatnonzero(is_kept | (np.abs(told - values) > TOLD * np.abs(values).max()))


class Looks:
    """Looks at the steps of one run."""

    def __init__(self, scene: Scene, forces: StepForces, tables: StepTables) -> None:
        self._forces, self._end = forces, scene.final_time
        self._basis, self._stages = tables.stage_basis, tables.points
        self._sampled: tuple[SampledFormula, ...] = ()
        if scene.forcing is not None:
            self._sampled = sample_forcing(scene.forcing, scene.final_time)
        self._is_nonlinear = not scene.is_linear

    def missed(self, path: StepPath, at_stages: Array) -> Array:
        """The impulse that a step misses, ``(d,)``, with the forces at its stages ``(m, d)``."""
        h, t, spacing = path.size, path.begin, self._end / SAMPLES
        impulse = np.zeros(path.position.size)
        if self._is_nonlinear:
            impulse += self._along(path, at_stages)
        for one in self._sampled:
            low, high = np.searchsorted(one.times, (t, t + h))
            at, usual = np.arange(low, high), slice(None)
            if h >= 16 * EVERY * spacing:
                first, last = np.searchsorted(one.kept, (low, high))
                at = one.kept[first:last]
                usual = at % EVERY == 0
            if not at[usual].size:
                continue
            seen = one.formula.evaluate({"t": t + h * self._stages})
            told = np.broadcast_to(seen, self._stages.shape) @ self._basis.values(
                (one.times[at] - t) / h
            )
            off = np.abs(one.values[at] - told)
            impulse += spacing * _far_off(off, np.median(off[usual])) * np.abs(one.weights)
        return impulse

    def _along(self, path: StepPath, at_stages: Array) -> Array:
        """Impulses of forces of the motion, along its own path, ``(d,)``."""
        count = math.ceil(PLACES * path.size / self._end)
        if count < 2:
            return np.zeros(path.position.size)
        at = (np.arange(count) + 0.5) / count
        _, force = self._forces.at(path, Places.of(len(path.unknowns), at))
        off = np.abs(force - self._basis.values(at).T @ at_stages)
        return path.size / count * _far_off(off, np.median(off, axis=0))


def _far_off(off: Array, usual: Array) -> Array:
    """The sum of differences that are far beyond the usual one."""
    return np.asarray(np.where(off <= BEYOND * usual, 0.0, off).sum(axis=0))


def formulas_of(scene: Scene) -> Iterator[FormulaSystem]:
    """The formulas of the forces of a scene."""
    if isinstance(scene.potential, ExpressionPotential):
        yield scene.potential.gradient_system
    if scene.lagrangian is not None:
        yield scene.lagrangian.first
    for component in () if scene.forcing is None else scene.forcing.components:
        if isinstance(component, Expression):
            yield component.bound


def has_kinks(scene: Scene) -> bool:
    """Whether forces call functions with kinks, or are Python functions, which may have some."""
    forces = () if scene.forcing is None else scene.forcing.components
    is_unknown = any(isinstance(one, FunctionForce) for one in forces)
    return is_unknown or any(one.called & set(KINKED) for one in formulas_of(scene))


def is_steep(scene: Scene) -> bool:
    """Whether forces have kinks, or may be as steep as walls and pulses."""
    return has_kinks(scene) or any(one.called & STEEP for one in formulas_of(scene))


def may_hide(system: FormulaSystem) -> bool:
    """Whether a program has anything other than sines and polynomials of low degree."""
    for place in system.needed:
        kind, *rest = system.instructions[place]
        is_gentle = kind in GENTLE
        if kind == "/":
            is_gentle = system.instructions[int(rest[1])][0] == "number"
        elif kind == "**":
            exponent = float(rest[1])
            is_gentle = exponent.is_integer() and 0 <= exponent <= LARGEST_GENTLE_POWER
        if not is_gentle:
            return True
    return False
