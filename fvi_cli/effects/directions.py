"""Linear combinations of coordinates on which a force acts, read from text."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.matrices import Factored, dense, symmetric_form
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.algebra.builder import derivatives
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array, set_arrays
from fvi_cli.mathematics.expressions import Expression

_WORD: Final = re.compile(r"[A-Za-z_]\w*")
_MOST_SHOWN: Final = 12  # coordinates that a complaint lists


def linear_form(system: FormulaSystem, names: Sequence[str]) -> Array:
    """The constant of a formula and the coefficients of the names; refused if it is not linear."""
    slopes = derivatives(system, [{name: 1.0} for name in names])[1:]
    if slopes.names or system.kinked:
        raise ExpressionError("not linear in the coordinates")
    constant = system.evaluate(dict.fromkeys(names, 0.0))
    return np.array([*constant, *slopes.evaluate({})], dtype=float)


@dataclass(frozen=True, kw_only=True, eq=False)
class Directions:
    r"""Linear forms :math:`y = B q`, one per row.

    Raises
    ------
    ValueError
        If a row is zero or not finite.
    """

    rows: Array  # B, shape (r, d)
    labels: tuple[int, ...] = ()  # numbers of the rows in names; empty: 1, 2, ...

    def __post_init__(self) -> None:
        set_arrays(self, rows=np.atleast_2d(self.rows))
        if not np.all(np.isfinite(self.rows)):
            raise ArgumentError("acts_on", "every factor must be finite")
        if np.any(np.all(self.rows == 0, axis=1)):
            raise ArgumentError("acts_on", "a combination whose coordinates cancel")

    @classmethod
    def from_text(cls, texts: Sequence[str], coordinates: Sequence[str]) -> Directions:
        """Directions from texts such as ``x2 - x1``, by the names of the d coordinates.

        Raises
        ------
        ArgumentError
            At ``acts_on.<index>``, if that text is not a linear combination.
        """
        places = {name: place for place, name in enumerate(coordinates)}
        rows = np.zeros((len(texts), len(coordinates)))
        for index, text in enumerate(texts):
            try:
                constant, factors = _combination(text, places)
            except ExpressionError as error:
                raise ArgumentError(f"acts_on.{index}", str(error)) from None
            if not any(factors.values()):
                raise ArgumentError(
                    f"acts_on.{index}", f"{text!r} contains no coordinate, or they cancel"
                )
            if constant != 0:
                raise ArgumentError(
                    f"acts_on.{index}",
                    f"{text!r} holds the constant {constant:g}; "
                    "only linear combinations of coordinates are allowed",
                )
            rows[index, [places[name] for name in factors]] = list(factors.values())
        return cls(rows=rows)

    @property
    def count(self) -> int:
        """Number r of forms."""
        return int(self.rows.shape[0])

    def factored(self, coefficient: ArrayLike) -> Factored:
        r"""The d x d matrix :math:`B^T \mu B` of a force :math:`\mu y` along the directions.

        Raises
        ------
        ValueError
            If the coefficient is neither a number nor a symmetric r x r matrix.
        """
        inner = np.asarray(coefficient, dtype=float)
        inner = inner * np.eye(self.count) if inner.ndim == 0 else inner
        inner = dense(symmetric_form(inner, "coefficient"))
        if inner.shape[0] != self.count:
            raise ArgumentError(
                "coefficient",
                f"a matrix of size {inner.shape[0]} for {self.count} entries in acts_on",
            )
        return Factored(rows=self.rows, inner=inner, labels=self.labels)


def _combination(text: str, places: Mapping[str, int]) -> tuple[float, dict[str, float]]:
    """The constant of a text, and the factors of the coordinates that occur in it."""
    # only the coordinates that occur: a structure has thousands; a complaint lists a few more
    used = [name for name in dict.fromkeys(_WORD.findall(text)) if name in places]
    shown = list(places)[:_MOST_SHOWN]
    parsed = Expression.parse(text, variables=tuple(dict.fromkeys([*used, *shown])))
    constant, *factors = linear_form(parsed.system, used).tolist()
    return constant, dict(zip(used, factors, strict=True))
