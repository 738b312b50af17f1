"""What formulas are made of: functions on arrays, and on complex numbers beside the real axis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, TypeVar, cast

import numpy as np

from fvi_cli.mathematics.arrays import Array, ComplexArray

T = TypeVar("T")


def _gamma(argument: Array) -> Array:
    # SciPy's special functions are slow to import and few scenes call for them.
    from scipy.special import gamma

    return np.asarray(gamma(argument))


NUMPY_FUNCTIONS: Final[Mapping[str, Callable[..., Array]]] = MappingProxyType(
    {
        "sqrt": np.sqrt,
        "cbrt": np.cbrt,
        "exp": np.exp,
        "expm1": np.expm1,
        "log": np.log,
        "log1p": np.log1p,
        "sin": np.sin,
        "cos": np.cos,
        "tan": np.tan,
        "sinh": np.sinh,
        "cosh": np.cosh,
        "tanh": np.tanh,
        "arcsin": np.arcsin,
        "arccos": np.arccos,
        "arctan": np.arctan,
        "arcsinh": np.arcsinh,
        "arccosh": np.arccosh,
        "arctanh": np.arctanh,
        "abs": np.abs,
        "sign": np.sign,
        "gamma": _gamma,
        "min": np.minimum,
        "max": np.maximum,
    }
)
"""The functions an expression may call, on floating-point arrays; of the last two every pair."""


def _digamma(argument: Array) -> Array:
    from scipy.special import digamma

    return np.asarray(digamma(argument))


def _select(a: Array, b: Array, below: Array, above: Array) -> Array:
    both = 0.5 * (np.asarray(below) + above)
    return np.asarray(np.where(a < b, below, np.where(a > b, above, both)))


def _log_times(factor: Array, argument: Array) -> Array:
    return np.asarray(np.where(factor == 0, 0.0, factor * np.log(argument)))


KINKED: Final = ("abs", "sign", "min", "max", "select")
"""What is not smooth where its argument is zero, or its first two arguments are equal."""

INNER_FUNCTIONS: Final[Mapping[str, Callable[..., Array]]] = MappingProxyType(
    {
        "square": np.square,
        "power": np.power,
        "select": _select,
        "log_times": _log_times,
        "digamma": _digamma,
    }
)
"""What programs call besides: ``select(a, b, x, y)`` is x where a < b, y where a > b, and their
mean where a = b; ``log_times(f, x)`` is f log x, and 0 where f is."""


def _abs(argument: ComplexArray) -> ComplexArray:
    return np.where(argument.real < 0, -argument, argument)


def _cbrt(argument: ComplexArray) -> ComplexArray:
    return np.copysign(1.0, argument.real) * _abs(argument) ** (1.0 / 3.0)


def _select_branch(
    a: ComplexArray, b: ComplexArray, below: ComplexArray, above: ComplexArray
) -> ComplexArray:
    return _select(np.real(a), np.real(b), below, above)  # type: ignore[arg-type, return-value]


REAL_BRANCHES: Final[Mapping[str, Callable[..., ComplexArray]]] = MappingProxyType(
    {
        **cast(Mapping[str, Callable[..., ComplexArray]], {**NUMPY_FUNCTIONS, **INNER_FUNCTIONS}),
        "abs": _abs,
        "sign": lambda argument: np.sign(argument.real).astype(complex),
        "cbrt": _cbrt,
        "min": lambda a, b: _select_branch(a, b, a, b),
        "max": lambda a, b: _select_branch(b, a, a, b),
        "select": _select_branch,
    }
)
"""The same functions at complex numbers beside the real axis, continued from there."""


class ExpressionError(ValueError):
    """A text that is not an allowed expression.

    Parameters
    ----------
    message
        What is wrong and what is allowed.
    column
        Where in the text, counted from 1; None when it concerns the whole text.
    unknown
        The name that is not known, where that is wrong.
    """

    def __init__(self, message: str, column: int | None = None, unknown: str = "") -> None:
        super().__init__(message, column, unknown)
        self.message = message
        self.column = column
        self.unknown = unknown

    def __str__(self) -> str:
        return self.message if self.column is None else f"column {self.column}: {self.message}"


def value_of(name: str, values: Mapping[str, T | float]) -> T | float:
    """The value of a variable."""
    if name not in values:
        raise ExpressionError(f"no value was given for the variable {name!r}")
    value = values[name]
    if isinstance(value, np.ndarray):
        # Integer arrays would refuse negative powers.
        return value if value.dtype.kind not in "bui" else cast(T, value.astype(float))
    return cast(T, np.float64(value)) if isinstance(value, int | float) else value
