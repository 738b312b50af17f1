"""``fractional-derivative``: the Caputo derivative of a function, without a motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, Literal

import numpy as np

from fvi_cli.effects.forcing import ForcingPiece
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.quadrature import jacobi_rule
from fvi_cli.scenes.forces import expressions
from fvi_cli.scenes.keys.values import Formula, Order, Positive, key
from fvi_cli.scenes.kinds.kind import FINAL_TIME, Kind
from fvi_cli.scenes.problem import DerivativeProblem

NEAR: Final = 1e-150
"""Share of T in place of the time 0, where formulas of derivatives may have no value."""
POWER: Final = 6
NODES: Final = 64
"""Nodes of the quadrature of Caputo's integral."""
RESOLVED: Final = 1e-12
"""Largest difference of a rule with twice as many nodes, as a share of the derivative."""


class FractionalDerivative(Kind):
    """The Caputo derivative of a function."""

    equation = "y = D^gamma f (Caputo)"
    forces = ()
    solutions = ("function", "exact")
    kind: Literal["fractional-derivative"] = key("Which equation.", "fractional-derivative")
    order: Order = key("Order of the derivative that is taken (no unit).")
    function: Formula = key("The function to differentiate, an expression in t.")
    final_time: Positive = FINAL_TIME
    exact: Formula = key(
        "Its derivative: expression in t, or auto: Caputo's integral by quadrature.", "auto"
    )

    def build_problem(self) -> DerivativeProblem:
        """The derivative with its exact values."""
        order, final_time = self.order, self.final_time
        (function,) = expressions(self.function, ("y",), "function", self.parameters)
        if self.exact == "auto":
            exact = _checked_caputo(function, order, final_time)
            source = "Caputo's integral by quadrature"
        else:
            components = expressions(self.exact, ("y",), "exact", self.parameters)
            exact, source = ForcingPiece(components=components).evaluate, "expression"
        return DerivativeProblem(
            function=_from_rest(function, order, final_time),
            order=order,
            final_time=final_time,
            exact=exact,
            exact_source=source,
            equation=f"D^{order:g} of {function.text}",
        )


def _values(function: Expression, times: int = 0) -> Callable[[Array], Array]:
    """A function of the time, or its derivative of whole order."""
    for _ in range(times):
        function = function.derivative("t")
    return lambda time: ForcingPiece(components=(function,)).evaluate(time)[..., 0]


def _from_rest(function: Expression, order: float, final_time: float) -> Callable[[Array], Array]:
    """The function less f(0), for orders above 1 also less f'(0) t."""
    given, zero = _values(function), np.zeros(())
    slope = _values(function, 1)(zero + NEAR * final_time) if order > 1 else 0.0
    return lambda time: (given(time) - given(zero) - slope * time)[:, None]


def _caputo(
    function: Expression, order: float, final_time: float, nodes: int
) -> Callable[[Array], Array]:
    r"""Caputo's integral by Gauss-Jacobi quadrature, with :math:`s = t u^6` for singular starts.

    .. math:: D^\gamma f(t) = \frac{1}{\Gamma(n - \gamma)}
              \int_0^t (t - s)^{n - \gamma - 1} f^{(n)}(s)\, ds
    """
    whole = math.ceil(order)
    derived, rest, least = _values(function, whole), whole - order, NEAR * final_time
    if rest == 0:
        return lambda time: derived(np.maximum(time, least))[:, None]
    starts_at_zero = bool(np.isfinite(derived(np.zeros(1)))[0])
    u, weights = jacobi_rule(nodes, rest - 1.0)
    weights *= (u[:, None] ** np.arange(POWER)).sum(axis=1) ** (rest - 1.0) * u ** (POWER - 1)
    weights /= rest * weights.sum()

    def values(time: Array) -> Array:
        t = np.where(time > 0.0, time, 0.0 if starts_at_zero else least)
        found = derived(t[:, None] * u**POWER) @ weights
        return np.asarray(found * t**rest / math.gamma(rest))[:, None]

    return values


def _checked_caputo(
    function: Expression, order: float, final_time: float
) -> Callable[[Array], Array]:
    """Caputo's derivative of a function, where it is bounded and resolved."""
    exact, finer = (_caputo(function, order, final_time, n) for n in (NODES, 2 * NODES))
    found, other = (one(np.linspace(0.0, final_time, 17)) for one in (exact, finer))
    size = np.abs(found[1:]).max()
    # an unbounded derivative is far larger at 0
    if np.abs(found - other).max() <= RESOLVED * size and abs(found[0, 0]) <= 1e3 * size:
        return exact
    raise ArgumentError(
        "exact",
        f"{NODES} nodes do not resolve the derivative of {function.text!r} on [0, {final_time:g}], "
        "or it is not bounded at 0; give it as an expression",
    )
