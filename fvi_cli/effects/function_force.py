"""A force that a program computes, for scenes that are made in Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar, cast

import numpy as np

from fvi_cli.effects.matrices import Array
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS, ExpressionError
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.series.taylor import SeriesError

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True, eq=False)
class FunctionForce:
    """One component of a force as a function of the time, with an expression in t added.

    Parameters
    ----------
    function
        Times of any shape to the force at them, in the same shape; smooth between the break points
        that its piece of the forcing has.
    factor
        What it is multiplied by.
    formula
        An expression in t that is added; None: nothing.
    """

    function: Callable[[Array], Array]
    factor: float = 1.0
    formula: Expression | None = None

    @property
    def text(self) -> str:
        """What the component is called in messages."""
        return str(getattr(self.function, "__name__", "a function"))

    @property
    def is_constant(self) -> bool:
        """Nothing is known of it."""
        return False

    def scaled(self, factor: float) -> FunctionForce:
        """The force times a number."""
        formula = self.formula
        if formula is not None:
            formula = Expression.parse(f"({factor!r})*({formula.text})", formula.variables)
        return replace(self, factor=factor * self.factor, formula=formula)

    def plus(self, formula: Expression) -> FunctionForce:
        """The force plus an expression in t."""
        if self.formula is not None:
            formula = Expression.parse(f"({self.formula.text}) + ({formula.text})", ("t",))
        return replace(self, formula=formula)

    def evaluate(
        self, names: Mapping[str, T | float], functions: Mapping[str, Callable[..., T]]
    ) -> T | float:
        """The force at the times under ``t``.

        Raises
        ------
        SeriesError
            On any other algebra than floating-point numbers.
        ExpressionError
            Where the function gives another shape, or no real numbers.
        """
        time = names["t"]
        if not isinstance(time, np.ndarray | float | int):
            raise SeriesError(f"{self.text}: a function is not a formula")
        times = np.asarray(time, dtype=float)
        values = np.asarray(self.function(times))
        if values.shape not in (times.shape, ()) or values.dtype.kind not in "fiu":
            raise ExpressionError(
                f"{self.text}: it gives {values.dtype} of shape {values.shape} for times of shape "
                f"{times.shape}; it must give a number for each"
            )
        found = self.factor * np.broadcast_to(values.astype(float), times.shape)
        if self.formula is not None:
            found = found + self.formula.evaluate({"t": times}, NUMPY_FUNCTIONS)
        return cast(T, found)
