"""The keys under ``problem``, by kind, and what must hold between them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from fvi_cli.config.complaints import Complaints, KeyPath
from fvi_cli.config.document import Node, ScalarNode
from fvi_cli.config.shapes import (
    INVALID,
    OPTIONAL,
    ByForm,
    ByKind,
    Choice,
    Formula,
    Key,
    ListOf,
    Matrix,
    Number,
    Record,
    Refusal,
    is_complete,
    node_at,
)
from fvi_cli.mathematics.expressions import NUMPY_FUNCTIONS, Expression, ExpressionError
from fvi_cli.scenes.problem import AnyProblem
from fvi_cli.scenes.registry import build_problem

Complain = Callable[[KeyPath, str], None]

# Where an expression is tried: inside of the steps of any grid that people use.
_TRIALS: Final = 97
_LEADING_PATH: Final = re.compile(r"([a-z_]+(?:\.[a-z0-9_]+)*): (.*)", re.DOTALL)
_OTHER_NAMES: Final = {
    "initial_position": ("initial", "position"),
    "initial_velocity": ("initial", "velocity"),
}


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
    several=ListOf(shape=Formula(), example="[sin(t), 0]"),
    mapping=Record(
        keys=(
            Key(
                name="pieces",
                shape=ListOf(shape=_PIECE, example="[{until: 1, value: 8}, {value: 0}]"),
                meaning="Pieces in the order of time; jumps are allowed between them.",
            ),
        )
    ),
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
        ),
        refused=_WRONG_NAMES,
    )
    return Key(
        name="damping",
        shape=ListOf(shape=term, least=0, example="[{order: 0.5, coefficient: 1.0}]"),
        meaning="Terms mu D^gamma q of the equation of motion; none: no damping.",
        default=[],
    )


def _scene_keys(*, own: tuple[Key, ...], default_order: float) -> Record:
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
            Key(
                name="forcing",
                shape=_FORCING,
                meaning="Force f(t): number or expression in t, one per coordinate, or pieces.",
                default="0",
            ),
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

PROBLEM: Final = ByKind(
    kinds={
        "damped-oscillator": _scene_keys(own=(_MASS, _STIFFNESS), default_order=1.0),
        "bagley-torvik": _scene_keys(own=(_MASS, _STIFFNESS), default_order=1.5),
        "pendulum": _scene_keys(own=(_OMEGA,), default_order=1.0),
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


def break_points(problem: Mapping[str, Any]) -> list[tuple[int, float]]:
    """Index and end of every piece of the forcing that has a valid one inside of (0, T)."""
    forcing = problem.get("forcing")
    pieces = forcing.get("pieces") if isinstance(forcing, Mapping) else None
    final_time = problem.get("final_time")
    if not isinstance(pieces, list) or not isinstance(final_time, float):
        return []
    return [
        (index, piece["until"])
        for index, piece in enumerate(pieces)
        if isinstance(piece, Mapping)
        and isinstance(piece.get("until"), float)
        and piece["until"] < final_time
    ]


def make_problem(
    problem: Mapping[str, Any], node: Node, path: KeyPath, complaints: Complaints
) -> AnyProblem | None:
    """The problem that a mapping read by PROBLEM describes; None when something is wrong.

    Parameters
    ----------
    problem
        What was read; may hold INVALID.
    node, path
        Where it stands.
    complaints
        Receives what is wrong between the keys.
    """
    before = len(complaints)

    def complain(key: KeyPath, message: str) -> None:
        found, _ = node_at(node, key)
        complaints.add(found.place, (*path, *key), message)

    _check_sizes(problem, complain)
    _check_pieces(problem, complain)
    _check_values(problem, complain)
    if not is_complete(dict(problem)) or len(complaints) > before:
        return None
    try:
        return build_problem(problem)
    except ValueError as error:
        leading = _LEADING_PATH.fullmatch(str(error))
        if leading is None:
            complain((), str(error))
            return None
        first, *rest = leading.group(1).split(".")
        key: KeyPath = (*_OTHER_NAMES.get(first, (first,)), *rest)
        if key[0] not in problem:
            complain((), str(error))
        else:
            complain(key, leading.group(2))
        return None


def _check_sizes(problem: Mapping[str, Any], complain: Complain) -> None:
    """Everything that is given per coordinate must have the same number of coordinates."""
    places: list[tuple[KeyPath, object]] = [
        (("mass",), problem.get("mass")),
        (("stiffness",), problem.get("stiffness")),
        (("forcing",), problem.get("forcing")),
        (("exact",), problem.get("exact")),
    ]
    initial = problem.get("initial")
    if isinstance(initial, Mapping):
        places[2:2] = [(("initial", key), value) for key, value in initial.items()]
    damping = problem.get("damping")
    for index, term in enumerate(damping if isinstance(damping, list) else []):
        if isinstance(term, Mapping):
            places.append((("damping", index, "coefficient"), term.get("coefficient")))
    forcing = problem.get("forcing")
    pieces = forcing.get("pieces") if isinstance(forcing, Mapping) else None
    for index, piece in enumerate(pieces if isinstance(pieces, list) else []):
        if isinstance(piece, Mapping):
            places.append((("forcing", "pieces", index, "value"), piece.get("value")))
    sized = [(key, len(value)) for key, value in places if isinstance(value, list)]
    if problem.get("kind") == "pendulum":
        sized.insert(0, (("omega",), 1))
    for key, size in sized[1:]:
        if size != sized[0][1]:
            first = ".".join(str(part) for part in sized[0][0])
            complain(key, f"is for {_coordinates(size)}, but {first} for {sized[0][1]}")


def _coordinates(size: int) -> str:
    return f"{size} coordinate" if size == 1 else f"{size} coordinates"


def _check_pieces(problem: Mapping[str, Any], complain: Complain) -> None:
    """Every piece but the last has an end; the ends increase and lie inside of (0, T)."""
    forcing = problem.get("forcing")
    pieces = forcing.get("pieces") if isinstance(forcing, Mapping) else None
    if not isinstance(pieces, list):
        return
    final_time = problem.get("final_time")
    earlier = 0.0
    for index, piece in enumerate(pieces):
        if not isinstance(piece, Mapping):
            continue
        key: KeyPath = ("forcing", "pieces", index)
        last = index == len(pieces) - 1
        until = piece.get("until")
        if until is INVALID:
            continue
        if until is None:
            if not last:
                complain((*key, "until"), "missing; only the last piece has no end")
            continue
        if last:
            complain((*key, "until"), "not allowed in the last piece, which holds until the end")
        elif not until > earlier:
            complain((*key, "until"), f"{until:g} is not after {earlier:g}; ends must increase")
        elif isinstance(final_time, float) and not until < final_time:
            complain(
                (*key, "until"),
                f"{until:g} is not before final_time = {final_time:g}; later pieces never act",
            )
        earlier = max(earlier, until)


def _check_values(problem: Mapping[str, Any], complain: Complain) -> None:
    """Expressions must be finite: forces inside of the interval, known functions at 0 as well."""
    final_time = problem.get("final_time")
    if not isinstance(final_time, float):
        return
    inside = final_time * np.arange(1, _TRIALS + 1) / _TRIALS
    everywhere = np.concatenate([[0.0], inside])
    _try(problem.get("exact"), ("exact",), everywhere, complain)
    _try(problem.get("function"), ("function",), everywhere, complain)
    forcing = problem.get("forcing")
    if not isinstance(forcing, Mapping):
        _try(forcing, ("forcing",), inside, complain)
        return
    begin = 0.0
    pieces = forcing.get("pieces")
    for index, piece in enumerate(pieces if isinstance(pieces, list) else []):
        if not isinstance(piece, Mapping):
            return
        end = piece.get("until", final_time)
        if not isinstance(end, float) or not begin < end <= final_time:
            return
        times = begin + (end - begin) * np.arange(1, _TRIALS + 1) / _TRIALS
        _try(piece.get("value"), ("forcing", "pieces", index, "value"), times, complain)
        begin = end


def _try(value: object, key: KeyPath, times: np.ndarray[Any, Any], complain: Complain) -> None:
    if isinstance(value, list):
        for index, entry in enumerate(value):
            _try(entry, (*key, index), times, complain)
        return
    if not isinstance(value, str) or value == "auto":
        return
    try:
        expression = Expression.parse(value, variables=("t",))
        values = np.broadcast_to(
            np.asarray(expression.evaluate({"t": times}, NUMPY_FUNCTIONS)), times.shape
        )
    except ExpressionError as error:
        complain(key, str(error))
        return
    wrong = np.flatnonzero(~np.isfinite(values))
    if wrong.size:
        at = float(times[wrong[0]])
        found = float(values[wrong[0]])
        what = "not a real number" if math.isnan(found) else "infinite"
        complain(key, f"is {what} at t = {at:.6g}; it must be finite up to final_time")
