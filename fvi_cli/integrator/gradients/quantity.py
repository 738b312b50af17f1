"""Numbers that are computed from a trajectory at any times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.observations.dampers import damper_values
from fvi_cli.integrator.observations.request import Observations, known_names
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression

COMPLEX_STEP = 2.0**-100
"""So small that its square is negligible relative to 1."""
DIFFERENCE = 1e-5
"""Relative step of the difference that checks derivatives by complex steps."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Quantity:
    """A number computed from a motion at some times.

    Parameters
    ----------
    times
        Shape ``(n,)``, in any order; values inside a step come from its polynomial.
    value
        From positions and velocities there, both ``(n, d)``, to the number; with `of` from the
        values of that expression, ``(n,)``.
    slopes
        From the same arguments to the derivatives by them, of the same shapes; None: by complex
        steps, for which `value` must take complex arrays and be analytic (no abs, no max).
    of
        An expression in t, coordinates, ``v<name>``, ``a<name>``, ``d<name>``, ``force_1`` and
        ``deformation_1`` of dampers, or the name of a quantity of an experiment; or a function from
        the names of the coordinates to it.

    Raises
    ------
    ValueError
        For times that are not finite numbers in one row.
    """

    times: Array
    value: Callable[..., float]
    slopes: Callable[..., Any] | None = None
    of: str | Callable[[Sequence[str]], str] | None = None

    def __post_init__(self) -> None:
        times = np.atleast_1d(np.array(self.times, dtype=float))
        if times.ndim != 1 or not times.size or not np.isfinite(times).all():
            raise ValueError("times: finite numbers are needed, at least one")
        object.__setattr__(self, "times", times)

    def expression(self, request: Observations, scene: Scene) -> Expression | None:
        """The expression that `of` gives, in the names of a motion; None: positions and velocities.

        Raises
        ------
        ValueError
            For names that are not known, or have no derivative.
        """
        if self.of is None:
            return None
        text = self.of if isinstance(self.of, str) else self.of(request.coordinates)
        quantities = request.quantities or {}
        names = known_names(request.coordinates, (*request.parameters, *request.inputs))
        dampers = {name: o for name, o in damper_values(scene).items() if name not in names}
        works = [name for name, one in dampers.items() if one.kind == "work"]
        names = (*names, *(name for name in dampers if name not in works))
        try:
            every = tuple(dict.fromkeys((*names, *works, *request.ready)))
            parsed = quantities.get(text) or Expression.parse(text, variables=every)
            found = parsed.expand(request.ready)
        except ValueError as error:
            others = f"; quantities: {', '.join(quantities)}" if quantities else ""
            raise ValueError(f"quantity: {error}{others}") from None
        for name in sorted(found.names.intersection(works)):
            raise ValueError(
                f"quantity: {name} adds up from the beginning of the run, and has no derivative "
                f"here; differentiable here: {', '.join(names)}"
            )
        return found

    def derivatives(self, *given: Array) -> list[Array]:
        """Derivatives by all arguments of `value`, arrays of the same shapes.

        Raises
        ------
        ValueError
            If they cannot be computed by complex steps.
        """
        if self.slopes is not None:
            slopes = self.slopes(*given)
            slopes = slopes if isinstance(slopes, tuple) else (slopes,)
            return [np.asarray(one, dtype=float) for one in slopes]
        point = np.stack(given).astype(complex)
        found = np.zeros(point.shape)
        for index in np.ndindex(*point.shape):
            shifted = point.copy()
            shifted[index] += 1j * COMPLEX_STEP
            found[index] = complex(self.value(*shifted)).imag / COMPLEX_STEP
        if not np.isfinite(found).all():
            raise ValueError("quantity: its derivatives by complex steps are not finite")
        self._check(point.real, found)
        return list(found)

    def _check(self, point: Array, found: Array) -> None:
        """Check derivatives by complex steps against a difference in one direction."""
        # a direction without any symmetry that a quantity may have
        along = np.cos(1.0 + np.arange(point.size) ** 2).reshape(point.shape)
        step = DIFFERENCE * (float(np.abs(point).max()) or 1.0)
        after, before = (float(self.value(*(point + s * step * along))) for s in (1.0, -1.0))
        expected, size = (after - before) / (2.0 * step), float(np.abs(found * along).sum())
        noise = 1e-13 * max(abs(after), abs(before)) / step
        if abs(float((found * along).sum()) - expected) > 1e-3 * max(abs(expected), size) + noise:
            raise ValueError(
                "quantity: complex steps do not give its derivative: abs, max, np.linalg.norm and "
                "the like lose it; write np.sqrt((x**2).sum()) for a norm, or give slopes"
            )


def position_at(time: float, component: int = 0) -> Quantity:
    """One coordinate at one time."""
    return quantity_at(_coordinate("", component), time)


def velocity_at(time: float, component: int = 0) -> Quantity:
    """One velocity at one time."""
    return quantity_at(_coordinate("v", component), time)


def acceleration_at(time: float, component: int = 0) -> Quantity:
    """One acceleration at one time, from the equation of motion."""
    return quantity_at(_coordinate("a", component), time)


def quantity_at(of: str | Callable[[Sequence[str]], str], time: float) -> Quantity:
    """The value of an expression at one time, as :class:`Quantity` knows it."""
    return Quantity(
        times=np.array([time]), of=of, value=lambda values: float(values[0]), slopes=np.ones_like
    )


def _coordinate(prefix: str, component: int) -> Callable[[Sequence[str]], str]:
    def name(coordinates: Sequence[str]) -> str:
        if not 0 <= component < len(coordinates):
            raise ValueError(f"component: {component} is not one of 0 to {len(coordinates) - 1}")
        found = prefix + coordinates[component]
        if prefix and found in coordinates:
            raise ValueError(f"quantity: {found} is itself a coordinate")
        return found

    return name


def smoothed_peak(of: str, times: ArrayLike, *, sharpness: float = 50.0) -> Quantity:
    r"""A smooth bound, from above, on the largest absolute value of an expression y.

    .. math:: \Bigl( \sum_k |y(t_k)|^p \Bigr)^{1/p}, \qquad
       \max_k |y(t_k)| \le \ldots \le n^{1/p} \max_k |y(t_k)|.

    Parameters
    ----------
    of
        The expression, as :class:`Quantity` knows it.
    times
        :math:`t_k`, shape ``(n,)``, close enough to each other that no peak is missed.
    sharpness
        p; the larger, the closer to the peak, and the less smooth.

    Raises
    ------
    ValueError
        For a sharpness of 1 or less.
    """
    if not sharpness > 1:
        raise ValueError(f"sharpness: {sharpness:g} is not allowed; it must be above 1")

    def value(values: Array) -> float:
        size = np.abs(values)
        largest = float(size.max()) or 1.0
        return float(largest * ((size / largest) ** sharpness).sum() ** (1.0 / sharpness))

    def slopes(values: Array) -> Array:
        share = np.abs(values) / (value(values) or 1.0)
        return np.asarray(share ** (sharpness - 1.0) * np.sign(values))

    return Quantity(times=np.asarray(times, dtype=float), of=of, value=value, slopes=slopes)


def misfit(
    times: ArrayLike,
    data: ArrayLike,
    *,
    component: int = 0,
    deviation: float = 1.0,
    of: str | None = None,
) -> Quantity:
    r"""Half the sum of squares of :math:`(y(t_k) - d_k) / \sigma`.

    Parameters
    ----------
    times, data
        :math:`t_k` and :math:`d_k`, shape ``(n,)``.
    component
        Number of the coordinate y, from 0.
    deviation
        :math:`\sigma`, in the unit of the data.
    of
        An expression y in place of a coordinate, as :class:`Quantity` knows it.
    """
    measured = np.asarray(data, dtype=float)

    def value(values: Array) -> float:
        left = (values - measured) / deviation
        return float(0.5 * left @ left)

    return Quantity(
        times=np.asarray(times, dtype=float),
        of=of or _coordinate("", component),
        value=value,
        slopes=lambda values: (values - measured) / deviation**2,
    )
