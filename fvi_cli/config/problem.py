"""What must hold between the keys under ``problem``, and the problem that they make."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import KeyPath
from fvi_cli.keys.cursor import INVALID, PLAIN, Cursor, is_complete
from fvi_cli.keys.settings import Setting
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.forces import with_parameters
from fvi_cli.scenes.kinds.kind import Kind
from fvi_cli.scenes.kinds.oscillators import DampedOscillator
from fvi_cli.scenes.kinds.shared_keys import Initial
from fvi_cli.scenes.problem import AnyProblem
from fvi_cli.scenes.registry import PROBLEM
from fvi_cli.scenes.structures.matrix_keys import matrix_size

# A force is tried at two sets of times. A prime number of parts: no usual grid has points there,
# and it must be finite. 720 = 6! parts: points of most grids lie there, and a quotient such as
# sin(t - 1)/(t - 1), which has no value at one of them, is allowed; infinite ones are not.
_PRIME_PARTS: Final = 97
_PARTS: Final = 720
STEEPEST: Final = -0.999
"""A force that begins with a power below this one has an infinite integral."""
_NO_TIME: Final[dict[str, Any]] = {"final_time": INVALID}  # as if none could be read
_OTHER_NAMES: Final = {
    "initial_position": ("initial", "position"),
    "initial_velocity": ("initial", "velocity"),
}


def problem_keys(problem: Mapping[str, Any], built: object = None) -> Kind:
    """The keys of a problem; for an unknown kind those of a damped oscillator."""
    found = PROBLEM.build(problem) if built is None else built
    if isinstance(found, Kind):
        return found
    return DampedOscillator.of(_NO_TIME | dict(problem)).replaced(kind=INVALID)


def _force_key(problem: Kind) -> str:
    """The key under which the force of a problem stands: the first name that is not its default."""
    forces = problem.forces
    given = [name for name in forces[1:] if getattr(problem, name, "0") != "0"]
    return given[0] if given and getattr(problem, forces[0], "0") == "0" else forces[0]


def _force(problem: Kind) -> Any:
    return getattr(problem, _force_key(problem), None)


def _pieces(force: object) -> list[tuple[Any, Any]]:
    """End and value of each piece of a force, INVALID where they could not be read."""
    pieces = force.get("pieces") if isinstance(force, Mapping) else None
    return [
        (piece.get("until"), piece.get("value")) if isinstance(piece, Mapping) else (INVALID,) * 2
        for piece in (pieces if isinstance(pieces, list | tuple) else ())
    ]


def make_problem(problem: Kind, at: Cursor, *, search: bool = True) -> AnyProblem | None:
    """The problem that keys describe; None when something is wrong.

    `problem` may hold INVALID and stands at `at`, which receives what is wrong between the keys.
    Looking for the exact solution (`search`) takes long and finds no mistake.
    """
    before = len(at.complaints)
    _check_sizes(problem, at)
    _check_pieces(problem, at)
    _check_values(problem, at)
    if not is_complete(problem) or len(at.complaints) > before:
        return None
    try:
        return problem.build_problem(search=search)
    except ArgumentError as error:
        first, *rest = error.path or ("",)
        path: KeyPath = (*_OTHER_NAMES.get(first, (first,)), *rest)
        if hasattr(problem, str(path[0])):
            at.refuse(error.message, *path)
        else:
            at.refuse(str(error))
    except ValueError as error:
        at.refuse(str(error))
    return None


def _check_sizes(problem: Kind, at: Cursor) -> None:
    """Everything that is given per coordinate must have the same number of coordinates."""
    stated = problem.stated_size()
    sized = [] if stated is None else [stated]
    for path, value in _sized(problem):
        if type(value) in PLAIN:
            continue
        size = len(value) if isinstance(value, list | tuple) else matrix_size(value)
        if size is not None:
            sized.append((path, size))
    for path, size in sized[1:]:
        if size != sized[0][1]:
            first = ".".join(map(str, sized[0][0])) or f"kind {problem.kind}"
            words = f"is for {_coordinates(size)}, but {first} for {sized[0][1]}"
            many = "as many in both" if sized[0][0] else sized[0][1]
            at.refuse(f"{words}; give {many}", *path)


def _sized(problem: Kind) -> Iterator[tuple[KeyPath, object]]:
    """What may be given per coordinate."""
    for name in ("mass", "stiffness", "masses", "stiffnesses"):
        yield (name,), getattr(problem, name, None)
    initial = getattr(problem, "initial", None)
    if isinstance(initial, Initial):
        yield from ((("initial", name), value) for name, value in vars(initial).items())
    for name in ("forcing", "exact"):
        yield (name,), getattr(problem, name, None)
    damping = getattr(problem, "damping", None)
    for index, term in enumerate(damping if isinstance(damping, tuple) else ()):
        given = vars(term) if isinstance(term, Setting) else term
        if isinstance(given, Mapping) and given.get("acts_on") is None:
            for name in ("coefficient", "matrix", "stiffness"):
                yield ("damping", index, name), given.get(name)
    for index, (_, value) in enumerate(_pieces(_force(problem))):
        yield (_force_key(problem), "pieces", index, "value"), value


def _coordinates(size: int) -> str:
    return f"{size} coordinate" if size == 1 else f"{size} coordinates"


def _check_pieces(problem: Kind, at: Cursor) -> None:
    """Every piece but the last has an end; the ends increase and lie inside of (0, T)."""
    pieces, final_time = _pieces(_force(problem)), problem.final_time
    earlier = 0.0
    for index, (until, _) in enumerate(pieces):
        is_last = index == len(pieces) - 1
        wrong = ""
        if until is INVALID or (until is None and is_last):
            continue
        if until is None:
            wrong = "missing; only the last piece has no end"
        elif is_last:
            wrong = "not allowed in the last piece, which holds until the end"
        elif not until > earlier:
            wrong = f"{until:g} is not after {earlier:g}; ends must increase"
        elif isinstance(final_time, float) and not until < final_time:
            wrong = f"{until:g} is not before final_time = {final_time:g}; later pieces never act"
        if wrong:
            at.refuse(wrong, _force_key(problem), "pieces", index, "until")
        earlier = earlier if until is None else max(earlier, until)


def _check_values(problem: Kind, at: Cursor) -> None:
    """Expressions must be finite: forces inside of the interval, known functions at 0 as well."""
    final_time: Any = problem.final_time
    if not isinstance(final_time, float) or not is_complete(getattr(problem, "parameters", None)):
        return
    values = with_parameters(vars(problem))
    for name in ("exact", "function"):
        _try(values.get(name), at, (name,), (0.0, final_time), is_force=False)
    force, begin = _force_key(problem), 0.0
    given = values.get(force)
    if not isinstance(given, Mapping):
        _try(given, at, (force,), (0.0, final_time))
    elif isinstance(given.get("at"), Mapping):
        for name, value in given["at"].items():
            _try(value, at, (force, "at", name), (0.0, final_time))
    for index, (until, value) in enumerate(_pieces(given)):
        end = final_time if until is None else until
        if not isinstance(end, float) or not begin < end <= final_time:
            return
        _try(value, at, (force, "pieces", index, "value"), (begin, end))
        begin = end


def _try(
    value: object,
    at: Cursor,
    key: KeyPath,
    interval: tuple[float, float],
    *,
    is_force: bool = True,
) -> None:
    """Complain of every expression that has no use on an interval."""
    for index, entry in enumerate(value) if isinstance(value, list | tuple) else ():
        _try(entry, at, (*key, index), interval, is_force=is_force)
    if isinstance(value, str) and value not in ("auto", "none"):
        wrong = _objection(value, *interval, is_force=is_force)
        if wrong:
            at.refuse(wrong, *key)


@functools.lru_cache(maxsize=1024)
def _objection(text: str, begin: float, end: float, *, is_force: bool) -> str:
    """What is wrong with an expression on an interval; empty if it is finite where it must be.

    A force must be finite inside, but for quotients that have no value at single times, and
    integrable; a known solution or function must be finite at both ends too.
    """
    inside = _instants(begin, end, _PRIME_PARTS)
    if is_force:
        inside = inside[:-1]
    times = np.concatenate([inside, _instants(begin, end, _PARTS)] if is_force else [[0.0], inside])
    try:
        expression = Expression.parse(text, variables=("t",))
        found = np.asarray(expression.evaluate({"t": times}))
    except ExpressionError as error:
        return str(error)
    values = np.broadcast_to(found, times.shape)
    may_be_undefined = is_force & (np.arange(times.size) >= inside.size)
    wrong = np.flatnonzero(np.isinf(values) | (np.isnan(values) & ~may_be_undefined))
    if wrong.size:
        what = "not a real number" if math.isnan(values[wrong[0]]) else "infinite"
        return f"is {what} at t = {times[wrong[0]]:.6g}; it must be finite up to final_time"
    return _limited_impulse(expression, begin, end) if is_force else ""


def _instants(begin: float, end: float, count: int) -> Array:
    """Ends of `count` equal parts of an interval."""
    return begin + (end - begin) * np.arange(1, count + 1) / count


def _limited_impulse(expression: Expression, begin: float, end: float) -> str:
    """A complaint if the integral of a force is infinite at the beginning of its piece, or ""."""
    if np.isfinite(expression.evaluate({"t": np.array([begin])})).all():
        return ""
    steps = (end - begin) * np.array([1e-9, 2e-9, 4e-9, 8e-9])
    with np.errstate(all="ignore"):
        sizes = np.abs(np.broadcast_to(expression.evaluate({"t": begin + steps}), 4))
        power = float(np.log2(sizes[1:] / sizes[:-1]).max())
    if not power < STEEPEST:
        return ""
    behind = "t" if begin == 0 else f"(t - {begin:g})"
    return (
        f"grows like {behind}**{power:.3g} behind t = {begin:g}, so that its integral is "
        "infinite; powers above -1 are allowed"
    )
