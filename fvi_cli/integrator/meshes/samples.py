"""Samples of forces by formulas of the time, in which pulses show that steps would miss."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from fvi_cli.effects.forcing import formula_of
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array, Mask, Places
from fvi_cli.mathematics.expressions import Expression

SAMPLES: Final = 65_536  # times of a run at which formulas of the time are sampled
EVERY: Final = 64
"""A spline through every so many samples tells most of the others; these are left out."""
TOLD: Final = 1e-6
"""A sample is told by the spline up to this share of the largest."""
GENTLE_FUNCTIONS: Final = frozenset({"sin", "cos"})
"""Functions that cannot rise and fall between two samples without a trace in these."""
GENTLE_KINDS: Final = ("number", "variable", "+", "-", "*", "negate")
LARGEST_GENTLE_POWER: Final = 8.0  # higher powers count as steep


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledFormula:
    """A formula of the time in one piece of a force."""

    formula: Expression
    begin: float  # where the piece begins and ends
    end: float
    times: Array  # of the samples, ascending, and the values there
    values: Array
    kept: Places  # samples that are left where most are told by a spline
    is_coarse: Mask  # which of these the spline goes through


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceSamples:
    """Samples of the formulas of the time of a scene that may hide a pulse."""

    spacing: float
    formulas: tuple[SampledFormula, ...]


def sample_forces(scene: Scene) -> ForceSamples:
    """Sample the force of a scene; values that are not finite are left out."""
    spacing, begin, found = scene.final_time / SAMPLES, 0.0, []
    for piece in () if scene.forcing is None else scene.forcing.pieces:
        for component, _ in piece.distinct:
            formula = formula_of(component)
            if formula is None or not may_hide(formula.bound):
                continue
            first, last = np.rint(
                np.array([begin, piece.until]).clip(0, scene.final_time) / spacing
            )
            inside = spacing * (np.arange(first, last) + 0.5)
            with np.errstate(all="ignore"):
                values = np.broadcast_to(formula.evaluate({"t": inside}), inside.shape)
            is_finite = np.isfinite(values)
            times, values = inside[is_finite], values[is_finite]
            kept, is_coarse = _not_told(times, values)
            found.append(
                SampledFormula(
                    formula=formula,
                    begin=begin,
                    end=piece.until,
                    times=times,
                    values=values,
                    kept=kept,
                    is_coarse=is_coarse,
                )
            )
        begin = piece.until
    return ForceSamples(spacing=spacing, formulas=tuple(found))


def _not_told(times: Array, values: Array) -> tuple[Places, Mask]:
    """Samples with a spline through some of them, and those that it does not tell."""
    # most scenes need no spline
    from scipy.interpolate import CubicSpline

    is_coarse = np.zeros(times.size, dtype=bool)
    is_coarse[::EVERY] = True
    is_coarse[-1:] = True
    if is_coarse.sum() < 4:
        return np.arange(times.size), np.ones(times.size, dtype=bool)
    told = CubicSpline(times[is_coarse], values[is_coarse])(times)
    kept = np.flatnonzero(is_coarse | (np.abs(told - values) > TOLD * np.abs(values).max()))
    return kept, is_coarse[kept]


def may_hide(system: FormulaSystem) -> bool:
    """Whether a program has anything other than sines and polynomials of low degree."""
    for place in system.needed:
        kind, *rest = system.instructions[place]
        if kind == "/":
            is_gentle = system.instructions[int(rest[1])][0] == "number"
        elif kind == "**":
            exponent = float(rest[1])
            is_gentle = exponent.is_integer() and 0 <= exponent <= LARGEST_GENTLE_POWER
        else:
            is_gentle = kind in (*GENTLE_KINDS, *GENTLE_FUNCTIONS)
        if not is_gentle:
            return True
    return False
