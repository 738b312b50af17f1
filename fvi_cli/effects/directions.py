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
from fvi_cli.mathematics.algebra.formulas import FormulaSystem, operands
from fvi_cli.mathematics.arrays import Array, set_arrays
from fvi_cli.mathematics.expressions import Expression

_WORD: Final = re.compile(r"[A-Za-z_]\w*")
_MOST_SHOWN: Final = 12  # coordinates that a complaint lists
_REASONS: Final[Mapping[object, str]] = {
    "*": "two coordinates are multiplied",
    "/": "divide by numbers other than 0 only",
    **dict.fromkeys(("**", "power"), "a coordinate occurs in a power"),
}


def linear_form(system: FormulaSystem, names: Sequence[str]) -> Array:
    """The constant of a formula and the coefficients of the names; refused if it is not linear."""
    units = dict(zip(names, np.eye(1 + len(names))[1:], strict=True))
    forms: dict[int, Array] = {}
    for place in system.needed:
        kind, *rest = instruction = system.instructions[place]
        used = [forms[one] for one in operands(instruction)]
        numbers = [one for one in used if not one[1:].any()]
        if kind == "number":
            form = float(rest[0]) * np.eye(1 + len(names))[0]
        elif kind == "variable":
            form = units[str(rest[0])]
        elif kind in ("+", "-", "negate"):
            form = sum(used) if kind == "+" else used[0] - used[1] if kind == "-" else -used[0]
        elif kind == "*" and numbers:
            form = used[0] * used[1][0] if numbers[0] is used[1] else used[1] * used[0][0]
        elif kind == "/" and not used[1][1:].any() and used[1][0] != 0:
            form = used[0] / used[1][0]
        elif kind == "**" and rest[1] == 1:
            form = used[0]
        else:
            raise ExpressionError(f"not linear: {_REASONS.get(kind, 'a function of a coordinate')}")
        forms[place] = np.asarray(form)
    return forms[system.outputs[0]]


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
        rows = self.rows
        if not np.all(np.isfinite(rows)):
            raise ArgumentError("acts_on", "every factor must be finite")
        if np.any(np.all(rows == 0, axis=1)):
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
        rows = []
        for index, text in enumerate(texts):
            # only on the coordinates that occur: a structure has thousands
            used = [name for name in dict.fromkeys(_WORD.findall(text)) if name in places]
            try:
                # more names than a complaint can list are not needed
                known = tuple(dict.fromkeys([*used, *coordinates[:_MOST_SHOWN]]))
                parsed = Expression.parse(text, variables=known)
                constant, *factors = linear_form(parsed.system, used)
            except ExpressionError as error:
                raise ArgumentError(f"acts_on.{index}", str(error)) from None
            if not any(factors):
                raise ArgumentError(
                    f"acts_on.{index}", f"{text!r} contains no coordinate, or they cancel"
                )
            if constant != 0:
                raise ArgumentError(
                    f"acts_on.{index}",
                    f"{text!r} holds the constant {constant:g}; "
                    "only linear combinations of coordinates are allowed",
                )
            row = np.zeros(len(coordinates))
            row[[places[name] for name in used]] = factors
            rows.append(row)
        return cls(rows=np.array(rows))

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
        if inner.ndim == 0:
            inner = inner * np.eye(self.count)
        inner = dense(symmetric_form(inner, "coefficient"))
        if inner.shape[0] != self.count:
            raise ArgumentError(
                "coefficient",
                f"a matrix of size {inner.shape[0]} for {self.count} entries in acts_on",
            )
        return Factored(rows=self.rows, inner=inner, labels=self.labels)
