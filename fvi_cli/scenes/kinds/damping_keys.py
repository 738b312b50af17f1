"""Keys of damping terms: fractional derivatives and relaxation laws, and what they make."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from numpy.typing import ArrayLike

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.directions import Directions
from fvi_cli.effects.laws.cole_cole import fractional_maxwell, fractional_zener
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.laws.prony import prony
from fvi_cli.effects.laws.tempered import tempered
from fvi_cli.effects.matrices import Factored, SparseMatrix, dense
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.containers import ByForm, ListOf
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.records import ByKind, Key, Record, Refusal, optional
from fvi_cli.keys.scalars import Matrix, Number, Shape, Text
from fvi_cli.scenes.structures.matrix_keys import MATRIX_FILE, matrix_of

Coefficient = ArrayLike | SparseMatrix | Factored


def alpha(at: Cursor) -> str:
    """Why there is no key for the order of the action's derivatives."""
    reason = (
        "not a key: order is the order gamma in the equation of motion, and gamma = 2 alpha, "
        "because the fractional action holds two derivatives of order alpha (the factor two)"
    )
    value = at.scalar
    if isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < 1:
        return f"{reason}; write order: {2 * value:g}"
    return f"{reason}; write order with twice that number"


WRONG_NAMES: Final[Mapping[str, Refusal]] = {
    "alpha": alpha,
    "beta": "not a key: write order, which is alpha + beta",
    "gamma": "not a key: the order gamma of the derivative is called order",
    "mu": "not a key: the factor mu of the derivative is called coefficient",
}
_OF_LAWS: Final[Mapping[str, Refusal]] = {
    "time": "not a key of a springpot: write law: zener or law: maxwell beside it",
    "relaxed": "not a key of a springpot: write law: zener or law: prony beside it",
    "unrelaxed": "not a key of a springpot: write law: zener beside it",
    "modulus": "not a key of a springpot: write law: maxwell beside it",
    "moduli": "not a key of a springpot: write law: prony beside it",
    "times": "not a key of a springpot: write law: prony beside it",
    "rate": "not a key of a springpot: write law: tempered beside it",
}
_WRONG_IN_LAWS: Final[Mapping[str, Refusal]] = {
    "tau": "not a key: the relaxation time tau is called time",
    "alpha": "not a key: the order of the law is called order",
}

NUMBER_OR_SYMMETRIC: Final = ByForm(
    single=Number(), several=Matrix(), mappings=(MATRIX_FILE,), example="{file: K.mtx}"
)
ORDER: Final = Key(
    "order",
    Number(above=0.0, below=2.0),
    "Order gamma of the derivative in the equation of motion; of laws in (0, 1) (no unit).",
)
_ACTS_ON: Final = optional(
    "acts_on",
    ListOf(
        shape=Text(what="a linear combination of coordinates, such as x2 - x1"),
        example="[x2 - x1]",
    ),
    "Coordinates or linear combinations of them on which the term acts, one "
    "per row of the coefficient; without it: every coordinate.",
)
_WHERE: Final = (
    optional(
        "coefficient",
        NUMBER_OR_SYMMETRIC,
        "Factor of the law, a number, a symmetric matrix or {file: Kv.mtx}; without it 1.",
    ),
    optional(
        "matrix",
        ByForm(several=Matrix(), mappings=(MATRIX_FILE,), example="{file: Kv.mtx}"),
        "zener, maxwell, prony, tempered: the same under another name, for matrices.",
    ),
    _ACTS_ON,
)
_MODULUS: Final = "stiffness over that of coefficient"
_LAW_ORDER: Final = Key(
    "order", Number(above=0.0, below=1.0), "Order a of the law, in (0, 1) (no unit)."
)
_TIME: Final = Key("time", Number(above=0.0), "zener, maxwell: relaxation time tau.", unit="time")
_POSITIVE: Final = ListOf(shape=Number(above=0.0), most=1000, example="[1.0, 0.5]")

_LAWS: Final[Mapping[str, tuple[Key, ...]]] = {
    "zener": (
        _LAW_ORDER,
        _TIME,
        Key(
            "relaxed", Number(least=0.0), "zener, prony: modulus G0 of slow motions.", unit=_MODULUS
        ),
        Key(
            "unrelaxed",
            Number(least=0.0),
            "zener: modulus Ginf of fast motions, at least the relaxed one.",
            unit=_MODULUS,
        ),
    ),
    "maxwell": (
        _LAW_ORDER,
        _TIME,
        Key("modulus", Number(above=0.0), "maxwell: modulus G of fast motions.", unit=_MODULUS),
    ),
    "prony": (
        Key("moduli", _POSITIVE, "prony: moduli g_i of the springs and dashpots.", unit=_MODULUS),
        Key("times", _POSITIVE, "prony: their relaxation times tau_i.", unit="time"),
        Key(
            "relaxed",
            Number(least=0.0),
            "prony: modulus that is left over.",
            unit=_MODULUS,
            default=0.0,
        ),
    ),
    "tempered": (
        Key("order", Number(above=0.0, below=1.0), "Order gamma of the derivative (no unit)."),
        Key("rate", Number(above=0.0), "tempered: rate l at which it forgets.", unit="1/time"),
    ),
}
_MAKE: Final[Mapping[str, Callable[..., Law]]] = {
    "zener": fractional_zener,
    "maxwell": fractional_maxwell,
    "prony": prony,
    "tempered": tempered,
}
SPRINGPOT: Final = "springpot"
_DASHPOT: Final = "{order: 1, coefficient: c}"
_MEANT: Final[Mapping[str, str]] = {
    **dict.fromkeys(
        ("kelvin-voigt", "voigt", "kelvin"),
        "a spring and a springpot of order 1: add the spring to the stiffness of the scene, and "
        f"write {_DASHPOT} for the springpot, with another order for the fractional law",
    ),
    **dict.fromkeys(
        ("dashpot", "viscous", "newton", "linear"), f"a springpot of order 1: write {_DASHPOT}"
    ),
    **dict.fromkeys(
        ("fractional", "scott-blair", "abel"), "write law: springpot, with order and coefficient"
    ),
    **dict.fromkeys(
        ("standard-linear-solid", "sls", "standard-solid", "cole-cole"),
        "write law: zener, or law: prony with moduli, times and relaxed",
    ),
    "rayleigh": "write proportional: {mass: a, stiffness: b} beside damping, where the kind has it",
}


def damping_key(default_order: float) -> Key:
    """The key ``damping`` of scenes, with the order of terms that do not say it."""
    springpot = Record(
        keys=(
            Key(ORDER.name, ORDER.shape, ORDER.meaning, default=default_order),
            Key(
                "coefficient",
                NUMBER_OR_SYMMETRIC,
                "Factor mu, a number, a symmetric matrix or {file: C.mtx}.",
                unit="mass times time^(gamma-2)",
            ),
            _ACTS_ON,
        ),
        refused={**WRONG_NAMES, **_OF_LAWS},
    )
    laws = {
        name: Record(keys=(*keys, *_WHERE), refused=_WRONG_IN_LAWS) for name, keys in _LAWS.items()
    }
    term: Shape = ByKind(
        kinds={SPRINGPOT: springpot, **laws},
        word="law",
        meaning="which law: a springpot mu D^gamma q, or one that relaxes",
        default=SPRINGPOT,
        meant=_MEANT,
    )
    return Key(
        "damping",
        ListOf(shape=term, least=0, example="[{order: 0.5, coefficient: 1.0}]"),
        "Terms mu D^gamma q of the equation of motion, and relaxation laws; none: no damping.",
        default=[],
    )


def coefficient_of(entry: Mapping[str, Any]) -> Any:
    """The number, matrix or file of a damping term."""
    return entry.get("matrix", entry.get("coefficient", 1.0))


def build_damping(
    entries: Sequence[Mapping[str, Any]], names: tuple[str, ...], *, sparse: bool = False
) -> tuple[tuple[FractionalDamping, ...], tuple[Law, ...]]:
    """The terms and the laws under ``damping``, of a scene with sparse matrices or dense ones.

    Raises
    ------
    ValueError
        ``damping.<index>...: what is wrong``.
    """
    terms: list[FractionalDamping] = []
    laws: list[Law] = []
    for index, entry in enumerate(entries):
        try:
            coefficient = _coefficient(entry, names, sparse=sparse)
            law = entry.get("law", SPRINGPOT)
            if law == SPRINGPOT:
                order = float(entry["order"])
                terms.append(FractionalDamping(order=order, coefficient=coefficient))
                continue
            own = {key.name: entry[key.name] for key in _LAWS[law]}
            laws.append(_MAKE[law](**own, coefficient=coefficient))
        except ArgumentError as error:
            raise error.below(f"damping.{index}") from None
    return tuple(terms), tuple(laws)


def _coefficient(entry: Mapping[str, Any], names: tuple[str, ...], *, sparse: bool) -> Coefficient:
    if "matrix" in entry and "coefficient" in entry:
        raise ArgumentError("matrix", "give this or coefficient, not both")
    given = coefficient_of(entry)
    if "acts_on" in entry:
        directions = Directions.from_text([str(text) for text in entry["acts_on"]], names)
        return directions.factored(dense(matrix_of(given, directions.count)))
    return matrix_of(given, len(names), sparse=sparse)
