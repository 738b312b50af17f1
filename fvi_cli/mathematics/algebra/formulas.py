"""Several formulas as one short program whose common parts are computed once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar, cast

import numpy as np

from fvi_cli.mathematics.algebra.arithmetic import call, combine, value_of

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
                    registers.append(value_of(str(what), values))
                elif kind == "call":
                    registers.append(call(str(what), registers[other], functions))
                elif kind == "power":
                    registers.append(_power(registers[other], cast(float, what)))
                else:
                    left, right = registers[cast(int, what)], registers[other]
                    registers.append(combine(kind, left, right))
        return [registers[index] for index in self.outputs]


def _power(base: T | float, exponent: float) -> T | float:
    if exponent == 2.0:
        # cheaper than a power, and exact in every algebra
        return combine("*", base, base)
    if isinstance(base, float):
        return float(np.float64(base) ** exponent)
    whole = int(exponent) if float(exponent).is_integer() and abs(exponent) < 1e9 else exponent
    return base**whole  # type: ignore[operator, no-any-return]
