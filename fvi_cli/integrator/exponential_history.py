r"""History without the past: the weights as a sum of exponentials, one state for each.

The weights of Runge-Kutta convolution quadrature are :math:`w_n = \sum_j c_j \rho_j^T r_j^{n-1}`
with some 500 real ratios :math:`r_j` in (-1, 1] (López-Fernández, Lubich, Schädle, *Adaptive, fast
and oblivious convolution in evolution equations with memory*, SIAM J. Sci. Comput. 30, 2008, have
such a form with complex ratios). So the force of all finished samples follows from the states

.. math:: s_j \leftarrow r_j s_j + \rho_j^T U_k

and nothing else has to be kept. Ratios and rows :math:`\rho_j` do not depend on the order of the
derivative: all damping terms share the states, and only the columns :math:`c_j` tell them apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.memory import (
    Channel,
    runge_kutta_tableau,
    same_direction,
    scale_and_direction,
)
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stage_basis import legendre_exponentials
from fvi_cli.mathematics.runge_kutta_weights import ExponentialSum

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class ExponentialKernel:
    """The weights of every channel of a scene as sums of the same exponentials.

    Parameters
    ----------
    exponentials
        Ratios and rows (J of them), for samples in Legendre coefficients.
    columns
        Vectors :math:`c_j` of each channel, shape ``(J, m)``.
    """

    exponentials: ExponentialSum
    columns: tuple[Array, ...]

    def constant_response(self, index: int, newest: Array, first: int, last: int) -> Array:
        r"""Sums :math:`\sum_{l \le n} w_l e_1` of one channel for `first` <= n < `last`.

        Parameters
        ----------
        index
            Which channel.
        newest
            Its w_0, shape ``(m, m)``.
        first, last
            Range of n.

        Returns
        -------
        Array
            Force of samples that have been :math:`e_1` since the start, shape ``(n, m)``.
        """
        source, n = self.exponentials, np.arange(first, last, dtype=float)[:, None]
        logs, positive = source.log_magnitudes, source.signs > 0
        growing = positive & (logs < 0)
        geometric = np.repeat(n, logs.size, axis=1)
        geometric[:, growing] = np.expm1(n * logs[growing]) / np.expm1(logs[growing])
        even = np.where(n % 2 == 1, -1.0, 1.0)
        geometric[:, ~positive] = (1.0 - even * np.exp(n * logs[~positive])) / (
            1.0 + np.exp(logs[~positive])
        )
        return np.asarray(newest[:, 0] + (geometric * source.rows[:, 0]) @ self.columns[index])


def exponential_kernel(
    method: Method,
    h: float,
    n_steps: int,
    damping: tuple[FractionalDamping, ...],
    channels: tuple[Channel, ...],
) -> ExponentialKernel | None:
    """The weights w_1 .. w_N of `channels`, which were made of `damping`; None without memory.

    Raises
    ------
    ValueError
        If the method is no Runge-Kutta one, or a term belongs to no channel.
    """
    if not method.is_runge_kutta:
        raise ValueError(f"history: exponentials is for Runge-Kutta methods, not for {method.cq}")
    source: ExponentialSum | None = None
    columns: list[Array | None] = [None] * len(channels)
    for term in damping:
        if term.order == 1.0:
            continue
        own = legendre_exponentials(runge_kutta_tableau(method), term.order - 1.0, n_steps)
        source = source or own
        scale, direction = scale_and_direction(term)
        places = [i for i, c in enumerate(channels) if same_direction(c.direction, direction)]
        if not places:
            raise ValueError(f"damping: no channel for the term of order {term.order:g}")
        added = scale * h ** (1.0 - term.order) * own.columns
        before = columns[places[0]]
        columns[places[0]] = added if before is None else before + added
    if source is None:
        return None
    empty = np.zeros_like(source.columns)
    return ExponentialKernel(
        exponentials=source, columns=tuple(empty if c is None else c for c in columns)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class ExponentialStates:
    """The states after a number of blocks, with what their sums have lost to round-off.

    Parameters
    ----------
    values, lost
        Shape ``(J, q e)`` for q systems of e coupled components each.
    """

    values: Array
    lost: Array


class ExponentialHistory:
    """Force of all finished blocks on the next one, from states that a block moves on.

    Parameters
    ----------
    kernel
        Ratios, rows and columns.
    directions
        Directions of the channels in the coordinates of the batch, each of shape ``(q, e, e)``.
    block
        Number B of steps in a block; even.
    states
        Where to begin; None: at the start of a run.

    Raises
    ------
    ValueError
        If the states do not fit, or the block is not even.
    """

    def __init__(
        self,
        kernel: ExponentialKernel,
        directions: tuple[Array, ...],
        block: int,
        states: ExponentialStates | None = None,
    ) -> None:
        if block < 2 or block % 2:
            # an even power of a negative ratio is positive
            raise ValueError(f"block: {block} is not allowed; it must be even")
        source = kernel.exponentials
        q, e, _ = directions[0].shape
        n_states, m = source.rows.shape
        self._shape = (q, block, m, e)
        self._directions = directions
        powers = source.powers(np.arange(block))
        # rows of a channel: step and sample
        self._out = np.concatenate(
            [
                (powers[:, None, :] * columns.T[None]).reshape(block * m, n_states)
                for columns in kernel.columns
            ]
        )
        self._in = np.ascontiguousarray(
            (powers[::-1].T[:, :, None] * source.rows[:, None, :]).reshape(n_states, block * m)
        )
        # 1 - r^B in full accuracy: a state that decays slowly forgets at the right pace
        self._decay = np.expm1(block * source.log_magnitudes)[:, None]
        size = (n_states, q * e)
        if states is None:
            states = ExponentialStates(values=np.zeros(size), lost=np.zeros(size))
        if states.values.shape != size or states.lost.shape != size:
            raise ValueError(f"states: shape {states.values.shape} is not allowed; it is {size}")
        self._values, self._lost = states.values.copy(), states.lost.copy()
        self.operations = 0

    @property
    def states(self) -> ExponentialStates:
        """A copy of the states."""
        return ExponentialStates(values=self._values.copy(), lost=self._lost.copy())

    def known(self) -> Array:
        """Force on every step of the next block, shape ``(q, B, m, e)``."""
        q, block, m, e = self._shape
        every = self._out @ self._values
        self.operations += every.size * self._values.shape[0]
        if q == 1 and e == 1 and len(self._directions) == 1:
            return np.asarray(every * self._directions[0][0]).reshape(self._shape)
        force = np.zeros(self._shape)
        parts = every.reshape(len(self._directions), block * m, q, e).transpose(0, 2, 1, 3)
        for part, directions in zip(parts, self._directions, strict=True):
            force += np.matmul(part, directions).reshape(self._shape)
        return force

    def push(self, samples: Array) -> None:
        """Move on by a block with these samples, shape ``(q, B, m, e)``."""
        q, block, m, e = self._shape
        moved = samples.transpose(1, 2, 0, 3).reshape(block * m, q * e)
        change = self._in @ moved
        change += self._decay * self._values
        change -= self._lost
        total = self._values + change
        self._lost = (total - self._values) - change
        self._values = total
        self.operations += self._in.size * q * e
