"""Several formulas as one short program whose common parts are computed once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar, cast

import numpy as np

from fvi_cli.mathematics.expressions import NUMPY_FUNCTIONS, ExpressionError

T = TypeVar("T")
Instruction = tuple[str, float | str | int, int]
"""``(kind, what, other)``: registers, a number, or the name of a variable or function."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FormulaSystem:
    """A straight-line program that computes several values; data, never handed to an interpreter.

    Every instruction writes the next register:

    - ``("number", value, 0)`` and ``("variable", name, 0)``,
    - ``("call", name, register)``, a function of one register,
    - ``(operator, left, right)`` with an operator of ``+ - * /`` and two registers,
    - ``("power", exponent, register)`` with a number, ``("**", left, right)`` with two registers.

    Parameters
    ----------
    instructions
        The program.
    outputs
        Registers of the values.
    """

    instructions: tuple[Instruction, ...]
    outputs: tuple[int, ...]

    def evaluate(
        self, values: Mapping[str, T | float], functions: Mapping[str, Callable[..., T]]
    ) -> list[T | float]:
        """The values for given variables, on any algebra with ``+ - * / **``.

        Parameters
        ----------
        values
            A value for every variable of the program; arrays broadcast.
        functions
            The elementary functions on the algebra.

        Returns
        -------
        list[T | float]
            One value per output; a ``float`` where no variable takes part.

        Raises
        ------
        ExpressionError
            If a value or a function is missing.
        """
        registers: list[T | float] = []
        with np.errstate(all="ignore"):
            for kind, what, other in self.instructions:
                if kind == "number":
                    registers.append(cast(float, what))
                elif kind == "variable":
                    registers.append(_value_of(str(what), values))
                elif kind == "call":
                    registers.append(_call(str(what), registers[other], functions))
                elif kind == "power":
                    registers.append(_power(registers[other], cast(float, what)))
                else:
                    left, right = registers[cast(int, what)], registers[other]
                    registers.append(_combine(kind, left, right))
        return [registers[index] for index in self.outputs]


def _value_of(name: str, values: Mapping[str, T | float]) -> T | float:
    if name not in values:
        raise ExpressionError(f"no value was given for the variable {name!r}")
    return values[name]


def _call(name: str, argument: T | float, functions: Mapping[str, Callable[..., T]]) -> T | float:
    if isinstance(argument, float):
        return float(NUMPY_FUNCTIONS[name](np.asarray(argument)))
    if name not in functions:
        raise ExpressionError(f"the function {name!r} is not available here")
    return functions[name](argument)


def _power(base: T | float, exponent: float) -> T | float:
    if exponent == 2.0:
        # cheaper than a power, and exact in every algebra
        return _combine("*", base, base)
    if isinstance(base, float):
        return float(np.float64(base) ** exponent)
    whole = int(exponent) if float(exponent).is_integer() and abs(exponent) < 1e9 else exponent
    return base**whole  # type: ignore[operator, no-any-return]


def _combine(operator: str, left: T | float, right: T | float) -> T | float:
    if isinstance(left, float) and isinstance(right, float):
        # Python's own numbers raise at 1/0; NumPy's do not
        return float(_arithmetic(operator, np.float64(left), np.float64(right)))
    return _arithmetic(operator, left, right)


def _arithmetic(operator: str, left: T | float, right: T | float) -> T | float:
    if operator == "+":
        return left + right  # type: ignore[operator]
    if operator == "-":
        return left - right  # type: ignore[operator]
    if operator == "*":
        return left * right  # type: ignore[operator]
    if operator == "/":
        return left / right  # type: ignore[operator]
    return left**right  # type: ignore[operator, no-any-return]
