"""Motions that are given, in place of motions that forces cause."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fvi_cli.effects.forcing import ForceComponent, Forcing
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.expressions import Expression

JUMP = 1e-9
"""Jump that is allowed between neighbouring pieces, relative to the largest displacement."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PrescribedMotion:
    """A displacement u(t) of one coordinate, smooth between its break points."""

    displacement: Forcing
    final_time: float

    def check(self) -> None:
        """Refuse a motion that no damper can follow.

        Raises
        ------
        ValueError
            If it jumps, does not change at all, or is known as a function only.
        """
        wrong = ""
        times = np.array([0.0, *self.break_points, self.final_time])
        values = self.displacement(np.linspace(times[:-1], times[1:], 9).ravel())
        least = JUMP * float(np.abs(values).max())
        for before, after in itertools.pairwise(self.displacement.pieces):
            at = np.array(before.until)
            if at < self.final_time and abs(after.evaluate(at) - before.evaluate(at)) > least:
                wrong = f"it jumps at t = {at:g}: an infinite rate; give a ramp"
        if any(one.order == 1 for one in self.displacement.samples):
            wrong = "it jumps at every sample; interpolate linearly"
        if not np.ptp(values) > least:
            wrong = "it is constant; give a displacement that changes"
        if not wrong and not np.isfinite(self.start_rate):
            wrong = "its rate is infinite at t = 0; give a ramp"
        if wrong:
            raise ArgumentError("displacement", wrong)

    @property
    def start(self) -> float:
        """u(0)."""
        return float(self.displacement(np.zeros(1))[0, 0])

    @property
    def start_rate(self) -> float:
        """The derivative of u just after t = 0."""
        return float(self.rate(np.zeros(1))[0, 0])

    @cached_property
    def kinks(self) -> tuple[float, ...]:
        """Times inside (0, T) at which the rate may jump."""
        return self._inside(largest_order=2)

    @cached_property
    def break_points(self) -> tuple[float, ...]:
        """Times inside (0, T) at which it is not smooth."""
        return self._inside(largest_order=4)

    def _inside(self, largest_order: int) -> tuple[float, ...]:
        samples = (one for one in self.displacement.samples if one.order <= largest_order)
        found = {*self.displacement.break_points, *(t for one in samples for t in one.knots)}
        slack = 1e-12 * self.final_time
        return tuple(sorted(float(t) for t in found if slack < t < self.final_time - slack))

    @cached_property
    def rate(self) -> Forcing:
        """The derivative u'(t), as a function of the same pieces."""
        pieces = [
            replace(piece, components=tuple(map(_rate_of, piece.components)))
            for piece in self.displacement.pieces
        ]
        return Forcing(pieces=tuple(pieces))


def _rate_of(component: ForceComponent) -> ForceComponent:
    if isinstance(component, SampledForce):
        powers = np.arange(component.order - 1, 0, -1)[:, None]
        return replace(component, coefficients=powers * component.coefficients[:-1])
    if not isinstance(component, Expression):
        raise ArgumentError("displacement", "give a formula or samples, not a function")
    return component.derivative("t")
