"""Numbers that are computed from a trajectory at some times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.observe.dampers import damper_values
from fvi_cli.integrator.observe.request import Observations, known_names
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression


@dataclass(frozen=True, kw_only=True, eq=False)
class Quantity:
    r"""An expression y at one time, or half the sum of squares of (y - data) / sigma."""

    # in t, coordinates, ``v<name>``, ``a<name>``, ``d<name>``, ``force_1`` and ``deformation_1`` of
    # dampers, or the name of a quantity of an experiment; or a prefix and a coordinate's number
    of: str | tuple[str, int]
    times: Array  # (n,); values inside a step come from its polynomial
    data: Array | None = None  # None: the value at the one time
    deviation: float = 1.0  # sigma

    def value(self, values: Array) -> float:
        """The number, from values of the expression ``(n,)``."""
        if self.data is None:
            return float(values[0])
        return float(0.5 * np.sum(((values - self.data) / self.deviation) ** 2))

    def slopes(self, values: Array) -> Array:
        """Its derivatives by the values, ``(n,)``."""
        if self.data is None:
            return np.ones_like(values)
        return np.asarray((values - self.data) / self.deviation**2)

    def expression(self, request: Observations, scene: Scene) -> Expression:
        """The expression in the names of a motion.

        Raises
        ------
        ValueError
            For names that are not known, or have no derivative.
        """
        dampers, text = damper_values(scene), self.of
        if not isinstance(text, str):
            known = {where: name for name, where in request.derived.items()}
            if text not in known:
                raise ValueError(f"component: {text[1]} is not one of 0 to {scene.dimension - 1}")
            text = known[text]
        names = known_names(request.coordinates, (*request.parameters, *request.inputs))
        every = tuple(dict.fromkeys((*names, *dampers, *request.ready)))
        parsed = request.quantities.get(text) or Expression.parse(text, variables=every)
        found = parsed.expand(request.ready)
        for name in sorted(found.names.difference(names)):
            if dampers[name].kind == "work":
                raise ValueError(
                    f"quantity: {name} adds up from the beginning of the run, and has no "
                    "derivative here"
                )
        return found


def position_at(time: float, component: int = 0) -> Quantity:
    """One coordinate at one time."""
    return Quantity(of=("", component), times=np.array([time]))


def velocity_at(time: float, component: int = 0) -> Quantity:
    """One velocity at one time."""
    return Quantity(of=("v", component), times=np.array([time]))


def acceleration_at(time: float, component: int = 0) -> Quantity:
    """One acceleration at one time, from the equation of motion."""
    return Quantity(of=("a", component), times=np.array([time]))


def quantity_at(of: str, time: float) -> Quantity:
    """The value of an expression at one time, as :class:`Quantity` knows it."""
    return Quantity(of=of, times=np.array([time]))


def misfit(
    times: ArrayLike,
    data: ArrayLike,
    *,
    component: int = 0,
    deviation: float = 1.0,
    of: str | None = None,
) -> Quantity:
    r"""Half the sum of squares of :math:`(y(t_k) - d_k) / \sigma`.

    Times and data are ``(n,)``; y is an expression, or else the coordinate of a number from 0.
    """
    return Quantity(
        of=of or ("", component),
        times=np.atleast_1d(np.asarray(times, dtype=float)),
        data=np.asarray(data, dtype=float),
        deviation=deviation,
    )
