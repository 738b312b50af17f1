r"""The damping of systems side by side.

All systems share the rates of the sum of exponentials, whatever their orders are (laws with rates
of their own stand beside laws with the same), and with them
the tables of a block of steps: what they differ in is the weight of every state in their force.
Within a block the force of its earlier steps comes of the lags of the convolution, behind it the
states have what the block did.

All states begin with zero. Where a term subtracts the start velocity they would begin with it:
one column, which begins with 1, is driven by nothing and serves all systems, makes the difference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.batches.systems import Remembered, Systems, Terms, kernels_of
from fvi_cli.integrator.convolution.kernel import Kernel, power_kernel
from fvi_cli.integrator.convolution.stages import (
    BlockHistory,
    BlockKernel,
    StageOperator,
    StepHistory,
    StepKernel,
)
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.mathematics.arrays import Array

_SOME_EXPONENT = 0.5
_EXTREME = 1.0 - 2.0**-40
"""Rates that are dense enough for exponents up to this serve all."""


def rates_and_weights(
    one: Remembered, *, shortest_step: float, n_steps: float, final_time: float, stages: int
) -> tuple[Array, Array]:
    """Rates that are the same for all exponents, and the weights of one, each of shape ``(J,)``.

    Kernels of laws may have rates of their own, which are then those of the exponents beside them.
    """
    term, kernels = one
    every = (-_EXTREME, *((term,) if isinstance(term, float) else ()), *kernels, _EXTREME)
    kernel = power_kernel(
        every,
        shortest_step=shortest_step,
        final_time=final_time,
        stages=stages,
        steps=n_steps,
        accuracy=1e-14,
    )
    return kernel.rates, kernel.weights[every.index(term)]


def rates_of(scene: Scene, mesh: Mesh, stages: int) -> bytes:
    """What scenes with laws have in common that share their states: all rates on a mesh."""
    rates, _ = rates_and_weights(
        (_SOME_EXPONENT, kernels_of(scene)),
        shortest_step=mesh.shortest_step,
        n_steps=mesh.equivalent_steps,
        final_time=scene.final_time,
        stages=stages,
    )
    return rates.tobytes()


@dataclass(frozen=True, kw_only=True, eq=False)
class SideTables:
    """Numbers of one step size.

    Parameters
    ----------
    local
        For every slot the local block, shape ``(m, inputs, q)``.
    lags
        For every slot the weights of what drove the earlier steps of a block, those of the step
        right before last, shape ``(m, (B - 1) inputs, q)``; none without memory.
    constant
        Force that is the same in all steps but for its last digits, ``(m, e, q)``.
    step
        States and responses of a step, without the weights of the states; None without memory.
    """

    local: tuple[Array, ...]
    lags: tuple[Array, ...]
    constant: Array | None
    step: StepHistory | None


class SideDamping:
    """The damping of systems side by side, on one mesh.

    Parameters
    ----------
    systems
        Whose damping.
    operator
        The Runge-Kutta method.
    shortest_step, n_steps, final_time
        Of the mesh, as for :func:`power_kernel`.
    block
        Most steps B of a block.
    """

    def __init__(
        self,
        systems: Systems,
        operator: StageOperator,
        *,
        shortest_step: float,
        n_steps: float,
        final_time: float,
        block: int,
    ) -> None:
        self._slots, self._operator, self.block = systems.slots, operator, block
        self._m = self._inputs = operator.n_stages
        self._e, self._q = systems.shape
        self._weights: tuple[Array, ...] = ()
        self._of_start: tuple[Array | None, ...] = ()
        self._kernel: Kernel | None = None
        self._blocks: dict[tuple[float, int], BlockHistory] = {}
        if systems.has_memory:
            found = {
                one: rates_and_weights(
                    one,
                    shortest_step=shortest_step,
                    n_steps=n_steps,
                    final_time=final_time,
                    stages=self._m,
                )
                for one in {term[0] for slot in systems.slots for term in slot.terms}
            }
            rates = next(iter(found.values()))[0].copy()
            weights = {one: own for one, (_, own) in found.items()}
            self._kernel = Kernel(
                terms=(_SOME_EXPONENT,), rates=rates, weights=np.ones((1, rates.size))
            )
            self._weights = tuple(self._weights_of(slot.terms, weights) for slot in self._slots)
            self._of_start = tuple(
                self._weights_of(slot.relative, weights) if slot.relative else None
                for slot in self._slots
            )

    @property
    def n_states(self) -> int:
        """Number J of rates."""
        return 0 if self._kernel is None else self._kernel.n_states

    def at_start(self, systems: Systems) -> tuple[Array, Array]:
        """The states of all systems, and those of a start velocity of 1, at the start."""
        return np.zeros((self.n_states, *systems.shape)), np.ones(self.n_states)

    def _weights_of(self, terms: Terms, weights: dict[Remembered, Array]) -> Array:
        total = np.zeros((self.n_states, self._q))
        for one, places, factors in terms:
            total[:, places] += weights[one][:, None] * factors
        return total

    def tables(self, step_size: float) -> SideTables:
        """Numbers of steps of this size."""
        m = self._m
        local = tuple(
            slot.rate * np.eye(m)[:, :, None] + self._local(slot.terms, step_size)
            for slot in self._slots
        )
        if self._kernel is None:
            return SideTables(local=local, lags=(), constant=None, step=None)
        step = self._operator.step_tables(self._kernel, step_size)
        constant = np.zeros((m, self._e, self._q))
        for slot, weights in zip(self._slots, self._of_start, strict=True):
            if weights is not None:
                own = self._local(slot.relative, step_size)
                left = own.sum(axis=1) + step.response[0] @ weights
                constant -= left[:, None] * slot.start
        return SideTables(
            local=local,
            lags=tuple(self._lags(step, weights) for weights in self._weights),
            constant=constant if constant.any() else None,
            step=step,
        )

    def _local(self, terms: Terms, step_size: float) -> Array:
        total = np.zeros((self._m, self._m, self._q))
        for (term, _), places, factors in terms:
            if isinstance(term, float):
                block = step_size**term * self._operator.local_block(term)
            else:
                block = self._operator.law_block(term, step_size)
            total[..., places] += block[:, :, None] * factors
        return total

    def _lags(self, step: StepKernel, weights: Array) -> Array:
        m, before = self._m, self.block - 1
        base = step.response[0] * step.powers(np.arange(before))[:, None]
        # lag, stage, stage of the earlier step, state
        pairs = base[:, :, None, :] * step.intake.T
        lags = (pairs.reshape(before * m * m, -1) @ weights).reshape(before, m, m, -1)
        ordered = lags[::-1].transpose(1, 0, 2, 3)
        return np.ascontiguousarray(ordered).reshape(m, before * m, -1)

    def block_kernel(self, step_size: float, step: StepHistory, count: int) -> BlockHistory:
        """Tables of a block of so many steps, without the weights of the states."""
        key = (step_size, count)
        if key not in self._blocks:
            if len(self._blocks) >= 2 * self.block:
                self._blocks.clear()
            self._blocks[key] = step.over(count)
        return self._blocks[key]

    def past(self, block: BlockHistory, states: Array, carried: Array) -> Array:
        """Force of the states on all steps of a block, shape ``(count, m, e, q)``.

        Parameters
        ----------
        block
            The block.
        states, carried
            Of every system, shape ``(J, e, q)``, and of a start velocity of 1, ``(J,)``.
        """
        weighted = np.zeros_like(states)
        every = zip(self._slots, self._weights, self._of_start, strict=True)
        for slot, weights, of_start in every:
            own = states if slot.direction is None else along(states, slot.direction)
            weighted += weights[:, None] * own
            if of_start is not None:
                weighted += (carried[:, None] * of_start)[:, None] * slot.start
        force = block.response[0] @ weighted.reshape(self.n_states, -1)
        return np.asarray(force.reshape(-1, self._m, self._e, self._q))

    def of_block(self, tables: SideTables, driving: Array, done: int) -> Array:
        """Force of the first `done` steps of a block on the next one, shape ``(m, e, q)``.

        Parameters
        ----------
        tables
            Of the step size.
        driving
            What drove the block's steps, shape ``(B inputs, e, q)``, or with more axes between the
            last two.
        """
        m, width = self._m, done * self._inputs
        before = driving[:width]
        total = np.zeros((m, *before.shape[1:]))
        if not tables.lags:
            # dampers of order 1 have no memory
            return total
        between = (1,) * (before.ndim - 2)
        for slot, lags in zip(self._slots, tables.lags, strict=True):
            recent = lags[:, lags.shape[1] - width :]
            own = (recent.reshape(m, width, *between, -1) * before).sum(axis=1)
            if slot.direction is not None:
                own = along(own, slot.direction)
            total += own
        return total

    def pushed(self, block: BlockHistory, states: Array, driving: Array) -> Array:
        """The states behind a block that was driven by this."""
        after = block.after(states.reshape(len(states), -1), driving.reshape(len(driving), -1))
        return after.reshape(states.shape)

    def carried_after(self, block: BlockHistory, carried: Array) -> Array:
        """The states of a start velocity behind a block."""
        if not isinstance(block, BlockKernel):
            raise ValueError("block: it is not one of a Runge-Kutta method")
        return np.asarray(carried * block.decay)


def along(values: Array, directions: Array) -> Array:
    """Rows of values ``(n, e, ..., q)`` times a matrix ``(e, e, q)`` for every system."""
    e, q = directions.shape[0], directions.shape[2]
    matrices = directions.reshape(e, e, *(1,) * (values.ndim - 3), q)
    return np.asarray((values[:, :, None] * matrices).sum(axis=1))


__all__ = ["SideDamping", "SideTables", "along", "rates_and_weights", "rates_of"]
