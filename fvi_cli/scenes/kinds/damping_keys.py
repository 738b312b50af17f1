"""Damping terms: keys of fractional derivatives and relaxation laws, and their effects."""

from __future__ import annotations

import copy
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, ClassVar, Final

from fvi_cli.effects.damping import Coefficient, FractionalDamping
from fvi_cli.effects.directions import Directions
from fvi_cli.effects.laws.cole_cole import ColeCole, fractional_maxwell, fractional_zener
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.laws.prony import prony
from fvi_cli.effects.matrices import dense
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.containers import ByForm, ListOf, OneOrMany
from fvi_cli.keys.kinds import ByKind
from fvi_cli.keys.scalars import Integer, Matrix, Number, Text
from fvi_cli.keys.settings import (
    Fraction,
    NotNegative,
    Positive,
    Setting,
    key,
    record_of,
)
from fvi_cli.scenes.structures.matrix_keys import MATRIX_FILE, matrix_of

Effect = FractionalDamping | Law


ALPHA: Final = (
    "not a key: order is the order gamma in the equation of motion, and gamma = 2 alpha, "
    "because the fractional action holds two derivatives of order alpha (the factor two)"
)
_WRONG_PLACE: Final[Mapping[str, str]] = dict.fromkeys(
    ("storey", "story", "floor"),
    "not a key here: what stands between floors of a frame is written under dampers",
)
WRONG_NAMES: Final[Mapping[str, str]] = {
    "alpha": ALPHA,
    "beta": "not a key: write order, which is alpha + beta",
    "gamma": "not a key: the order gamma of the derivative is called order",
    "mu": "not a key: the factor mu of the derivative is called coefficient",
}
_OF_LAWS: Final[Mapping[str, str]] = {
    "time": "not a key of a springpot: write law: zener or law: maxwell in the same entry",
    "relaxed": "not a key of a springpot: write law: zener or law: prony in the same entry",
    "unrelaxed": "not a key of a springpot: write law: zener in the same entry",
    "modulus": "not a key of a springpot: write law: maxwell in the same entry",
    "moduli": "not a key of a springpot: write law: prony in the same entry",
    "times": "not a key of a springpot: write law: prony in the same entry",
}
_WRONG_IN_LAWS: Final[Mapping[str, str]] = {
    **_WRONG_PLACE,
    "tau": "not a key: the relaxation time tau is called time",
    "alpha": "not a key: the order of the law is called order",
}

NUMBER_OR_SYMMETRIC: Final = ByForm(
    single=Number(), several=Matrix(), mappings=(MATRIX_FILE,), example="{file: K.mtx}"
)
_MATRIX: Final = ByForm(several=Matrix(), mappings=(MATRIX_FILE,), example="{file: Kv.mtx}")
_DIRECTIONS: Final = ListOf(
    shape=Text(what="a linear combination of coordinates, such as x2 - x1"), example="[x2 - x1]"
)
_EXAMPLE: Final = "{order: 0.5, coefficient: 1.0}"
_ACTS_ON: Final = key(
    "Coordinates or linear combinations of them on which the term acts, one "
    "per row of the coefficient; without it: every coordinate.",
    default=None,
)
Order = Annotated[float, Number(above=0.0, below=2.0)]
ORDER: Final = key(
    "Order gamma of the derivative in the equation of motion; of laws in (0, 1) (no unit)."
)
_LAW_ORDER: Final = key("Order a of the law, in (0, 1) (no unit).")
_TIME: Final = key("zener, maxwell: relaxation time tau.", unit="time")
_MODULUS: Final = "stiffness over that of coefficient"
_PositiveList = Annotated[
    tuple[float, ...], ListOf(shape=Number(above=0.0), most=1000, example="[1.0, 0.5]")
]
ActsOn = Annotated[tuple[str, ...] | None, _DIRECTIONS]


NAME: Final = key(
    "What quantities know the damper by: force_top, deformation_top and work_top for name: top; "
    "without it by its number, force_1: those under damping, then those under dampers. Where it "
    "acts in several storeys, or on several combinations, their number stands behind: force_top_3.",
    default=None,
)
Name = Annotated[str | None, Text(what="a word such as top", pattern=r"[A-Za-z]\w*")]


class _OnCoordinates(Setting):
    """Keys that every term has after its own keys."""

    acts_on: ActsOn = _ACTS_ON
    name: Name = NAME

    @property
    def factor(self) -> Any:
        """The factor of the term: a number, matrix or file."""
        return getattr(self, "coefficient", None)


class Springpot(_OnCoordinates, refused={**WRONG_NAMES, **_WRONG_PLACE, **_OF_LAWS}):
    """A term mu D^gamma q."""

    order: Order = ORDER
    coefficient: Annotated[Any, NUMBER_OR_SYMMETRIC] = key(
        "Factor mu, a number, a symmetric matrix or {file: C.mtx}.",
        unit="mass times time^(gamma-2)",
    )

    def effects(self, on: Callable[[Any], Any]) -> tuple[Effect, ...]:
        """The term; `on` converts a factor to the coefficient for all coordinates."""
        return (FractionalDamping(order=float(self.order), coefficient=on(self.factor)),)


class KelvinVoigt(
    _OnCoordinates,
    refused={
        **WRONG_NAMES,
        **_WRONG_PLACE,
        **dict.fromkeys(("viscosity", "eta", "c"), "not a key: write coefficient"),
        **dict.fromkeys(("modulus", "relaxed", "k", "E"), "not a key: write stiffness"),
    },
):
    """A spring parallel to a springpot."""

    stiffness: Annotated[Any, NUMBER_OR_SYMMETRIC] = key(
        "kelvin-voigt: stiffness k of the spring, a number or a symmetric matrix.",
        unit="mass per time^2",
    )
    coefficient: Annotated[Any, NUMBER_OR_SYMMETRIC] = key(
        "Factor mu of the springpot parallel to it, a number or a symmetric matrix.",
        unit="mass times time^(gamma-2)",
    )
    order: Order = key(
        "Order gamma of the springpot; 1 is the dashpot of Kelvin and Voigt.", default=1.0
    )

    def effects(self, on: Callable[[Any], Any]) -> tuple[Effect, ...]:
        """The springpot, and the spring as a law without memory."""
        springpot = FractionalDamping(order=float(self.order), coefficient=on(self.factor))
        forgetful = ColeCole(order=0.5, time=1.0)
        spring = Law(kernel=forgetful, size=0.0, relaxed=1.0, coefficient=on(self.stiffness))
        return springpot, spring


class LawTerm(_OnCoordinates, refused=_WRONG_IN_LAWS):
    """A relaxation law with its factor."""

    make: ClassVar[Callable[..., Law]]
    coefficient: Annotated[Any, NUMBER_OR_SYMMETRIC] = key(
        "Factor of the law (without it 1), a number, a symmetric matrix or {file: Kv.mtx}.",
        default=None,
    )
    matrix: Annotated[Any, _MATRIX] = key(
        "zener, maxwell, prony: the same under another name, for matrices.", default=None
    )

    @property
    def factor(self) -> Any:
        """The factor of the law: a number, matrix or file."""
        given = self.coefficient if self.matrix is None else self.matrix
        return 1.0 if given is None else given

    def effects(self, on: Callable[[Any], Any]) -> tuple[Effect, ...]:
        """The law; `on` converts a factor to the coefficient for all coordinates."""
        if self.matrix is not None and self.coefficient is not None:
            raise ArgumentError("matrix", "give this or coefficient, not both")
        others = (_OnCoordinates, LawTerm, AtStorey)
        shared = {name for one in others for name in one.__annotations__}
        own = {name: one for name, one in vars(self).items() if name not in shared}
        return (type(self).make(**own, coefficient=on(self.factor)),)


class Zener(LawTerm):
    """The fractional Zener law."""

    make = staticmethod(fractional_zener)
    order: Fraction = _LAW_ORDER
    time: Positive = _TIME
    relaxed: NotNegative = key("zener, prony: modulus G0 of slow motions.", unit=_MODULUS)
    unrelaxed: NotNegative = key(
        "zener: modulus Ginf of fast motions, at least the relaxed one.", unit=_MODULUS
    )


class Maxwell(LawTerm):
    """The fractional Maxwell law."""

    make = staticmethod(fractional_maxwell)
    order: Fraction = _LAW_ORDER
    time: Positive = _TIME
    modulus: Positive = key("maxwell: modulus G of fast motions.", unit=_MODULUS)


class Prony(LawTerm):
    """A sum of exponentials."""

    make = staticmethod(prony)
    moduli: _PositiveList = key("prony: moduli g_i of the springs and dashpots.", unit=_MODULUS)
    times: _PositiveList = key("prony: their relaxation times tau_i.", unit="time")
    relaxed: NotNegative = key(
        "prony: modulus that remains after a long time.", unit=_MODULUS, default=0.0
    )


_IN_STOREYS: Final = OneOrMany(shape=Integer(least=1, most=1000), most=1000, as_it_stands=True)


class AtStorey(Setting):
    """The storey in which a damper of a building stands."""

    storey: Annotated[tuple[int, ...] | None, _IN_STOREYS] = key(
        "Storey i between whose floor and ceiling it stands: it acts on x_i - x_(i-1), storey 1 "
        "on x_1; or a list, [1, 3], for equal dampers in several; without it one stands in every "
        "storey.",
        default=None,
    )
    # a storey needs no direction, and the factor is a number
    acts_on = None
    matrix = None


SPRINGPOT: Final = "springpot"
_LAWS: Final[Mapping[str, type[Setting]]] = {
    SPRINGPOT: Springpot,
    "kelvin-voigt": KelvinVoigt,
    "zener": Zener,
    "maxwell": Maxwell,
    "prony": Prony,
}
_STOREYS: Final[Mapping[str, str]] = {
    **dict.fromkeys(
        ("story", "floor", "level", "at", "between", "storeys"), "not a key: write storey: 1"
    ),
    "acts_on": "not a key here: write storey, or give the term under damping",
    **dict.fromkeys(("c", "viscosity"), "not a key: write coefficient"),
}


def _storey_damper(law: type[Setting]) -> type[Setting]:
    """The law as a damper between floors, whose factors are numbers."""
    made: type[Setting] = types.new_class(
        f"Storey{law.__name__}", (AtStorey, law), {"refused": {**law.refused, **_STOREYS}}
    )
    made.keys = {
        name: replace(one, shape=Number(), meaning=f"{one.meaning.partition(', a number')[0]}.")
        if one.shape is NUMBER_OR_SYMMETRIC
        else one
        for name, one in made.keys.items()
    }
    return made


_AT_STOREYS: Final = {word: _storey_damper(law) for word, law in _LAWS.items()}
_DASHPOT: Final = "{order: 1, coefficient: c}"
_MEANT: Final[Mapping[str, str]] = {
    **dict.fromkeys(
        ("dashpot", "viscous", "newton", "linear"), f"a springpot of order 1: write {_DASHPOT}"
    ),
    **dict.fromkeys(
        ("standard-linear-solid", "sls", "standard-solid", "cole-cole"),
        "write law: zener, or law: prony with moduli, times and relaxed",
    ),
    "rayleigh": "not a law of one damper: write rayleigh: {ratios: [0.02, 0.05], modes: [1, 3]} "
    "next to damping, where the kind has it (frame, structure)",
}


def damping_terms(default_order: float = 1.0, *, at_storeys: bool = False) -> ListOf:
    """The shape of a list of terms; `at_storeys`: dampers of a building, in storeys."""
    laws = _AT_STOREYS if at_storeys else _LAWS
    name = "StoreyDamper" if at_storeys else "DampingTerm"
    term = ByKind(
        kinds={
            word: record_of(law, order=default_order) if word == SPRINGPOT else record_of(law)
            for word, law in laws.items()
        },
        word="law",
        meaning="which law: a springpot mu D^gamma q, or one that relaxes",
        default=SPRINGPOT,
        meant=_MEANT,
        name=f"{name}-order-{default_order:g}",
    )
    example = "{storey: 1, order: 0.5, coefficient: 0.2}" if at_storeys else _EXAMPLE
    return ListOf(shape=term, least=0, example=f"[{example}]")


Term = Springpot | KelvinVoigt | LawTerm
Damping = Annotated[tuple[Term, ...], damping_terms()]
DAMPING: Final = key(
    "Terms mu D^gamma q of the equation of motion, and relaxation laws; none: no damping.",
    default=[],
)


def build_damping(
    terms: Sequence[Term], names: tuple[str, ...], *, sparse: bool = False, place: str = "damping"
) -> tuple[tuple[FractionalDamping, ...], tuple[Law, ...]]:
    """The terms and the laws under ``damping``, with sparse or dense matrices."""
    return damping_effects(
        terms, lambda term, factor: _coefficient(term, factor, names, sparse=sparse), place
    )


def check_names_of_dampers(every: Sequence[Effect], place: str) -> None:
    """Refuse two dampers with the same name."""
    used = [name for _, name in {(one.number, one.name) for one in every}]
    for name in sorted({name for name in used if name}):
        if used.count(name) > 1:
            raise ArgumentError(place, f"two dampers have the name {name}")


def damping_effects(
    terms: Sequence[Term], on: Callable[[Term, Any], Any], place: str, *, before: int = 0
) -> tuple[tuple[FractionalDamping, ...], tuple[Law, ...]]:
    """Effects of the terms in the list at `place`; `on` returns coefficients for all coordinates.

    Dampers are numbered from `before` + 1 on.
    """
    found: list[Effect] = []
    for index, term in enumerate(terms):
        try:
            made = term.effects(partial(on, term))
            for one in made:
                # `replace` would check its matrix again
                own = copy.copy(one)
                vars(own).update(name=term.name or "", number=before + index + 1)
                found.append(own)
        except ArgumentError as error:
            raise error.below(f"{place}.{index}") from None
    damping = tuple(one for one in found if isinstance(one, FractionalDamping))
    return damping, tuple(one for one in found if not isinstance(one, FractionalDamping))


def _coefficient(
    term: Term, factor: object, names: tuple[str, ...], *, sparse: bool
) -> Coefficient:
    if term.acts_on is None:
        return matrix_of(factor, len(names), sparse=sparse)
    directions = Directions.from_text(term.acts_on, names)
    return directions.factored(dense(matrix_of(factor, directions.count)))
