"""Linear combinations of coordinates on which a force acts, read from text."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.algebra.builder import derivatives
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression


def linear_form(system: FormulaSystem, names: Sequence[str]) -> Array:
    """The constant of a formula and the coefficients of the names; refused if it is not linear."""
    slopes = derivatives(system, [{name: 1.0} for name in names])[1:]
    if slopes.names or system.kinked:
        raise ExpressionError("not linear in the coordinates")
    constant = system.evaluate(dict.fromkeys(names, 0.0))
    return np.array([*constant, *slopes.evaluate({})], dtype=float)


def read_directions(texts: Sequence[str], coordinates: Sequence[str]) -> Array:
    r"""The rows B, ``(r, d)``, of linear forms :math:`y = B q` such as ``x2 - x1``.

    Raises
    ------
    ArgumentError
        At ``acts_on.<index>``, if that text is not a linear combination of the d coordinates.
    """
    places = {name: place for place, name in enumerate(coordinates)}
    rows = np.zeros((len(texts), len(coordinates)))
    for index, text in enumerate(texts):
        try:
            parsed = Expression.parse(text, variables=coordinates)
            used = sorted(parsed.names)
            constant, *factors = linear_form(parsed.system, used).tolist()
        except ExpressionError as error:
            raise ArgumentError(f"acts_on.{index}", str(error)) from None
        if constant or not any(factors):
            words = f"holds the constant {constant:g}" if constant else "contains no coordinate"
            raise ArgumentError(
                f"acts_on.{index}",
                f"{text!r} {words}; write a linear combination of coordinates, such as x2 - x1",
            )
        rows[index, [places[name] for name in used]] = factors
    return rows
