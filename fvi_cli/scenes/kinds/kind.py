"""Base classes of kinds of problems: shared keys, their checks, and the scene."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.matrices import is_sparse
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.meshes.graded import LEAST_POWER, force_power
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.data import per_coordinate
from fvi_cli.scenes.forces import (
    FORCING,
    PARAMETERS,
    Forces,
    Parameters,
    build_forcing,
    by_coordinate,
    expressions,
    formulas_of,
    objection,
)
from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.scenes.keys.values import (
    BY_FORM,
    FormulaOrMany,
    Increasing,
    Keys,
    Positive,
    key,
    unknown_names,
)
from fvi_cli.scenes.kinds.laws import (
    Term,
    check_names_of_dampers,
    effects_of,
    on_coordinates,
)
from fvi_cli.scenes.lagrangian import check_names, names_of_dampers
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.scenes.records.matrices import MatrixFile, rows_of

FINAL_TIME: Final = key("End T of the interval [0, T].", unit="time")
START_TOLERANCE: Final = 1e-6
"""Error that an exact solution may have at 0, relative to its largest value and to the start."""


class NumbersAt(Keys):
    """Numbers of some coordinates."""

    at: dict[str, float] = key("Values of some coordinates, by their names; the others are 0.")


Numbers = Annotated[float | list[float] | NumbersAt, BY_FORM]


class Initial(Keys):
    """Position and velocity at t = 0."""

    position: Numbers = key(
        "q(0), a number, one per coordinate, or {at: {x3: ...}} for some.", 0.0, unit="length"
    )
    velocity: Numbers = key(
        "q'(0), a number, one per coordinate, or {at: {x3: ...}} for some.",
        0.0,
        unit="length per time",
    )


class Kind(Keys):
    """A kind of problem: its fields are its keys."""

    kind: str
    equation: ClassVar[str]
    """The equation in plain text."""
    forces: ClassVar[tuple[str, ...]] = ("forcing",)
    """Keys of forces or of the motion of the ground."""
    solutions: ClassVar[tuple[str, ...]] = ("exact",)
    """Keys of further functions of t."""

    parameters: Parameters = PARAMETERS

    def mistakes(self) -> Iterator[Wrong]:
        """Unknown names in formulas, and formulas that are not finite."""
        check_names((), self.parameters)
        final_time = getattr(self, "final_time", None) or 0.0
        names = {"t": 0.0, **self.parameters}
        for name in (*self.forces, *self.solutions):
            given = getattr(self, name)
            if given in ("auto", "none"):
                continue
            for path, formula, begin, end in formulas_of(given, (name,), final_time):
                if unknown := list(unknown_names(path, formula, names)):
                    yield from unknown
                elif begin < end:
                    is_force = name in self.forces
                    numbers = tuple(sorted(self.parameters.items()))
                    if words := objection(formula, numbers, begin, end, is_force=is_force):
                        yield Wrong(path, words)

    @abstractmethod
    def build_problem(self) -> AnyProblem:
        """The problem."""


class SceneKind(Kind):
    """A kind of scene, with own keys and the keys that all scenes share."""

    make: ClassVar[Callable[..., Scene]]
    """The function that makes the scene from own keys and :class:`SceneData`."""
    names: ClassVar[tuple[str, ...]] = ()
    """Names of the coordinates; empty: ``x``, or ``x1``, ``x2``, ..."""
    dampers_key: ClassVar[str] = ""
    """The key of dampers between parts."""

    damping: list[Term] = key(
        "Terms mu D^gamma q of the equation of motion, and relaxation laws; none: no damping.", []
    )
    derivative: Literal["caputo", "riemann-liouville"] = key(
        "caputo: D acts on q - q(0) (orders above 1: also - q'(0) t).", "caputo"
    )
    forcing: Forces = FORCING
    initial: Initial = key("Position and velocity at t = 0.", Initial())
    final_time: Positive = FINAL_TIME
    break_points: Increasing[Positive] | None = key(
        "Times at which the force is not smooth, beside ends of pieces; points of the mesh.",
        None,
        unit="time",
    )
    exact: FormulaOrMany = key(
        "Exact position: expression in t, one per coordinate, or auto: errors are measured against "
        "a reference run; none: no reference and no errors.",
        "auto",
    )

    def count(self) -> int:
        """Number of coordinates."""
        given = [self.initial.position, self.initial.velocity, *self._matrices()]
        given += [one.factor for one in self.damping if one.acts_on is None]
        return max(map(rows_of, given))

    def _matrices(self) -> tuple[object, object]:
        # not getattr: what a model does not have takes it long
        return vars(self).get("mass"), vars(self).get("stiffness")

    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the coordinates, as in ``acts_on``."""
        return self.names or numbered(self.count())

    def build_scene(self) -> Scene:
        """The scene."""
        names = self.coordinate_names()
        files = [one for one in self._matrices() if isinstance(one, MatrixFile)]
        sparse = any(is_sparse(one.form) for one in files)
        effects = effects_of(self.damping, on_coordinates(names, sparse=sparse))
        data: dict[str, Any] = {
            "final_time": self.final_time,
            "damping": effects,
            "initial_position": _vector(self.initial.position, names, "initial.position"),
            "initial_velocity": _vector(self.initial.velocity, names, "initial.velocity"),
            "derivative": self.derivative,
        }
        data |= {name: self._driver(name, names) for name in self.forces}
        try:
            scene = self.make_scene(**data)
        except ArgumentError as error:
            key = re.sub("^initial_(position|velocity)", r"initial.\1", error.key)
            raise ArgumentError(key, error.message, at_key=error.at_key) from None
        if self.break_points:
            force = scene.forcing or Forcing.from_text(*("0",) * scene.dimension)
            scene = replace(scene, forcing=force.cut(self.break_points))
        check_names_of_dampers((*scene.damping, *scene.laws), "damping")
        if self.parameters:
            taken = dict.fromkeys(self.ready_quantities(), "a ready quantity")
            taken |= dict.fromkeys({*self.forces} - {"forcing"}, "what drives the motion")
            check_names(names, self.parameters, taken | names_of_dampers(scene))
        return scene

    def make_scene(self, **data: Any) -> Scene:
        """The scene from its own keys and the shared arguments `data`."""
        return type(self).make(**self.own(), **data)

    def own(self) -> dict[str, Any]:
        """The values of its own keys, with effects for dampers."""
        shared = {*SceneKind.model_fields, *self.forces}
        found = {name: one for name, one in self if name not in shared}
        if name := self.dampers_key:
            before = len(self.damping)
            on = on_coordinates(self.coordinate_names(), between=True)
            found[name] = effects_of(found[name], on, name, before=before)
        return found

    def _driver(self, name: str, names: tuple[str, ...]) -> Forcing | None:
        return build_forcing(
            getattr(self, name),
            len(names) if name == "forcing" else 1,
            name,
            final_time=self.final_time,
            names=names,
            parameters=self.parameters,
        )

    def build_problem(self) -> Problem:
        """The scene with its exact solution if that is known."""
        scene = self.build_scene()
        power = force_power(scene, at_start=True)
        if power is not None and power < LEAST_POWER:
            reason = f"begins like t**{power:g}; steps take powers from {LEAST_POWER} on"
            raise ArgumentError("forcing", reason)
        exact: Callable[[Array], Array] | None = None
        source = "unknown"
        if self.exact == "none":
            source = "none"
        elif self.exact != "auto":
            components = expressions(self.exact, scene.dimension, "exact", self.parameters)
            exact, source = ForcingPiece(components=components).evaluate, "expression"
            _check_start(exact, scene)
        ground = [name for name in self.forces if name != "forcing"]
        return Problem(
            kind=self.kind,
            scene=scene,
            exact=exact,
            exact_source=source,
            equation=_with_laws(self.equation, scene),
            coordinates=self.coordinate_names(),
            inputs={name: self._driver(name, ()) for name in ground},
            numbers=self.numbers(),
            ready=self.ready_quantities(),
        )

    def numbers(self) -> Mapping[str, float]:
        """Numbers by their names in expressions along a motion."""
        return self.parameters

    def ready_quantities(self) -> Mapping[str, Expression]:
        """Formulas of built-in quantities by name."""
        return {}


def numbered(size: int) -> tuple[str, ...]:
    """``x``, or ``x1``, ``x2``, ..."""
    return ("x",) if size == 1 else tuple(f"x{index}" for index in range(1, size + 1))


def _check_start(exact: Callable[[Array], Array], scene: Scene) -> None:
    """Refuse an exact solution that does not begin at the initial position."""
    start, values = scene.initial_position, exact(np.linspace(0.0, scene.final_time, 257))
    if np.abs(values[0] - start).max() > START_TOLERANCE * np.abs([*values, start]).max():
        at, begin = values[0].round(6).tolist(), start.round(6).tolist()
        raise ArgumentError("exact", f"is {at} at t = 0, but initial.position is {begin}")


def _with_laws(equation: str, scene: Scene) -> str:
    """The equation of a scene, with moduli G if its damping has relaxation laws."""
    if not scene.laws or "G(D)" in equation:
        return equation
    both = r"sum mu D^gamma \1 + sum G(D) \1" if scene.damping else r"sum G(D) \1"
    return re.sub(r"sum mu D\^gamma (\w+)", both, equation)


def _vector(value: object, names: tuple[str, ...], place: str) -> Array:
    """A vector ``(d,)`` from one number, a list, or numbers of some coordinates (others are 0)."""
    if isinstance(value, NumbersAt):
        given = by_coordinate(value.at, names, f"{place}.at")
        return np.array([given.get(name, 0.0) for name in names])
    return per_coordinate(np.asarray(value), len(names), place)
