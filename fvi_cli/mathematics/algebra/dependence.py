"""What formulas depend on."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Final

from fvi_cli.mathematics.algebra.arithmetic import KINKED, ExpressionError
from fvi_cli.mathematics.algebra.builder import Builder
from fvi_cli.mathematics.algebra.formulas import FormulaSystem, operands

DIGITS: Final = 200  # decimal digits of the arithmetic
SAME: Final = 1e-150
"""Differences up to this, relative to 1 and to the value, are round-off of 200 digits."""
PLACES: Final = 4  # number of places at which values are compared
_POLYNOMIAL: Final = ("+", "-", "*", "negate", "sin", "cos", "/", "**")


def arguments_of(system: FormulaSystem, kinds: Collection[str] = KINKED) -> FormulaSystem:
    """The arguments of the functions of some kinds in a program.

    For several arguments it is the first minus the second; functions with kinks are not smooth
    where it is zero. Integer powers do not count as functions.
    """
    builder = Builder()
    terms, found = builder.terms(system), []
    for place in system.needed:
        kind, *rest = system.instructions[place]
        if kind in kinds and not (kind == "**" and float(rest[1]).is_integer()):
            first, *others = (terms[one] for one in operands(system.instructions[place]))
            found.append(first - others[0] if others and kind != "power" else first)
    return builder.system(found)


def kinks_of(system: FormulaSystem) -> frozenset[str]:
    """Names on which the place of a kink depends."""
    return frozenset(arguments_of(system).names)


def constant_values(
    system: FormulaSystem, parameters: Mapping[str, float], names: Iterable[str]
) -> list[float] | None:
    """The values of all outputs if none depends on variables with these names, else None.

    Polynomials of the variables, and of sines and cosines of polynomials, are constant if their
    values at a few unrelated places agree in 150 digits. Other functions of a variable always count
    as dependent on it: a narrow pulse is 0 almost everywhere.

    Raises
    ------
    ExpressionError
        If one of the values is not a finite number.
    """
    moving: set[int] = set()
    for place in system.needed:
        kind, *rest = system.instructions[place]
        used = operands(system.instructions[place])
        if (kind == "variable" and rest[0] in set(names)) or moving.intersection(used):
            moving.add(place)
        if moving.intersection(used) and (
            kind not in _POLYNOMIAL
            or (kind == "/" and used[1] in moving)
            or (kind == "**" and not (float(rest[1]).is_integer() and float(rest[1]) > 0))
        ):
            return None
    if not moving:
        values = [float(one) for one in system.evaluate(parameters)]
    else:
        found = _at_places(system, parameters, sorted(names))
        for first, *others in zip(*found, strict=True):
            if not all(abs(other - first) <= SAME * (1 + abs(first)) for other in others):
                return None
        values = [0.0 if abs(one) <= SAME else float(one) for one in found[0]]
    if not all(map(math.isfinite, values)):
        raise ExpressionError("a derivative is constant, but not a finite real number")
    return values


def _at_places(
    system: FormulaSystem, parameters: Mapping[str, float], names: Sequence[str]
) -> list[Sequence[Any]]:
    import mpmath

    functions = {"sin": mpmath.sin, "cos": mpmath.cos}
    found: list[Sequence[Any]] = []
    with mpmath.workdps(DIGITS):
        for place in range(PLACES):
            variables = {
                name: (-1) ** (place + index) * mpmath.sqrt(0.37 + place + mpmath.mpf(index) / 7)
                for index, name in enumerate(names)
            }
            found.append(
                [mpmath.mpf(one) for one in system.evaluate({**parameters, **variables}, functions)]
            )
    return found
