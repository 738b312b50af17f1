"""Requested outputs of a motion, as a value that is given before anything is computed."""

from __future__ import annotations

import keyword
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import FUNCTION_NAMES, Expression

T = TypeVar("T", "Event", "Impact")
Direction = Literal["any", "rising", "falling"]

DIRECTIONS: tuple[str, ...] = get_args(Direction)
PREFIXES = ("", "v", "a", "d")
"""Prefixes of a coordinate's name: for position, velocity, acceleration, damping force."""


def coordinate_names(dimension: int) -> tuple[str, ...]:
    """Names of d coordinates that have none: ``x``, or ``x1``, ``x2``, ..."""
    return ("x",) if dimension == 1 else tuple(f"x{k}" for k in range(1, dimension + 1))


def names_of(scene: Scene) -> tuple[str, ...]:
    """Names of the coordinates of a scene: those that it was made with, or ``x1``, ``x2``, ..."""
    own = scene.coordinates
    if not own and scene.lagrangian is not None:
        own = scene.lagrangian.coordinates
    return own or coordinate_names(scene.dimension)


def known_names(coordinates: Sequence[str], parameters: Collection[str] = ()) -> tuple[str, ...]:
    """The variables of an expression: t, parameters, and every coordinate with every prefix.

    A coordinate or parameter has priority over a name derived from another coordinate.
    """
    # a derived name may be taken, such as the Python keyword "as", for a coordinate s
    derived = (
        name
        for name in _derived(coordinates)
        if not (name in FUNCTION_NAMES or name == "pi" or keyword.iskeyword(name))
    )
    return tuple(dict.fromkeys(("t", *coordinates, *parameters, *derived)))


def _derived(coordinates: Sequence[str]) -> dict[str, tuple[str, int]]:
    """Prefix and number of the coordinate of every name; coordinates have priority."""
    found: dict[str, tuple[str, int]] = {}
    for prefix in PREFIXES:
        for index, name in enumerate(coordinates):
            found.setdefault(prefix + name, (prefix, index))
    return found


@dataclass(frozen=True, kw_only=True)
class Event:
    """The times at which an expression changes its sign.

    Raises
    ------
    ValueError
        For another direction.
    """

    when: Expression
    # rising from below to above 0, falling, or any of the two. A value that touches 0 and turns
    # back does not count, nor does one that begins or ends with 0
    direction: Direction = "any"
    stop: bool = False  # whether the run ends at the first of these times

    def __post_init__(self) -> None:
        if self.direction not in DIRECTIONS:
            raise ValueError(f"direction: {self.direction!r} is not one of {', '.join(DIRECTIONS)}")


@dataclass(frozen=True, kw_only=True)
class Impact:
    """A surface on which the motion bounces.

    Raises
    ------
    ValueError
        For a restitution out of range.
    """

    # g(q, t): the motion is where it is positive, and meets the surface at its falling roots
    when: Expression
    restitution: float = 1.0  # e from 0 to 1: the normal velocity is reversed and multiplied by it

    def __post_init__(self) -> None:
        if not 0.0 <= self.restitution <= 1.0:
            raise ValueError(f"restitution: {self.restitution!r} is not allowed; it must be 0 to 1")


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations:
    """Requested outputs of a motion; by default none.

    Raises
    ------
    ValueError
        For times that do not increase from 0 or later.
    """

    coordinates: tuple[str, ...] = ()  # names of the d coordinates
    # times at which the motion is reported, shape (n,); None: the points of the mesh
    times: Array | None = None
    quantities: Mapping[str, Expression] = field(default_factory=dict)  # by name
    events: Mapping[str, Event] = field(default_factory=dict)
    impacts: Mapping[str, Impact] = field(default_factory=dict)  # they change the motion itself
    # values of further names in their expressions
    parameters: Mapping[str, float] = field(default_factory=dict)
    # further names that expressions may contain, as formulas in the other names
    ready: Mapping[str, Expression] = field(default_factory=dict)
    # functions of the time by their names in expressions; None: zero
    inputs: Mapping[str, Forcing | None] = field(default_factory=dict)
    # the times in the short form of a configuration; None: as a list
    output: Mapping[str, object] | None = None

    def __post_init__(self) -> None:
        if self.times is None:
            return
        times = np.array(self.times, dtype=float)
        if times.ndim != 1 or times.size == 0 or not np.isfinite(times).all():
            raise ValueError("output: a list of times is needed, at least one, all finite")
        if times[0] < 0 or not (np.diff(times) > 0).all():
            raise ValueError("output: times must increase, and begin at 0 or later")
        times.setflags(write=False)
        object.__setattr__(self, "times", times)

    @property
    def derived(self) -> dict[str, tuple[str, int]]:
        """Names that a motion gives, with their prefix and the number of the coordinate."""
        every = _derived(self.coordinates)
        return {name: one for name, one in every.items() if name not in self.parameters}

    @property
    def is_empty(self) -> bool:
        """Whether no outputs are requested."""
        return self.times is None and not (self.quantities or self.events or self.impacts)

    def specification(self) -> dict[str, object]:
        """The parts that determine numbers, as JSON values; empty without a request."""
        output: object = None
        if self.times is not None:
            output = self.times.tolist() if self.output is None else dict(self.output)
        found = {
            "output": output,
            "quantities": {name: one.text for name, one in self.quantities.items()},
            "events": {
                name: {"when": one.when.text, "direction": one.direction, "stop": one.stop}
                for name, one in self.events.items()
            },
            "impacts": {
                name: {"when": one.when.text, "restitution": one.restitution}
                for name, one in self.impacts.items()
            },
        }
        return {name: one for name, one in found.items() if one}


def observations(
    coordinates: Sequence[str],
    *,
    output: ArrayLike | None = None,
    quantities: Mapping[str, str | float] | None = None,
    events: Mapping[str, str | Mapping[str, object]] | None = None,
    impacts: Mapping[str, Mapping[str, object]] | None = None,
    parameters: Mapping[str, float] | None = None,
    further: Sequence[str] = (),
) -> Observations:
    """Requested outputs of a motion, from texts.

    Quantities are expressions by name; events an expression, or ``{"when": ..., "direction": ...,
    "stop": ...}``; impacts ``{"when": ..., "restitution": ...}``. `output` are times, None: the
    points of the mesh; `further` names have a value in the motion itself, such as the work on every
    damper.

    Raises
    ------
    ValueError
        ``quantities.<name>: what is wrong``.
    """
    known = known_names(coordinates, tuple(parameters or ()))
    every = tuple(dict.fromkeys((*known, *further)))
    # a surface is an expression in coordinates and t
    positions = tuple(dict.fromkeys(("t", *coordinates, *(parameters or ()))))

    def read(text: Any, place: str, names: tuple[str, ...] = every) -> Expression:
        try:
            return Expression.parse(text, variables=names)
        except ValueError as error:
            raise ValueError(f"{place}: {error}") from None

    def change(kind: type[T], given: Any, place: str, names: tuple[str, ...] = every) -> T:
        keys = {"when": given} if isinstance(given, str) else given
        when = read(keys["when"], f"{place}.when", names)
        try:
            return kind(**{**keys, "when": when})
        except ValueError as error:
            raise ValueError(f"{place}.{error}") from None

    surfaces = (impacts or {}).items()
    return Observations(
        impacts={k: change(Impact, one, f"impacts.{k}", positions) for k, one in surfaces},
        coordinates=tuple(coordinates),
        times=None if output is None else np.asarray(output, dtype=float),
        quantities={k: read(one, f"quantities.{k}") for k, one in (quantities or {}).items()},
        events={k: change(Event, one, f"events.{k}") for k, one in (events or {}).items()},
        parameters=dict(parameters or {}),
    )


def check_observable(method: AnyMethod) -> None:
    """Refuse methods whose steps are no polynomials.

    Raises
    ------
    ValueError
        With a method to take instead.
    """
    if not isinstance(method, Method) or not method.is_runge_kutta:
        raise ValueError(
            f"{method.label} keeps no polynomials of its steps; "
            "output, quantities and events need a Runge-Kutta method, such as rk: gauss"
        )
