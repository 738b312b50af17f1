"""What formulas depend on."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from fvi_cli.mathematics.algebra.arithmetic import KINKED, ExpressionError
from fvi_cli.mathematics.algebra.formulas import FormulaSystem, operands


def kinks_of(system: FormulaSystem) -> frozenset[str]:
    """Names on which functions with kinks depend."""
    every = (system.instructions[place] for place in system.needed)
    used = tuple(one for kind, *rest in every if kind in KINKED for one in operands((kind, *rest)))
    return frozenset(FormulaSystem(system.instructions, used).names)


def constant_values(
    system: FormulaSystem, parameters: Mapping[str, float], names: Iterable[str]
) -> list[float] | None:
    """The values of all outputs if no variable with one of these names is left, else None.

    Raises
    ------
    ExpressionError
        If one of the values is not a finite number.
    """
    if set(names).intersection(system.names):
        return None
    values = [float(one) for one in system.evaluate(parameters)]
    if not all(map(math.isfinite, values)):
        raise ExpressionError("a derivative is constant, but not a finite real number")
    return values
