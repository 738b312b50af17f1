"""Base classes of kinds of problems: shared keys, their checks, and the scene."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.meshes.graded import force_power
from fvi_cli.integrator.observe.request import coordinate_names
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.forces import Forces, build_forcing, expressions, for_each, formulas_of
from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.scenes.keys.values import (
    BY_FORM,
    FormulaOrMany,
    Increasing,
    Keys,
    Name,
    Positive,
    key,
    wrong_formula,
)
from fvi_cli.scenes.kinds.laws import Term, check_names_of_dampers, effects_of
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.scenes.records.inputs import FromFile
from fvi_cli.scenes.records.matrices import rows_of

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

    parameters: dict[Name, float] = key(
        "Values of names that the expressions of the problem may hold, and those of quantities, "
        "events and impacts; problem.parameters.<name> can be swept.",
        {},
    )

    def mistakes(self) -> Iterator[Wrong]:
        """Unknown names in formulas."""
        names = dict.fromkeys(("t", *self.parameters))
        for name in (*self.forces, *self.solutions):
            for path, formula in formulas_of(getattr(self, name), (name,)):
                if formula not in ("auto", "none"):
                    yield from wrong_formula(path, formula, names)

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
    forcing: Forces = key(
        "Force f(t): number or expression in t, one per coordinate, {pieces: [...]}, {at: {x3: "
        "...}} for some coordinates, or samples, {file: force.csv, column: f}.",
        "0",
        unit="mass length per time^2",
    )
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
        given: list[object] = [self.initial.position, self.initial.velocity]
        # not getattr: what a model does not have takes it long
        given += [vars(self).get("mass"), vars(self).get("stiffness")]
        given += [one.factor for one in self.damping if one.acts_on is None]
        return max(map(rows_of, given))

    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the coordinates, as in ``acts_on``."""
        return self.names or coordinate_names(self.count())

    def build_scene(self) -> Scene:
        """The scene."""
        names = self.coordinate_names()
        scene = type(self).make(
            **self.own(),
            final_time=self.final_time,
            damping=effects_of(self.damping, names),
            initial_position=self._start("position"),
            initial_velocity=self._start("velocity"),
            derivative=self.derivative,
            **{name: self._force(name) for name in self.forces},
        )
        if self.break_points:
            force = scene.forcing or Forcing.from_text(*("0",) * scene.dimension)
            scene = replace(scene, forcing=force.cut(self.break_points))
        check_names_of_dampers((*scene.damping, *scene.laws), "damping")
        return scene

    def own(self) -> dict[str, Any]:
        """The values of its own keys, with what files hold, and effects for dampers."""
        shared = {*SceneKind.model_fields, *self.forces}
        given = {name: one for name, one in self if name not in shared}
        found = {k: one.value if isinstance(one, FromFile) else one for k, one in given.items()}
        if name := self.dampers_key:
            names, before = self.coordinate_names(), len(self.damping)
            found[name] = effects_of(found[name], names, name, before=before)
        return found

    def _force(self, name: str) -> Forcing | None:
        names = self.coordinate_names() if name == "forcing" else ("",)
        return build_forcing(getattr(self, name), names, name, self.final_time, self.parameters)

    def _start(self, name: str) -> Array:
        given = getattr(self.initial, name)
        names, place = self.coordinate_names(), f"initial.{name}"
        return np.array(for_each(given, names, place, lambda one, _: float(one)))

    def build_problem(self) -> Problem:
        """The scene with its exact solution if that is known."""
        scene, names = self.build_scene(), self.coordinate_names()
        force_power(scene, at_start=True)  # refuses forces that have no integral
        exact: Callable[[Array], Array] | None = None
        source = {"auto": "unknown", "none": "none"}.get(str(self.exact), "expression")
        if source == "expression":
            components = expressions(self.exact, names, "exact", self.parameters)
            exact = ForcingPiece(components=components).evaluate
            _check_start(exact, scene)
        problem = Problem(
            kind=self.kind,
            scene=scene,
            exact=exact,
            exact_source=source,
            equation=self.equation,
            coordinates=names,
            inputs={name: self._force(name) for name in self.forces if name != "forcing"},
            numbers=self.numbers(),
            ready=self.ready_quantities(),
        )
        return problem.with_parameters(self.parameters)

    def numbers(self) -> Mapping[str, float]:
        """Numbers of the kind by their names in expressions along a motion."""
        return {}

    def ready_quantities(self) -> Mapping[str, Expression]:
        """Formulas of built-in quantities by name."""
        return {}


def _check_start(exact: Callable[[Array], Array], scene: Scene) -> None:
    """Refuse an exact solution that does not begin at the initial position."""
    start, values = scene.initial_position, exact(np.linspace(0.0, scene.final_time, 257))
    if np.abs(values[0] - start).max() > START_TOLERANCE * np.abs([*values, start]).max():
        at, begin = values[0].round(6).tolist(), start.round(6).tolist()
        raise ArgumentError("exact", f"is {at} at t = 0, but initial.position is {begin}")
