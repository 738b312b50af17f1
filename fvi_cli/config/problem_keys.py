"""The keys under ``problem``, by kind."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from fvi_cli.config.document import Node, ScalarNode
from fvi_cli.config.records import ByForm, ByKind, Key, ListOf, Named, Record, Refusal
from fvi_cli.config.sampled_keys import PiecesOrSamples, Samples
from fvi_cli.config.shapes import OPTIONAL, Choice, Formula, Integer, Matrix, Number, Text


def _alpha(node: Node) -> str:
    reason = (
        "not a key: order is the order gamma in the equation of motion, and gamma = 2 alpha, "
        "because the fractional action holds two derivatives of order alpha (the factor two)"
    )
    value = node.value if isinstance(node, ScalarNode) else None
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
    "alpha": lambda node: f"{_alpha(node)}, under damping",
    "gamma": "not a key: write damping: [{order: ..., coefficient: ...}]",
    "mu": "not a key: write damping: [{order: ..., coefficient: ...}]",
    "m": "not a key: write mass",
    "k": "not a key: write stiffness",
    "order": "not a key here: write damping: [{order: ..., coefficient: ...}]",
}

_NUMBER_OR_SYMMETRIC: Final = ByForm(single=Number(), several=Matrix())
_NUMBER_OR_LIST: Final = ByForm(
    single=Number(), several=ListOf(shape=Number(), example="[1.0, 0.0]")
)
_FORMULA_OR_LIST: Final = ByForm(
    single=Formula(), several=ListOf(shape=Formula(), example="[sin(t), 0]")
)
_PIECE: Final = Record(
    keys=(
        Key(
            name="until",
            shape=Number(above=0.0),
            meaning="Last time of the piece (unit of time); the last piece has none.",
            default=OPTIONAL,
        ),
        Key(
            name="value",
            shape=_FORMULA_OR_LIST,
            meaning="Force in this piece: number or expression in t, or one per coordinate.",
        ),
    )
)
_FORCING: Final = ByForm(
    single=Formula(),
    several=ListOf(
        shape=ByForm(single=Formula(), mapping=Samples()),
        example="[sin(t), {file: quake.csv, column: a}]",
    ),
    mapping=PiecesOrSamples(
        pieces=Record(
            keys=(
                Key(
                    name="pieces",
                    shape=ListOf(shape=_PIECE, example="[{until: 1, value: 8}, {value: 0}]"),
                    meaning="Pieces in the order of time; jumps are allowed between them.",
                ),
            )
        )
    ),
    example="{pieces: [{until: 1.0, value: 8}, {value: 0}]}, where the value may be a list",
)
_INITIAL: Final = Record(
    keys=(
        Key(
            name="position",
            shape=_NUMBER_OR_LIST,
            meaning="q(0), a number or one per coordinate (unit of length).",
            default=0.0,
        ),
        Key(
            name="velocity",
            shape=_NUMBER_OR_LIST,
            meaning="q'(0), a number or one per coordinate (length per time).",
            default=0.0,
        ),
    )
)
_FINAL_TIME: Final = Key(
    name="final_time", shape=Number(above=0.0), meaning="End T of the interval [0, T] (time)."
)


def _damping(default_order: float) -> Key:
    term = Record(
        keys=(
            Key(
                name="order",
                shape=Number(above=0.0, below=2.0),
                meaning="Order gamma of the derivative in the equation of motion (no unit).",
                default=default_order,
            ),
            Key(
                name="coefficient",
                shape=_NUMBER_OR_SYMMETRIC,
                meaning="Factor mu, a number or a symmetric matrix (mass times time^(gamma-2)).",
            ),
            Key(
                name="acts_on",
                shape=ListOf(
                    shape=Text(what="a linear combination of coordinates, such as x2 - x1"),
                    example="[x2 - x1]",
                ),
                meaning="Coordinates or linear combinations of them on which the term acts, one "
                "per row of the coefficient; without it: every coordinate.",
                default=OPTIONAL,
            ),
        ),
        refused=_WRONG_NAMES,
    )
    return Key(
        name="damping",
        shape=ListOf(shape=term, least=0, example="[{order: 0.5, coefficient: 1.0}]"),
        meaning="Terms mu D^gamma q of the equation of motion; none: no damping.",
        default=[],
    )


def _dampers(name: str, meaning: str) -> Key:
    term = Record(
        keys=(
            Key(
                name="order",
                shape=Number(above=0.0, below=2.0),
                meaning="Order gamma of the derivative in the equation of motion (no unit).",
            ),
            Key(name="coefficient", shape=Number(), meaning="Factor of the derivative."),
        ),
        refused=_WRONG_NAMES,
    )
    return Key(
        name=name,
        shape=ListOf(shape=term, least=0, example="[{order: 0.5, coefficient: 0.2}]"),
        meaning=meaning,
        default=[],
    )


_FORCE: Final = Key(
    name="forcing",
    shape=_FORCING,
    meaning="Force f(t): number or expression in t, one per coordinate, {pieces: [...]}, or "
    "samples, {file: force.csv, column: f}.",
    default="0",
)


def _scene_keys(*, own: tuple[Key, ...], default_order: float, forcing: Key = _FORCE) -> Record:
    return Record(
        keys=(
            *own,
            _damping(default_order),
            Key(
                name="derivative",
                shape=Choice(words=("caputo", "riemann-liouville")),
                meaning="caputo: D acts on q - q(0) (orders above 1: also - q'(0) t).",
                default="caputo",
            ),
            forcing,
            Key(
                name="initial",
                shape=_INITIAL,
                meaning="Position and velocity at t = 0.",
                default={"position": 0.0, "velocity": 0.0},
            ),
            _FINAL_TIME,
            Key(
                name="exact",
                shape=ByForm(
                    single=Formula(words=("auto",)),
                    several=ListOf(shape=Formula(), example="[cos(t), 0]"),
                ),
                meaning="Exact position: expression in t, one per coordinate, or auto: a closed "
                "form where one is known, otherwise a refined run.",
                default="auto",
            ),
        ),
        refused=_WRONG_AT_PROBLEM,
    )


_MASS: Final = Key(
    name="mass",
    shape=ByForm(single=Number(above=0.0), several=Matrix(positive=True)),
    meaning="M: a number or a symmetric positive definite matrix (unit of mass).",
    default=1.0,
)
_STIFFNESS: Final = Key(
    name="stiffness",
    shape=_NUMBER_OR_SYMMETRIC,
    meaning="K: a number or a symmetric matrix (mass per time^2).",
    default=1.0,
)
_OMEGA: Final = Key(
    name="omega",
    shape=Number(least=0.0),
    meaning="Angular frequency of small oscillations (1/time).",
    default=1.0,
)

_MASS_NUMBER: Final = Key(
    name="mass", shape=Number(above=0.0), meaning="Mass (unit of mass).", default=1.0
)
_DUFFING: Final = (
    _MASS_NUMBER,
    Key(
        name="stiffness",
        shape=Number(),
        meaning="k of the linear force k x; negative for a double well (mass per time^2).",
        default=1.0,
    ),
    Key(
        name="cubic_stiffness",
        shape=Number(),
        meaning="Factor of x^3 in the force (mass per time^2 and length^2).",
        default=1.0,
    ),
)
_KEPLER: Final = (
    Key(
        name="attraction",
        shape=Number(),
        meaning="k of the force k q/|q|^3 on a unit mass (length^3 per time^2).",
        default=1.0,
    ),
)
_CHAIN: Final = (
    Key(
        name="masses",
        shape=Integer(least=1, most=1000),
        meaning="Number n of masses; the coordinates are x1 ... xn (x if there is one).",
        default=10,
    ),
    _MASS_NUMBER,
    Key(
        name="stiffness",
        shape=Number(),
        meaning="k of the spring between neighbours (mass per time^2).",
        default=1.0,
    ),
    Key(
        name="ends",
        shape=Choice(words=("both", "left", "none")),
        meaning="Which ends of the chain are tied to a wall by a spring and its dampers.",
        default="both",
    ),
    _dampers(
        "dampers",
        "Fractional dampers c D^gamma beside every spring (c: mass times time^(gamma-2)).",
    ),
)
_PER_STOREY: Final = ByForm(
    single=Number(above=0.0), several=ListOf(shape=Number(above=0.0), example="[2.0, 1.0]")
)
_FRAME: Final = (
    Key(
        name="storeys",
        shape=Integer(least=1, most=1000),
        meaning="Number n of storeys; x1 ... xn are their displacements against the ground.",
        default=3,
    ),
    Key(
        name="mass",
        shape=_PER_STOREY,
        meaning="Mass of every storey, or a list from the ground up (unit of mass).",
        default=1.0,
    ),
    Key(
        name="stiffness",
        shape=_PER_STOREY,
        meaning="Shear stiffness of every storey, or a list (mass per time^2).",
        default=1.0,
    ),
    _dampers(
        "dampers",
        "Fractional dampers c D^gamma between storeys (c: mass times time^(gamma-2)).",
    ),
)
_GROUND: Final = Key(
    name="ground_acceleration",
    shape=ByForm(
        single=_FORCING.single,
        mapping=_FORCING.mapping,
        example="{pieces: [{until: 1.0, value: 8}, {value: 0}]}",
    ),
    meaning="Acceleration a(t) of the ground: number or expression in t, {pieces: [...]}, or "
    "samples, {file: quake.csv, column: a} (length per time^2).",
    default="0",
)
_STRING: Final = (
    Key(
        name="modes",
        shape=Integer(least=1, most=1000),
        meaning="Number n of sine modes; the coordinates x1 ... xn are their amplitudes.",
        default=8,
    ),
    Key(
        name="wave_speed",
        shape=Number(above=0.0),
        meaning="c, the speed of waves (length per time).",
        default=1.0,
    ),
    Key(
        name="length",
        shape=Number(above=0.0),
        meaning="L, the distance of the ends (length).",
        default=1.0,
    ),
    Key(
        name="pluck",
        shape=Record(
            keys=(
                Key(
                    name="at",
                    shape=Number(above=0.0, below=1.0),
                    meaning="Place, as a fraction of the length (no unit).",
                    default=0.5,
                ),
                Key(name="height", shape=Number(), meaning="Height there (length).", default=0.0),
            )
        ),
        meaning="A triangle that is added to the initial position.",
        default={"at": 0.5, "height": 0.0},
    ),
    _dampers(
        "internal_damping",
        "Terms -eta D^gamma u_ss of the material (eta: length^2 times time^(gamma-2)).",
    ),
)

_DOUBLE_PENDULUM: Final = (
    Key(
        name="masses",
        shape=ListOf(shape=Number(above=0.0), least=2, most=2, example="[1.0, 1.0]"),
        meaning="Point masses at the ends of the first and the second rod (unit of mass).",
        default=[1.0, 1.0],
    ),
    Key(
        name="lengths",
        shape=ListOf(shape=Number(above=0.0), least=2, most=2, example="[1.0, 1.0]"),
        meaning="Lengths of the rods (length).",
        default=[1.0, 1.0],
    ),
    Key(
        name="gravity",
        shape=Number(),
        meaning="Acceleration of free fall (length per time^2).",
        default=1.0,
    ),
    _dampers(
        "joints",
        "Fractional dampers c D^gamma in both joints (c: mass length^2 times time^(gamma-2)).",
    ),
)
_LAGRANGIAN: Final = (
    Key(
        name="coordinates",
        shape=ListOf(shape=Text(what="a name"), most=100, example="[x, y]"),
        meaning="Names of the coordinates q; the velocity of x is vx.",
    ),
    Key(
        name="parameters",
        shape=Named(shape=Number(), example="{m: 1.0, g: 9.81}"),
        meaning="Values of further names in the Lagrangian.",
        default={},
    ),
    Key(
        name="lagrangian",
        shape=Text(what="an expression in coordinates, velocities, parameters and t"),
        meaning="L(q, v, t), kinetic minus potential energy (energy).",
    ),
)

PROBLEM: Final = ByKind(
    kinds={
        "damped-oscillator": _scene_keys(own=(_MASS, _STIFFNESS), default_order=1.0),
        "bagley-torvik": _scene_keys(own=(_MASS, _STIFFNESS), default_order=1.5),
        "pendulum": _scene_keys(own=(_OMEGA,), default_order=1.0),
        "duffing": _scene_keys(own=_DUFFING, default_order=1.0),
        "kepler": _scene_keys(own=_KEPLER, default_order=1.0),
        "chain": _scene_keys(own=_CHAIN, default_order=1.0),
        "frame": _scene_keys(own=_FRAME, default_order=1.0, forcing=_GROUND),
        "string": _scene_keys(own=_STRING, default_order=1.0),
        "double-pendulum": _scene_keys(own=_DOUBLE_PENDULUM, default_order=1.0),
        "lagrangian": _scene_keys(own=_LAGRANGIAN, default_order=1.0),
        "fractional-derivative": Record(
            keys=(
                Key(
                    name="order",
                    shape=Number(above=0.0, below=2.0),
                    meaning="Order of the derivative that is taken (no unit).",
                ),
                Key(
                    name="function",
                    shape=Formula(),
                    meaning="The function to differentiate, an expression in t.",
                ),
                _FINAL_TIME,
                Key(
                    name="exact",
                    shape=Formula(words=("auto",)),
                    meaning="Its derivative: expression in t, or auto where one is known.",
                    default="auto",
                ),
            ),
            refused={"alpha": "not a key: write order", "gamma": "not a key: write order"},
        ),
    }
)
