"""What formulas are made of: functions and operators on numbers, arrays or any other algebra."""

from __future__ import annotations

import operator
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


NUMPY_FUNCTIONS: Final[Mapping[str, Callable[[Array], Array]]] = MappingProxyType(
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
    }
)
"""The functions an expression may call, on floating-point arrays."""


def _abs(argument: ComplexArray) -> ComplexArray:
    return np.where(argument.real < 0, -argument, argument)


def _cbrt(argument: ComplexArray) -> ComplexArray:
    return np.copysign(1.0, argument.real) * _abs(argument) ** (1.0 / 3.0)


BESIDE_REAL: Final[Mapping[str, Callable[[ComplexArray], ComplexArray]]] = MappingProxyType(
    {
        **cast(Mapping[str, Callable[[ComplexArray], ComplexArray]], NUMPY_FUNCTIONS),
        "abs": _abs,
        "sign": lambda argument: np.sign(argument.real).astype(complex),
        "cbrt": _cbrt,
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
    """

    def __init__(self, message: str, column: int | None = None) -> None:
        super().__init__(message, column)
        self.message = message
        self.column = column

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
    return float(value) if isinstance(value, int | float) else value


def call(name: str, argument: T | float, functions: Mapping[str, Callable[..., T]]) -> T | float:
    """A function of a value; of a number in double precision, whatever the algebra is."""
    if isinstance(argument, float):
        return float(NUMPY_FUNCTIONS[name](np.asarray(argument)))
    if name not in functions:
        raise ExpressionError(f"the function {name!r} is not available here")
    return functions[name](argument)


def combine(kind: str, left: T | float, right: T | float) -> T | float:
    """The result of an operator; integral exponents are ``int``.

    Python's own numbers raise at 1/0 and turn complex at (-1)**0.5; NumPy's do neither.
    """
    if isinstance(right, float):
        if isinstance(left, float):
            return float(cast(float, _ARITHMETIC[kind](np.float64(left), np.float64(right))))
        if kind == "**" and right.is_integer() and abs(right) < 1e9:
            return cast(T, left ** int(right))  # type: ignore[operator]
    return cast(T, _ARITHMETIC[kind](left, right))


_ARITHMETIC: Final[Mapping[str, Callable[[object, object], object]]] = MappingProxyType(
    {
        "+": operator.add,
        "-": operator.sub,
        "*": operator.mul,
        "/": operator.truediv,
        "**": operator.pow,
    }
)
