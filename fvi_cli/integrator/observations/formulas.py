"""Formulas along a motion, and when a polynomial may replace one on a piece of a step.

To integrate a formula and to find its extremes, its polynomial must be resolved. To find its roots,
a piece on which the polynomial may vanish is halved until that is resolved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fvi_cli.integrator.observations.pieces import (
    POINTS,
    Along,
    by_owner,
    coefficients_of,
)
from fvi_cli.mathematics.arrays import Array, Mask, Places
from fvi_cli.mathematics.expressions import Expression

Variables = Callable[[Places, Array], Mapping[str, Array | float]]
"""From steps and places to a formula's variables by name: numbers, or in the shape of places."""

DECAY = 1e-9
"""A piece is resolved if its last coefficients are at most this, relative to the largest."""
LEAST_HALVINGS, MOST_HALVINGS, MOST_BISECTIONS = 4, 7, 40  # of a piece: Resolved, and Isolated
FAR = 4.0
"""A polynomial whose mean is more than so many times its reach has no root near."""
AT_ONCE = 2**20
"""Most numbers that are held for the variables of a formula at a time."""
ULPS = 4 * 2.0**-52
"""Relative round-off of every variable."""


@dataclass(frozen=True, eq=False)
class FormulaAlong:
    """A formula along a motion."""

    expression: Expression
    variables: Variables
    constants: Sequence[Mapping[str, float]] = ({},)  # of every member; one for all of them
    owner: Places | None = None  # member of every step, (N,), where constants are more than one
    start_variables: Variables | None = None  # at t = 0, with the velocities that are given there

    def __call__(self, steps: Places, tau: Array) -> Array:
        """Values at places of steps, of so many at a time that variables take little memory."""
        found = np.empty(tau.shape)
        for own in self._slices(tau):
            found[own] = self._values(steps[own], tau[own], self.variables(steps[own], tau[own]))
        return found

    def _slices(self, tau: Array) -> Iterator[slice]:
        width = max(len(self.expression.names), 1) * max(tau[:1].size, 1)
        count = max(AT_ONCE // width, 1)
        return (slice(k, k + count) for k in range(0, len(tau), count))

    def _values(self, steps: Places, tau: Array, variables: Mapping[str, Array | float]) -> Array:
        found = np.empty(tau.shape)
        for chosen, value in self._by_constants(steps, variables):
            found[chosen] = value
        return found

    def _by_constants(
        self, steps: Places, variables: Mapping[str, Any]
    ) -> Iterator[tuple[Places | slice, Any]]:
        """Places that share constants, and the value there, on any algebra."""
        groups: list[tuple[int, Places | slice]] = [(0, slice(None))]
        if len(self.constants) > 1 and self.owner is not None:
            groups = by_owner(self.owner, steps, len(self.constants))
        for member, chosen in groups:
            own = {name: _at(one, chosen) for name, one in variables.items()}
            yield chosen, self.expression.evaluate({**self.constants[member], **own})

    def with_noise(self, steps: Places, tau: Array) -> tuple[Array, Array]:
        """Values at the Chebyshev points of pieces, and their round-off.

        Steps are ``(n,)``, their places ``(n, POINTS)``.
        """
        values, noise = np.empty(tau.shape), np.empty(steps.shape)
        for own in self._slices(tau):
            variables = self.variables(steps[own, None], tau[own])
            middles = {
                name: np.broadcast_to(one, tau[own].shape)[:, POINTS // 2] if np.ndim(one) else one
                for name, one in variables.items()
            }
            values[own] = self._values(steps[own], tau[own], variables)
            noise[own] = self._noise(steps[own], middles)
        return values, noise

    def at_starts(self, steps: Places) -> Array:
        """Values at the start of runs, by their first steps, with the velocities given there."""
        tau = np.zeros(steps.size)
        return self._values(steps, tau, (self.start_variables or self.variables)(steps, tau))

    def starts_with_zero(self, steps: Places) -> Mask:
        """Whether the value at the start of runs, by their first steps, is zero to round-off."""
        tau = np.zeros(steps.size)
        variables = (self.start_variables or self.variables)(steps, tau)
        values = self._values(steps, tau, variables)
        return np.asarray(np.abs(values) <= self._noise(steps, variables))

    def _noise(self, steps: Places, variables: Mapping[str, Array | float]) -> Array:
        """How far values move where each variable moves by its round-off."""
        used = [name for name in variables if name in self.expression.names]
        noise = np.zeros(steps.shape)
        with np.errstate(all="ignore"):
            at = self._values(steps, noise, variables)
            for name in used:
                for factor in (1.0 - ULPS, 1.0 + ULPS):
                    moved = {**variables, name: variables[name] * factor}
                    noise += np.abs(self._values(steps, noise, moved) - at)
        return np.where(np.isfinite(noise), noise, 0.0)


def _at(one: Any, chosen: Places | slice) -> Any:
    return one[chosen] if np.ndim(one) else one


class Resolved:
    """Criterion: the polynomial of a piece is resolved, or halving does not help (round-off)."""

    def __init__(self, along: Along) -> None:
        self._along = along
        self._before = np.zeros(0)

    def __call__(
        self, depth: int, step: Places, tau: Array, part: Places
    ) -> tuple[Array, Array, Mask]:
        """As :class:`~fvi_cli.integrator.observations.pieces.Criterion`."""
        values = self._along(step[:, None], tau)
        coefficients = coefficients_of(values)
        size = np.abs(coefficients)
        rough = size[:, -2:].max(axis=1) > DECAY * size.max(axis=1)
        if depth == 0:
            self._before = np.bincount(part).astype(float)
        now = np.bincount(part[rough], minlength=self._before.size).astype(float)
        if depth >= LEAST_HALVINGS:
            rough &= ~(now > 1.8 * self._before)[part]
        self._before = now
        if depth == MOST_HALVINGS:
            rough[:] = False
        return values, coefficients, rough


class Isolated:
    """Criterion: a piece that may have roots has those of its polynomial and no others."""

    def __init__(self, along: FormulaAlong) -> None:
        self._along = along

    def __call__(
        self, depth: int, step: Places, tau: Array, part: Places
    ) -> tuple[Array, Array, Mask]:
        """As :class:`~fvi_cli.integrator.observations.pieces.Criterion`."""
        values, noise = self._along.with_noise(step, tau)
        coefficients = coefficients_of(values)
        size = np.abs(coefficients)
        tail, reach = size[:, -2:].max(axis=1), size[:, 1:].sum(axis=1)
        is_resolved = (tail <= DECAY * size.max(axis=1)) | (tail <= noise)
        rough = ~(is_resolved & np.isfinite(values[:, 1:-1]).all(axis=1))
        rough &= size[:, 0] <= FAR * reach
        if depth == MOST_BISECTIONS:
            rough[:] = False
        return values, coefficients, rough
