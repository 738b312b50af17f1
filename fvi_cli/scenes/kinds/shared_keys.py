"""Keys that several kinds of problems share, and the effects that they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Final, Literal

import numpy as np

from fvi_cli.keys.containers import ByForm, ListOf, Named
from fvi_cli.keys.scalars import FormulaText, Matrix, Number
from fvi_cli.keys.settings import PlainSetting, Record, Setting, key, record_of
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.data import Damper, per_coordinate
from fvi_cli.scenes.forces import by_coordinate
from fvi_cli.scenes.kinds.damping_keys import ALPHA, NAME, ORDER, WRONG_NAMES, Name, Order
from fvi_cli.scenes.structures.matrix_keys import MASS_FILE

_DAMPING: Final = "not a key here: write damping: [{order: 0.5, coefficient: 0.3}]"

WRONG_AT_PROBLEM: Final[Mapping[str, str]] = {
    "alpha": ALPHA,
    "beta": "not a key: of damping write order, which is alpha + beta, under damping; the factor "
    "of x^3 is cubic_stiffness, of kind: duffing",
    **dict.fromkeys(("gamma", "order", "mu", "coefficient"), _DAMPING),
    **dict.fromkeys(
        ("c", "delta", "eta", "viscosity", "zeta", "xi", "damping_ratio"),
        "not a key here: write damping: [{order: 1, coefficient: c}], c = 2*zeta*sqrt(k*m)",
    ),
    **dict.fromkeys(
        ("omega0", "omega_0", "w0", "omega_n"),
        "not a key: write stiffness, which is mass times omega0**2 (omega itself for a pendulum)",
    ),
    "m": "not a key: write mass",
    "k": "not a key: write stiffness",
    **dict.fromkeys(
        ("T", "end_time", "tmax", "t_max", "t_end", "tend", "t_final", "duration"),
        "not a key: write final_time",
    ),
    **dict.fromkeys(("x0", "q0", "u0"), "not a key: write initial: {position: ...}"),
    "v0": "not a key: write initial: {velocity: ...}",
    "initial_position": "not a key: write initial: {position: ...}",
    "initial_velocity": "not a key: write initial: {velocity: ...}",
    "force": "not a key: write forcing",
}

MOST_COORDINATES: Final = 100_000
MASS_MATRIX: Final = ByForm(
    single=Number(above=0.0),
    several=Matrix(positive=True),
    mappings=(MASS_FILE,),
    example="{file: M.mtx}",
)


class NumbersAt(PlainSetting):
    """Numbers of some coordinates."""

    at: Annotated[
        Mapping[str, float], Named(shape=Number(), names="coordinates", example="{x3: 1.0}")
    ] = key("Values of some coordinates, by their names; the others are 0.")


_NUMBERS: Final = ByForm(
    single=Number(),
    several=ListOf(shape=Number(), most=MOST_COORDINATES, example="[1.0, 0.0]"),
    mappings=(record_of(NumbersAt),),
)
Numbers = Annotated[float | tuple[float, ...] | Mapping[str, Any], _NUMBERS]


class Initial(
    Setting,
    expected="a mapping such as {position: 1.0, velocity: 0.0}",
    refused={
        **dict.fromkeys(("x", "q", "u", "x0", "displacement"), "not a key: write position"),
        **dict.fromkeys(("v", "v0", "vx", "dx", "speed"), "not a key: write velocity"),
    },
):
    """Position and velocity at t = 0."""

    position: Numbers = key(
        "q(0), a number, one per coordinate, or {at: {x3: ...}} for some.",
        unit="length",
        default=0.0,
    )
    velocity: Numbers = key(
        "q'(0), a number, one per coordinate, or {at: {x3: ...}} for some.",
        unit="length per time",
        default=0.0,
    )


INITIAL: Final = key("Position and velocity at t = 0.", default={"position": 0.0, "velocity": 0.0})
FINAL_TIME: Final = key("End T of the interval [0, T].", unit="time")
DERIVATIVE: Final = key(
    "caputo: D acts on q - q(0) (orders above 1: also - q'(0) t).", default="caputo"
)
DerivativeWord = Literal["caputo", "riemann-liouville"]
Exact = Annotated[
    str | tuple[str, ...],
    ByForm(
        single=FormulaText(words=("auto", "none")),
        several=ListOf(shape=FormulaText(), example="[cos(t), 0]"),
    ),
]
EXACT: Final = key(
    "Exact position: expression in t, one per coordinate, or auto: that of linear scenes where it "
    "is known, otherwise a refined run; none: no reference and no errors.",
    default="auto",
)


class DamperKeys(Setting, refused=WRONG_NAMES):
    """A damper c D^gamma."""

    order: Order = ORDER
    coefficient: float = key("Factor of the derivative.")
    name: Name = NAME

    def value(self) -> Damper:
        """Order, coefficient and name."""
        return self.order, self.coefficient, self.name or ""


def dampers(unit: str, where: str = "") -> ListOf:
    """The shape of a list of dampers; `where` names lists with another unit in the schema."""
    keys = {
        **DamperKeys.keys,
        "coefficient": replace(DamperKeys.keys["coefficient"], unit=unit),
    }
    shape = Record(of=DamperKeys, keys=keys, variant=where)
    return ListOf(shape=shape, least=0, example="[{order: 0.5, coefficient: 0.2}]")


def vector_of(value: object, names: Sequence[str], place: str) -> Array:
    """A vector ``(d,)`` from one number, a list, or numbers of some coordinates (others are 0)."""
    if isinstance(value, Mapping):
        given = by_coordinate(value["at"], names, f"{place}.at")
        return np.array([float(given.get(name, 0.0)) for name in names])
    return per_coordinate(np.asarray(value, dtype=float), len(names))
