"""Numbers that are computed from a trajectory at any times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.observations.dampers import damper_values
from fvi_cli.integrator.observations.request import Observations, known_names
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression


@dataclass(frozen=True, kw_only=True, eq=False)
class Quantity:
    """A number computed from an expression at some times.

    Parameters
    ----------
    times
        Shape ``(n,)``, in any order; values inside a step come from its polynomial.
    value
        From the values of the expression there, ``(n,)``, to the number.
    slopes
        From the same values to the derivatives by them, ``(n,)``.
    of
        The expression, in t, coordinates, ``v<name>``, ``a<name>``, ``d<name>``, ``force_1`` and
        ``deformation_1`` of dampers, or the name of a quantity of an experiment; or a function from
        the names of the coordinates to it.

    Raises
    ------
    ValueError
        For times that are not finite numbers in one row.
    """

    times: Array
    value: Callable[[Array], float]
    slopes: Callable[[Array], Array]
    of: str | Callable[[Sequence[str]], str]

    def __post_init__(self) -> None:
        times = np.atleast_1d(np.array(self.times, dtype=float))
        if times.ndim != 1 or not times.size or not np.isfinite(times).all():
            raise ValueError("times: finite numbers are needed, at least one")
        object.__setattr__(self, "times", times)

    def expression(self, request: Observations, scene: Scene) -> Expression:
        """The expression that `of` gives, in the names of a motion.

        Raises
        ------
        ValueError
            For names that are not known, or have no derivative.
        """
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
