"""Linear combinations of coordinates on which a force acts, read from text."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.matrices import Factored, dense, symmetric_form
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.arrays import Array, set_arrays
from fvi_cli.mathematics.expressions import FUNCTION_NAMES, Expression

_WORD: Final = re.compile(r"[A-Za-z_]\w*")
_MOST_SHOWN: Final = 12


def _names(used: Sequence[str], coordinates: Sequence[str]) -> tuple[str, ...]:
    """Names that a text may hold: those that it does, and as many as a complaint can list."""
    return tuple(dict.fromkeys([*used, *coordinates[:_MOST_SHOWN]]))


class _Affine:
    """The algebra of a constant plus a linear form; whatever leaves it is refused."""

    # so that NumPy numbers leave the arithmetic to this class
    __array_ufunc__ = None

    def __init__(self, constant: float, factors: Array) -> None:
        self.constant = constant
        self.factors = factors

    def __neg__(self) -> _Affine:
        return _Affine(-self.constant, -self.factors)

    def __add__(self, other: _Affine | float) -> _Affine:
        if isinstance(other, _Affine):
            return _Affine(self.constant + other.constant, self.factors + other.factors)
        return _Affine(self.constant + other, self.factors)

    __radd__ = __add__

    def __sub__(self, other: _Affine | float) -> _Affine:
        return self + (-other)

    def __rsub__(self, other: float) -> _Affine:
        return (-self) + other

    def __mul__(self, other: _Affine | float) -> _Affine:
        if isinstance(other, _Affine):
            raise ExpressionError("not linear: two coordinates are multiplied")
        return _Affine(self.constant * other, self.factors * other)

    __rmul__ = __mul__

    def __truediv__(self, other: _Affine | float) -> _Affine:
        if isinstance(other, _Affine) or other == 0:
            raise ExpressionError("not linear: divide by numbers other than 0 only")
        return self * (1.0 / other)

    def __rtruediv__(self, other: float) -> _Affine:
        raise ExpressionError("not linear: a number is divided by a coordinate")

    def __pow__(self, other: _Affine | float) -> _Affine:
        if isinstance(other, _Affine) or other != 1:
            raise ExpressionError("not linear: a coordinate occurs in a power")
        return self

    def __rpow__(self, other: float) -> _Affine:
        raise ExpressionError("not linear: a coordinate occurs in a power")


@dataclass(frozen=True, kw_only=True, eq=False)
class Directions:
    r"""Linear forms :math:`y = B q`, one per row.

    Parameters
    ----------
    rows
        B, shape ``(r, d)``.

    Raises
    ------
    ValueError
        If a row is zero or not finite.
    """

    rows: Array

    def __post_init__(self) -> None:
        set_arrays(self, rows=np.atleast_2d(self.rows))
        rows = self.rows
        if not np.all(np.isfinite(rows)):
            raise ArgumentError("acts_on", "every factor must be finite")
        if np.any(np.all(rows == 0, axis=1)):
            raise ArgumentError("acts_on", "a combination in which no coordinate is left")

    @classmethod
    def from_text(cls, texts: Sequence[str], coordinates: Sequence[str]) -> Directions:
        """Directions from texts such as ``x2 - x1``.

        Parameters
        ----------
        texts
            Names of coordinates or linear combinations of them.
        coordinates
            The names of the d coordinates.

        Raises
        ------
        ValueError
            ``acts_on.<index>: what is wrong``.
        """
        places = {name: place for place, name in enumerate(coordinates)}
        rows = []
        for index, text in enumerate(texts):
            # forms on the coordinates that occur: a structure has thousands
            used = [name for name in dict.fromkeys(_WORD.findall(text)) if name in places]
            units = np.eye(len(used))
            values = {name: _Affine(0.0, units[i]) for i, name in enumerate(used)}
            try:
                form = Expression.parse(text, variables=_names(used, coordinates)).evaluate(
                    values, {}
                )
            except ExpressionError as error:
                message = str(error)
                if error.unknown in FUNCTION_NAMES:
                    message = "not linear: a function of a coordinate"
                raise ArgumentError(f"acts_on.{index}", message) from None
            if not isinstance(form, _Affine) or np.all(form.factors == 0):
                raise ArgumentError(f"acts_on.{index}", f"no coordinate is left in {text!r}")
            if form.constant != 0:
                raise ArgumentError(
                    f"acts_on.{index}",
                    f"{text!r} holds the constant {form.constant:g}; "
                    "only linear combinations of coordinates are allowed",
                )
            row = np.zeros(len(coordinates))
            row[[places[name] for name in used]] = form.factors
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
        return Factored(rows=self.rows, inner=inner)
