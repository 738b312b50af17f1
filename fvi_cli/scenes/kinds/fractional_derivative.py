"""``fractional-derivative``: the Caputo derivative of a function, without a motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, ClassVar, Final

import numpy as np

from fvi_cli.effects.forcing import ForcingPiece
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.scalars import FormulaText
from fvi_cli.keys.settings import Positive, key
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.series.power_series import SeriesError, expand
from fvi_cli.scenes.forces import PARAMETERS, Parameters, expressions, with_parameters
from fvi_cli.scenes.kinds.damping_keys import Order
from fvi_cli.scenes.kinds.kind import Kind
from fvi_cli.scenes.kinds.shared_keys import FINAL_TIME
from fvi_cli.scenes.problem import DerivativeProblem

SERIES_CUTOFF: Final = 48.0


class FractionalDerivative(
    Kind,
    declares="parameters",
    refused=dict.fromkeys(("alpha", "gamma"), "not a key: write order"),
):
    """The Caputo derivative of a function."""

    kind = "fractional-derivative"
    equation = "y = D^gamma f (Caputo)"
    example: ClassVar = {"order": "0.5", "function": "t**2*sin(t)", "final_time": "1.0"}
    sweep = "problem.order: {from: 0.1, to: 1.9, number: 10}"
    methods = "{bdf: [1, 2, 3], sampling: nodes}"

    order: Order = key("Order of the derivative that is taken (no unit).")
    function: Annotated[str, FormulaText()] = key(
        "The function to differentiate, an expression in t."
    )
    final_time: Positive = FINAL_TIME
    exact: Annotated[str, FormulaText(words=("auto",))] = key(
        "Its derivative: expression in t, or auto where one is known.", default="auto"
    )
    parameters: Parameters = PARAMETERS

    def build_problem(self, *, search: bool = True) -> DerivativeProblem:
        """The derivative with its exact values."""
        order, final_time = float(self.order), float(self.final_time)
        values = with_parameters(vars(self))
        (function,) = expressions(values["function"], 1, "function")
        if not 0 < order < 2:
            raise ArgumentError("order", f"{order!r} is not allowed; it must lie in (0, 2)")
        if self.exact == "auto":
            exact = _termwise_derivative(function, order, final_time)
            source = "power series, term by term"
        else:
            exact = ForcingPiece(components=expressions(values["exact"], 1, "exact")).evaluate
            source = "expression"
        return DerivativeProblem(
            function=_from_rest(function, order),
            order=order,
            final_time=final_time,
            exact=exact,
            exact_source=source,
            equation=f"D^{order:g} of {function.text}",
        )


def _from_rest(function: Expression, order: float) -> Callable[[Array], Array]:
    """The function less f(0), for orders above 1 also less f'(0) t."""
    given = ForcingPiece(components=(function,)).evaluate
    slope = 0.0
    if order > 1:
        try:
            series = expand(function, 2.0)
        except SeriesError as error:
            raise ArgumentError("function", f"its slope at 0 is not known: {error}") from None
        slope = float(series.coefficients[series.exponents == 1.0].sum())

    def values(time: Array) -> Array:
        start = given(np.zeros(1))[0]
        return np.asarray(given(time) - start - (slope * time)[:, None])

    return values


def _termwise_derivative(
    function: Expression, order: float, final_time: float
) -> Callable[[Array], Array]:
    """Caputo derivative of a function by its expansion at 0, if that converges up to T."""
    try:
        series = expand(function, SERIES_CUTOFF).without_initial_terms(order)
        derivative = series.fractional_derivative(order)
    except SeriesError as error:
        raise ArgumentError("exact", f"auto needs an expansion of the function: {error}") from None
    if derivative.exponents.size and derivative.exponents[0] < 0:
        raise ArgumentError(
            "exact", "the derivative is not bounded at 0; it cannot be measured there"
        )
    sizes = np.abs(derivative.coefficients) * final_time**derivative.exponents
    last = sizes[derivative.exponents > SERIES_CUTOFF - order - 6.0]
    if last.sum() > 1e-16 * sizes.sum() or sizes.max(initial=0.0) > 100 * abs(
        float(derivative(np.array(final_time)))
    ):
        raise ArgumentError(
            "exact",
            f"the expansion of {function.text!r} does not converge on [0, {final_time:g}] "
            "fast enough; give the derivative as an expression",
        )
    return lambda time: derivative(time)[:, None]
