"""Damping terms and laws of many scenes, along the matrices on which they act."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.convolution.directions import scale_and_direction
from fvi_cli.integrator.convolution.kernel import Term
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.mathematics.arrays import Array, Places

LARGEST_EXPONENT = math.nextafter(1.0, 0.0)
SAME = 1e-14
"""Entries of matrices of the same direction differ by no more than this part."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Direction:
    """Terms that act along one matrix of every member.

    Parameters
    ----------
    matrix
        D, ``(q, e, e)``.
    terms, factors
        What is remembered, and its factors.
    rate
        Factor of the velocity itself, for order 1 by Runge-Kutta methods.
    is_relative
        Whether the start velocity is subtracted: Caputo derivatives of order above 1.
    """

    matrix: Array
    terms: tuple[Term, ...]
    factors: tuple[float, ...]
    rate: float
    is_relative: bool

    def of(self, places: Places) -> Direction:
        """Those of some members."""
        return replace(self, matrix=self.matrix[places])


def directions_of(
    scenes: Sequence[Scene], modes: Sequence[Decoupling] | None, *, has_order_one: bool
) -> tuple[Direction, ...]:
    """Forces of scenes that have as many in the same order.

    Parameters
    ----------
    scenes, modes
        The scenes, and the coordinates in which each falls apart; None: they do not.
    has_order_one
        Whether order 1 is one of the terms: for backward differences.
    """
    found: list[Direction] = []
    known: list[tuple[Array, Array]] = []
    caputo = scenes[0].derivative == "caputo" and any(np.any(s.initial_velocity) for s in scenes)
    for forces in zip(*[one.active_forces for one in scenes], strict=True):
        first = forces[0]
        terms: tuple[Term, ...] = ()
        rate, is_relative = 0.0, False
        scales = [scale_and_direction(one) for one in forces]
        sizes = np.array([scale for scale, _ in scales])
        if isinstance(first, FractionalDamping):
            is_relative = caputo and first.order > 1
            if first.order == 1 and not has_order_one:
                rate = 1.0
            else:
                terms = (min(1.0 - first.order, LARGEST_EXPONENT),)
        else:
            terms = (first.kernel,)
            sizes = sizes * [one.size for one in forces]
        if modes is None:
            base = np.array([dense(matrix) for _, matrix in scales])
        else:
            pairs = zip(modes, scales, strict=True)
            base = np.concatenate([mode.matrices(dense(matrix)) for mode, (_, matrix) in pairs])
        sizes = np.repeat(sizes, len(base) // len(sizes))
        for place, (other, own) in enumerate(known):
            ratio = sizes / own
            same = found[place].is_relative == is_relative and bool(np.all(ratio == ratio[0]))
            if same and np.allclose(other, base, rtol=SAME, atol=0):
                one = found[place]
                found[place] = replace(
                    one,
                    terms=one.terms + terms,
                    factors=one.factors + (float(ratio[0]),) * len(terms),
                    rate=one.rate + rate * float(ratio[0]),
                )
                break
        else:
            known.append((base, sizes))
            found.append(
                Direction(
                    matrix=base * sizes[:, None, None],
                    terms=terms,
                    factors=(1.0,) * len(terms),
                    rate=rate,
                    is_relative=is_relative,
                )
            )
    return tuple(found)
