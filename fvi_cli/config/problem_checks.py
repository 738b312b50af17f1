"""What must hold between the keys under ``problem``, and the problem that they make."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.config.complaints import Complaints, KeyPath
from fvi_cli.config.document import Node
from fvi_cli.config.records import node_at
from fvi_cli.config.shapes import INVALID, is_complete
from fvi_cli.mathematics.expressions import NUMPY_FUNCTIONS, Expression, ExpressionError
from fvi_cli.mathematics.power_series import SeriesError, expand
from fvi_cli.scenes.problem import AnyProblem
from fvi_cli.scenes.registry import FIXED_SIZES, SIZE_KEYS, build_problem

Array = NDArray[np.float64]
Complain = Callable[[KeyPath, str], None]

# Where an expression is tried: inside of the steps of any grid that people use. On their points,
# where a quotient such as sin(t - 1)/(t - 1) has no value, it must not be infinite.
_TRIALS: Final = 97
_GRID: Final = 720
_EXPANDED_TO: Final = 4.0  # above the power of t itself, which a quotient would lose
_LEADING_PATH: Final = re.compile(r"([a-z_]+(?:\.[a-z0-9_]+)*): (.*)", re.DOTALL)
_OTHER_NAMES: Final = {
    "initial_position": ("initial", "position"),
    "initial_velocity": ("initial", "velocity"),
}


def force_key(problem: Mapping[str, Any]) -> str:
    """The key under which the force of a problem stands."""
    return "ground_acceleration" if problem.get("kind") == "frame" else "forcing"


def break_points(problem: Mapping[str, Any]) -> list[tuple[int, float]]:
    """Index and end of every piece of the forcing that has a valid one inside of (0, T)."""
    forcing = problem.get(force_key(problem))
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
    problem: Mapping[str, Any],
    node: Node,
    path: KeyPath,
    complaints: Complaints,
    *,
    build: Callable[[Mapping[str, Any]], AnyProblem] = build_problem,
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
    build
        Makes the problem; raises ``ValueError("key.path: what is wrong")``.
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
        return build(problem)
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
    kind = problem.get("kind")
    own_size = _own_size(problem)
    initial = problem.get("initial")
    if isinstance(initial, Mapping):
        places[2:2] = [(("initial", key), value) for key, value in initial.items()]
    damping = problem.get("damping")
    for index, term in enumerate(damping if isinstance(damping, list) else []):
        if isinstance(term, Mapping) and "acts_on" not in term:
            places.append((("damping", index, "coefficient"), term.get("coefficient")))
    forcing = problem.get("forcing")
    pieces = forcing.get("pieces") if isinstance(forcing, Mapping) else None
    for index, piece in enumerate(pieces if isinstance(pieces, list) else []):
        if isinstance(piece, Mapping):
            places.append((("forcing", "pieces", index, "value"), piece.get("value")))
    sized = [(key, len(value)) for key, value in places if isinstance(value, list)]
    if own_size is not None:
        sized.insert(0, own_size)
    for key, size in sized[1:]:
        if size != sized[0][1]:
            first = ".".join(str(part) for part in sized[0][0]) or f"kind {kind}"
            complain(key, f"is for {_coordinates(size)}, but {first} for {sized[0][1]}")


def _own_size(problem: Mapping[str, Any]) -> tuple[KeyPath, int] | None:
    """The number of coordinates where the kind or one of its keys says it, and that key."""
    kind = str(problem.get("kind"))
    if kind == "pendulum":
        return ("omega",), 1
    if kind in FIXED_SIZES:
        return (), FIXED_SIZES[kind]
    names = problem.get("coordinates")
    if kind == "lagrangian":
        return (("coordinates",), len(names)) if isinstance(names, list) else None
    size = problem.get(SIZE_KEYS.get(kind, ""))
    return ((SIZE_KEYS[kind],), size) if isinstance(size, int) else None


def _coordinates(size: int) -> str:
    return f"{size} coordinate" if size == 1 else f"{size} coordinates"


def _check_pieces(problem: Mapping[str, Any], complain: Complain) -> None:
    """Every piece but the last has an end; the ends increase and lie inside of (0, T)."""
    force = force_key(problem)
    forcing = problem.get(force)
    pieces = forcing.get("pieces") if isinstance(forcing, Mapping) else None
    if not isinstance(pieces, list):
        return
    final_time = problem.get("final_time")
    earlier = 0.0
    for index, piece in enumerate(pieces):
        if not isinstance(piece, Mapping):
            continue
        key: KeyPath = (force, "pieces", index)
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
    inside = _instants(0.0, final_time, _TRIALS)
    everywhere = np.concatenate([[0.0], inside])
    _try(problem.get("exact"), ("exact",), everywhere, complain)
    _try(problem.get("function"), ("function",), everywhere, complain)
    force = force_key(problem)
    forcing = problem.get(force)
    if not isinstance(forcing, Mapping):
        grid = _instants(0.0, final_time, _GRID)
        _try(forcing, (force,), inside, complain, grid=grid, begin=0.0)
        return
    begin = 0.0
    pieces = forcing.get("pieces")
    for index, piece in enumerate(pieces if isinstance(pieces, list) else []):
        if not isinstance(piece, Mapping):
            return
        end = piece.get("until", final_time)
        if not isinstance(end, float) or not begin < end <= final_time:
            return
        inside, grid = _instants(begin, end, _TRIALS), _instants(begin, end, _GRID)
        key = (force, "pieces", index, "value")
        _try(piece.get("value"), key, inside, complain, grid=grid, begin=begin)
        begin = end


def _instants(begin: float, end: float, count: int) -> Array:
    """Times behind `begin` up to `end`, in equal steps."""
    return begin + (end - begin) * np.arange(1, count + 1) / count


def _try(
    value: object,
    key: KeyPath,
    times: Array,
    complain: Complain,
    *,
    grid: Array | None = None,
    begin: float | None = None,
) -> None:
    """It must be finite at `times`, nowhere on `grid` infinite, and integrable at `begin`."""
    if isinstance(value, list):
        for index, entry in enumerate(value):
            _try(entry, (*key, index), times, complain, grid=grid, begin=begin)
        return
    if not isinstance(value, str) or value == "auto":
        return
    tried = times if grid is None else np.concatenate([times, grid])
    try:
        expression = Expression.parse(value, variables=("t",))
        values = np.broadcast_to(
            np.asarray(expression.evaluate({"t": tried}, NUMPY_FUNCTIONS)), tried.shape
        )
    except ExpressionError as error:
        complain(key, str(error))
        return
    may_be_undefined = np.arange(tried.size) >= times.size
    wrong = np.flatnonzero(np.isinf(values) | (np.isnan(values) & ~may_be_undefined))
    if wrong.size:
        at = float(tried[wrong[0]])
        found = float(values[wrong[0]])
        what = "not a real number" if math.isnan(found) else "infinite"
        complain(key, f"is {what} at t = {at:.6g}; it must be finite up to final_time")
        return
    if begin is not None:
        _limit_impulse(expression, begin, key, complain)


def _limit_impulse(expression: Expression, begin: float, key: KeyPath, complain: Complain) -> None:
    """A force may be infinite at the beginning of its piece, but not its integral."""
    if np.isfinite(expression.evaluate({"t": np.array([begin])}, NUMPY_FUNCTIONS)).all():
        return
    try:
        power = expand(expression, _EXPANDED_TO, begin).leading_exponent
    except SeriesError:
        return
    if power <= -1:
        behind = "t" if begin == 0 else f"(t - {begin:g})"
        complain(
            key,
            f"grows like {behind}**{power:g} behind t = {begin:g}, so that its integral is "
            "infinite; powers above -1 are allowed",
        )
