"""Keys that several kinds of problems share, and the effects that they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.directions import Directions
from fvi_cli.effects.matrices import (
    Array,
    Factored,
    SparseMatrix,
    dense,
)
from fvi_cli.keys.containers import ByForm, ListOf, Named
from fvi_cli.keys.cursor import OPTIONAL, Cursor
from fvi_cli.keys.records import Key, Record, Refusal
from fvi_cli.keys.scalars import Choice, Formula, Matrix, Number, Text
from fvi_cli.scenes.data import Damper, per_coordinate
from fvi_cli.scenes.forces import by_coordinate
from fvi_cli.scenes.structures.matrix_keys import MASS_FILE, MATRIX_FILE, matrix_of


def _alpha(at: Cursor) -> str:
    reason = (
        "not a key: order is the order gamma in the equation of motion, and gamma = 2 alpha, "
        "because the fractional action holds two derivatives of order alpha (the factor two)"
    )
    value = at.scalar
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < 1:
        return f"{reason}; write order: {2 * value:g}"
    return f"{reason}; write order with twice that number"


_WRONG_NAMES: Final[Mapping[str, Refusal]] = {
    "alpha": _alpha,
    "beta": "not a key: write order, which is alpha + beta",
    "gamma": "not a key: the order gamma of the derivative is called order",
    "mu": "not a key: the factor mu of the derivative is called coefficient",
}
_WRONG_AT_PROBLEM: Final[Mapping[str, Refusal]] = {
    "alpha": lambda at: f"{_alpha(at)}, under damping",
    "gamma": "not a key: write damping: [{order: ..., coefficient: ...}]",
    "mu": "not a key: write damping: [{order: ..., coefficient: ...}]",
    "m": "not a key: write mass",
    "k": "not a key: write stiffness",
    "order": "not a key here: write damping: [{order: ..., coefficient: ...}]",
}

MOST_COORDINATES: Final = 100_000
NUMBER_OR_SYMMETRIC: Final = ByForm(
    single=Number(), several=Matrix(), mappings=(MATRIX_FILE,), example="{file: K.mtx}"
)
MASS_MATRIX: Final = ByForm(
    single=Number(above=0.0),
    several=Matrix(positive=True),
    mappings=(MASS_FILE,),
    example="{file: M.mtx}",
)
_AT: Final = Record(
    keys=(
        Key(
            "at",
            Named(shape=Number(), names="coordinates", example="{x3: 1.0}"),
            "Values of some coordinates, by their names; the others are 0.",
        ),
    )
)
_NUMBER_OR_LIST: Final = ByForm(
    single=Number(),
    several=ListOf(shape=Number(), most=MOST_COORDINATES, example="[1.0, 0.0]"),
    mappings=(_AT,),
)
ORDER: Final = Key(
    "order",
    Number(above=0.0, below=2.0),
    "Order gamma of the derivative in the equation of motion (no unit).",
)
FINAL_TIME: Final = Key(
    "final_time", Number(above=0.0), "End T of the interval [0, T].", unit="time"
)
_INITIAL: Final = Key(
    "initial",
    Record(
        keys=(
            Key(
                "position",
                _NUMBER_OR_LIST,
                "q(0), a number, one per coordinate, or {at: {x3: ...}} for some.",
                unit="length",
                default=0.0,
            ),
            Key(
                "velocity",
                _NUMBER_OR_LIST,
                "q'(0), a number, one per coordinate, or {at: {x3: ...}} for some.",
                unit="length per time",
                default=0.0,
            ),
        )
    ),
    "Position and velocity at t = 0.",
    default={"position": 0.0, "velocity": 0.0},
)
_DERIVATIVE: Final = Key(
    "derivative",
    Choice(words=("caputo", "riemann-liouville")),
    "caputo: D acts on q - q(0) (orders above 1: also - q'(0) t).",
    default="caputo",
)
_EXACT: Final = Key(
    "exact",
    ByForm(
        single=Formula(words=("auto", "none")),
        several=ListOf(shape=Formula(), example="[cos(t), 0]"),
    ),
    "Exact position: expression in t, one per coordinate, or auto: a closed form where one is "
    "known, otherwise a refined run; none: no reference and no errors.",
    default="auto",
)


SHARED_KEYS: Final = ("damping", "derivative", "forcing", "initial", "final_time", "exact")
"""Names of the keys that all scenes share."""


def _damping(default_order: float) -> Key:
    term = Record(
        keys=(
            Key(ORDER.name, ORDER.shape, ORDER.meaning, default=default_order),
            Key(
                "coefficient",
                NUMBER_OR_SYMMETRIC,
                "Factor mu, a number, a symmetric matrix or {file: C.mtx}.",
                unit="mass times time^(gamma-2)",
            ),
            Key(
                "acts_on",
                ListOf(
                    shape=Text(what="a linear combination of coordinates, such as x2 - x1"),
                    example="[x2 - x1]",
                ),
                "Coordinates or linear combinations of them on which the term acts, one "
                "per row of the coefficient; without it: every coordinate.",
                default=OPTIONAL,
            ),
        ),
        refused=_WRONG_NAMES,
    )
    return Key(
        "damping",
        ListOf(shape=term, least=0, example="[{order: 0.5, coefficient: 1.0}]"),
        "Terms mu D^gamma q of the equation of motion; none: no damping.",
        default=[],
    )


def dampers_key(name: str, meaning: str, unit: str) -> Key:
    """A list of dampers, each with its order and coefficient, that stand in many places."""
    term = Record(
        keys=(ORDER, Key("coefficient", Number(), "Factor of the derivative.", unit=unit)),
        refused=_WRONG_NAMES,
    )
    shape = ListOf(shape=term, least=0, example="[{order: 0.5, coefficient: 0.2}]")
    return Key(name, shape, meaning, default=[], build=damper_pairs)


def scene_keys(own: Sequence[Key], *, default_order: float, force: Key) -> Record:
    """The keys of a scene: its own, then those that all scenes share."""
    shared = (_damping(default_order), _DERIVATIVE, force, _INITIAL, FINAL_TIME, _EXACT)
    return Record(keys=(*own, *shared), refused=_WRONG_AT_PROBLEM)


def build_damping(
    entries: Sequence[Mapping[str, Any]], names: tuple[str, ...], *, sparse: bool = False
) -> tuple[FractionalDamping, ...]:
    """The terms under ``damping``, of a scene with sparse matrices or dense ones.

    Raises
    ------
    ValueError
        ``damping.<index>...: what is wrong``.
    """
    terms = []
    for index, entry in enumerate(entries):
        try:
            if "acts_on" in entry:
                directions = Directions.from_text([str(text) for text in entry["acts_on"]], names)
                inner = dense(matrix_of(entry["coefficient"], directions.count))
                coefficient: ArrayLike | SparseMatrix | Factored = directions.factored(inner)
            else:
                coefficient = matrix_of(entry["coefficient"], len(names), sparse=sparse)
            terms.append(FractionalDamping(order=float(entry["order"]), coefficient=coefficient))
        except ValueError as error:
            raise ValueError(f"damping.{index}.{error}") from None
    return tuple(terms)


def vector_of(value: object, names: Sequence[str], place: str) -> Array:
    """A number for every coordinate, one per coordinate, or those of some, ``(d,)``.

    Raises
    ------
    ValueError
        ``<place>: what is wrong``.
    """
    if isinstance(value, Mapping):
        given = by_coordinate(value["at"], names, f"{place}.at")
        return np.array([float(given.get(name, 0.0)) for name in names])
    return per_coordinate(np.asarray(value, dtype=float), len(names))


def damper_pairs(entries: Sequence[Mapping[str, Any]]) -> tuple[Damper, ...]:
    """Order and coefficient of every damper."""
    return tuple((float(entry["order"]), float(entry["coefficient"])) for entry in entries)
