"""The state on which later steps depend, and the results of solved steps."""

from __future__ import annotations

from dataclasses import dataclass

from fvi_cli.integrator.engine.newton import Linearised
from fvi_cli.mathematics.arrays import Array, Integers, Mask


@dataclass(eq=False, kw_only=True)
class State:
    """Everything that later steps depend on; arrays are replaced, never written."""

    t: float
    x: Array  # positions and momenta, (q, e), and rounding errors of their sums (Kahan)
    p: Array
    x_lost: Array
    p_lost: Array
    z: Array  # states of the memory, (q, J, e)
    column: Array  # states of a start velocity of -1 (memory/damping.py), (1, J, 1)
    live: Mask  # members that have not failed, (q,)
    unknowns: Array | None = None  # U of the last step, for a guess, (q, s, e)
    h: float = 0.0  # length of the last step
    rest: Array | None = None  # last remainders of the last step, (q, w)
    block: Linearised | None = None  # equations of nonlinear blocks, kept from block to block
    excess: int = 0  # iterations beyond the usual number, summed over blocks
    single: int = 0  # number of steps ahead, of a failed block, that are solved one by one


@dataclass(eq=False, kw_only=True)
class Steps:
    """Results of solving B steps of length h."""

    h: float
    count: int  # number B
    dx: Array  # changes from the beginning of the block, (q, B, e)
    dp: Array
    unknowns: Array  # U, (q, B, s, e)
    z: Array  # states of the memory after the steps, (q, J, e), and of a start velocity of -1
    column: Array
    failed: Mask  # members whose equations have no solution, (q,)
    iterations: Integers  # of Newton, (q,)
    finite: Mask | None = None  # whether Newton's last points are finite, (q,)
    rest: Array | None = None  # remainders at the points, (q, B r, w); None for linear scenes


def compensated(value: Array, lost: Array, change: Array) -> tuple[Array, Array]:
    """Add by Kahan's compensated sum (1965): the value, and its rounding error."""
    corrected = change - lost
    total = value + corrected
    return total, (total - value) - corrected
