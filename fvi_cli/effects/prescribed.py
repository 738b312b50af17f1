"""Motions that are given, in place of motions that forces cause."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece
from fvi_cli.effects.sampled import FunctionForce, SampledForce
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression, slopes_of

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
        times = np.array([0.0, *self.break_points, self.final_time])
        between = np.linspace(times[:-1], times[1:], 9).ravel()
        values = self.displacement(between)[:, 0]
        largest = float(np.abs(values).max())
        if not np.ptp(values) > JUMP * largest:
            raise ArgumentError("displacement", "it is constant; give a displacement that changes")
        for index, time in enumerate(self.displacement.break_points):
            before, after = (
                float(self.displacement.pieces[index + k].evaluate(np.array(time))[0])
                for k in (0, 1)
            )
            if time < self.final_time and abs(after - before) > JUMP * largest:
                raise ArgumentError(
                    "displacement",
                    f"it jumps at t = {time:g} from {before:g} to {after:g}, which takes an "
                    "infinite rate; give a ramp",
                )
        if not np.isfinite(self.start_rate):
            raise ArgumentError("displacement", "its rate is infinite at t = 0; give a ramp")

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
        return self._inside(lines_only=True)

    @cached_property
    def break_points(self) -> tuple[float, ...]:
        """Times inside (0, T) at which it is not smooth."""
        return self._inside(lines_only=False)

    def _inside(self, *, lines_only: bool) -> tuple[float, ...]:
        found = set(self.displacement.break_points)
        for one in self.displacement.samples:
            if one.order == 2 or not lines_only:
                found.update(one.knots.tolist())
        slack = 1e-12 * self.final_time
        return tuple(sorted(t for t in found if slack < t < self.final_time - slack))

    @cached_property
    def rate(self) -> Forcing:
        """The derivative u'(t), as a function of the same pieces."""
        pieces = [
            ForcingPiece(components=(_rate_of(piece.components[0]),), until=piece.until)
            for piece in self.displacement.pieces
        ]
        return Forcing(pieces=tuple(pieces))


def _rate_of(component: ForceComponent) -> ForceComponent:
    if isinstance(component, SampledForce):
        powers = np.arange(component.order - 1, 0, -1)[:, None]
        slopes = powers * component.coefficients[:-1]
        rate = SampledForce(knots=component.knots, coefficients=slopes, source=component.source)
        if component.formula is None:
            return rate
        added = _rate_of(component.formula)
        return FunctionForce(
            function=lambda t: np.asarray(rate.evaluate({"t": t}) + added.evaluate({"t": t}))
        )
    if not isinstance(component, Expression):
        raise ArgumentError("displacement", "give a formula or samples, not a function")

    def slope(time: Array) -> Array:
        found = slopes_of(component, {"t": time.ravel()}, ["t"]).get("t")
        flat = np.zeros(time.size) if found is None else np.broadcast_to(found, (time.size,))
        return np.asarray(flat.reshape(time.shape))

    return FunctionForce(function=slope)
