"""Keys that several kinds of problems share, and the effects that they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from fvi_cli.keys.containers import ByForm, ListOf, Named
from fvi_cli.keys.records import Key, Record, Refusal
from fvi_cli.keys.scalars import Choice, Formula, Matrix, Number
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.data import Damper, per_coordinate
from fvi_cli.scenes.forces import PARAMETERS, by_coordinate
from fvi_cli.scenes.kinds.damping_keys import ORDER, WRONG_NAMES, alpha, damping_key
from fvi_cli.scenes.structures.matrix_keys import MASS_FILE

_WRONG_AT_PROBLEM: Final[Mapping[str, Refusal]] = {
    "alpha": lambda at: f"{alpha(at)}, under damping",
    "gamma": "not a key: write damping: [{order: ..., coefficient: ...}]",
    "mu": "not a key: write damping: [{order: ..., coefficient: ...}]",
    "m": "not a key: write mass",
    "k": "not a key: write stiffness",
    "T": "not a key: write final_time",
    "end_time": "not a key: write final_time",
    "initial_position": "not a key: write initial: {position: ...}",
    "initial_velocity": "not a key: write initial: {velocity: ...}",
    "force": "not a key: write forcing",
    "order": "not a key here: write damping: [{order: ..., coefficient: ...}]",
}

MOST_COORDINATES: Final = 100_000
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
    "Exact position: expression in t, one per coordinate, or auto: that of linear scenes where it "
    "is known, otherwise a refined run; none: no reference and no errors.",
    default="auto",
)


SHARED_KEYS: Final = ("damping", "derivative", "forcing", "initial", "final_time", "exact")
"""Names of the keys that all scenes share."""


def dampers_key(name: str, meaning: str, unit: str) -> Key:
    """A list of dampers, each with its order and coefficient, that stand in many places."""
    term = Record(
        keys=(ORDER, Key("coefficient", Number(), "Factor of the derivative.", unit=unit)),
        refused=WRONG_NAMES,
    )
    shape = ListOf(shape=term, least=0, example="[{order: 0.5, coefficient: 0.2}]")
    return Key(name, shape, meaning, default=[], build=damper_pairs)


def scene_keys(own: Sequence[Key], *, default_order: float, force: Key) -> Record:
    """The keys of a scene: its own, then those that all scenes share."""
    shared = (damping_key(default_order), _DERIVATIVE, force, _INITIAL, FINAL_TIME, _EXACT)
    has_own = any(key.name == PARAMETERS.name for key in own)
    return Record(
        keys=(*own, *shared, *(() if has_own else (PARAMETERS,))),
        refused=_WRONG_AT_PROBLEM,
        declares=PARAMETERS.name,
    )


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
