"""What the engine asks of a memory, whichever method made it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from fvi_cli.integrator.convolution.stages import BlockHistory
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Kernels:
    """What B equal steps are to the memory, for each of its terms.

    With m samples of the force and i inputs a step, and J states:

    Parameters
    ----------
    local
        Force at the samples by the inputs of their own step, ``(n_terms, m, i)``.
    lags
        The same by those 1 to B - 1 steps before, ``(n_terms, B - 1, m, i)``.
    response
        Force by the states at the beginning, ``(n_terms, B m, J)``.
    block
        Of what made them.
    """

    local: Array
    lags: Array
    response: Array
    block: BlockHistory


class Memory(Protocol):
    """The past of all terms by a number of states.

    Attributes
    ----------
    n_states
        Number J of states of each component.
    column
        Input by which a start velocity of 1 is subtracted, ``(i,)``; None: it is none.
    column_start
        What the states of that column are at the start.
    """

    n_states: int
    column: Array | None
    column_start: float

    def kernels(self, h: float, count: int) -> Kernels:
        """For `count` steps of length h."""

    def push(self, kernels: Kernels, z: Array, inputs: Array, count: int) -> Array:
        """States ``(q, J, e)`` after the first `count` steps, driven by ``(q, count i, e)``."""

    def change_of_all(self, kernels: Kernels, count: int) -> Array:
        """The matrix by which states change over `count` steps without inputs, ``(J, J)``."""
