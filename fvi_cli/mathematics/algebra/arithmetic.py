"""The functions that formulas call, on arrays and on numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, TypeVar, cast

import numpy as np

from fvi_cli.mathematics.arrays import Array

T = TypeVar("T")


class ExpressionError(ValueError):
    """A text that is not an allowed expression, or a formula that has no value here."""

    def __init__(self, message: str, column: int | None = None, unknown: str = "") -> None:
        super().__init__(message, column, unknown)
        self.message = message  # what is wrong and what is allowed
        self.column = column  # where in the text, from 1; None when it concerns the whole text
        self.unknown = unknown  # the unknown name, if the complaint is about one

    def __str__(self) -> str:
        return self.message if self.column is None else f"column {self.column}: {self.message}"


def _gamma(argument: Array) -> Array:
    # SciPy's special functions are slow to import and few scenes call for them
    from scipy.special import gamma

    return gamma(argument)


def _digamma(argument: Array) -> Array:
    from scipy.special import digamma

    return digamma(argument)


def _select(a: Array, b: Array, below: Array, above: Array) -> Array:
    both = 0.5 * (np.asarray(below) + above)
    return np.asarray(np.where(a < b, below, np.where(a > b, above, both)))


def _log_times(factor: Array, argument: Array) -> Array:
    return np.asarray(np.where(factor == 0, 0.0, factor * np.log(argument)))


_OF_NUMPY: Final = (
    *("sqrt", "cbrt", "exp", "expm1", "log", "log1p", "sin", "cos", "tan", "sinh", "cosh", "tanh"),
    *("arcsin", "arccos", "arctan", "arcsinh", "arccosh", "arctanh", "sign"),
)
NUMPY_FUNCTIONS: Final[Mapping[str, Callable[..., Array]]] = MappingProxyType(
    {name: getattr(np, name) for name in _OF_NUMPY}
    | {"abs": np.abs, "gamma": _gamma, "min": np.minimum, "max": np.maximum}
)
"""The functions an expression may call; `min` and `max` take two arguments at a time."""

INNER_FUNCTIONS: Final[Mapping[str, Callable[..., Array]]] = MappingProxyType(
    {
        "square": np.square,
        "power": np.power,
        "select": _select,
        "log_times": _log_times,
        "digamma": _digamma,
    }
)
"""Further functions of programs: ``select(a, b, x, y)`` is x where a < b, y where a > b, and
(x + y)/2 where a = b; ``log_times(f, x)`` is f log x, and 0 where f is 0."""

KINKED: Final = ("abs", "sign", "min", "max", "select")
"""Functions that are not smooth where the argument is zero or the first two arguments are equal."""


def value_of(name: str, values: Mapping[str, T | float]) -> T | float:
    """The value of a variable."""
    if name not in values:
        raise ExpressionError(f"no value was given for the variable {name!r}")
    value = values[name]
    if isinstance(value, np.ndarray):
        # Integer arrays would refuse negative powers.
        return value if value.dtype.kind not in "bui" else cast(T, value.astype(float))
    return cast(T, np.float64(value)) if isinstance(value, int | float) else value
