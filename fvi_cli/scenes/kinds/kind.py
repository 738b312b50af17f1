"""Base classes of kinds of problems: shared keys, their checks, and the scene."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.meshes.graded import LEAST_POWER, force_power
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes import exact_check, trials
from fvi_cli.scenes.data import SceneData, per_coordinate
from fvi_cli.scenes.forces import (
    FORCING,
    PARAMETERS,
    Forces,
    Parameters,
    Pieces,
    build_forcing,
    by_coordinate,
    expressions,
    formulas_of,
    with_numbers,
)
from fvi_cli.scenes.keys.values import (
    BY_FORM,
    FormulaOrMany,
    KeyPath,
    Keys,
    Positive,
    Wrong,
    key,
    unknown_names,
)
from fvi_cli.scenes.kinds.laws import Term, build_damping, check_names_of_dampers
from fvi_cli.scenes.lagrangian import check_names, names_of_dampers
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.scenes.structures.matrix_keys import is_sparse_file, matrix_size

FINAL_TIME: Final = key("End T of the interval [0, T].", unit="time")


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
    title: ClassVar[str] = ""
    """The title in figures; default: the word of the kind with blanks for hyphens."""
    forces: ClassVar[tuple[str, ...]] = ("forcing",)
    """Keys of forces or of the motion of the ground; at most one of them may be given."""
    solutions: ClassVar[tuple[str, ...]] = ("exact",)
    """Keys of further functions of t."""

    parameters: Parameters = PARAMETERS

    def mistakes(self) -> Iterator[Wrong]:
        """Unknown names in formulas, formulas that are not finite, pieces behind the end."""
        final_time = getattr(self, "final_time", None)
        names = {"t": 0.0, **self.parameters}
        for name in (*self.forces, *self.solutions):
            given, is_force = getattr(self, name), name in self.forces
            if given in ("auto", "none"):
                continue
            for path, formula, begin, end in formulas_of(given, (name,), final_time or 1.0):
                unknown = list(unknown_names(path, formula, names))
                yield from unknown
                if unknown or final_time is None or not begin < end:
                    continue
                text = with_numbers(formula, self.parameters)
                if words := trials.objection(text, begin, end, is_force=is_force):
                    yield Wrong(path, words)
            if isinstance(given, Pieces) and final_time is not None:
                for number, piece in enumerate(given.pieces):
                    if piece.until is not None and piece.until >= final_time:
                        words = f"{piece.until:g} is not before final_time = {final_time:g}"
                        yield Wrong((name, "pieces", number, "until"), words)

    def build_scene(self) -> Scene:
        """The scene."""
        raise ArgumentError("kind", f"{self.kind!r} is not the name of a scene")

    @abstractmethod
    def build_problem(self) -> AnyProblem:
        """The problem."""


class SceneKind(Kind):
    """A kind of scene, with own keys and the keys that all scenes share."""

    make: ClassVar[Callable[..., Scene]]
    """The function that makes the scene from own keys and :class:`SceneData`."""
    size: ClassVar[int | None] = None
    """Number of coordinates if it is fixed."""
    size_key: ClassVar[str] = ""
    """The key with the number of coordinates; empty: it follows from the longest entry."""
    names: ClassVar[tuple[str, ...]] = ()
    """Names of the coordinates; empty: ``x``, or ``x1``, ``x2``, ..."""

    damping: list[Term] = key(
        "Terms mu D^gamma q of the equation of motion, and relaxation laws; none: no damping.", []
    )
    derivative: Literal["caputo", "riemann-liouville"] = key(
        "caputo: D acts on q - q(0) (orders above 1: also - q'(0) t).", "caputo"
    )
    initial: Initial = key("Position and velocity at t = 0.", Initial())
    final_time: Positive = FINAL_TIME
    exact: FormulaOrMany = key(
        "Exact position: expression in t, one per coordinate, or auto: errors are measured against "
        "a reference run; none: no reference and no errors.",
        "auto",
    )

    def mistakes(self) -> Iterator[Wrong]:
        """Entries for different numbers of coordinates too."""
        yield from super().mistakes()
        stated = self.stated_size()
        sized = [] if stated is None else [stated]
        sized += [(path, size) for path, value in self._sized() if (size := matrix_size(value))]
        for path, size in sized[1:]:
            first, expected = ".".join(map(str, sized[0][0])), sized[0][1]
            if size != expected:
                whose = first or f"kind {self.kind}"
                words = f"is for {_coordinates(size)}, but {whose} for {expected}"
                yield Wrong(path, f"{words}; give {'as many in both' if first else expected}")

    def _sized(self) -> Iterator[tuple[KeyPath, object]]:
        """What may be given per coordinate."""
        # not getattr: what a model does not have takes it long
        own = vars(self)
        for name in ("mass", "stiffness", "masses", "stiffnesses", "forcing", "exact"):
            yield (name,), own.get(name)
        for name, value in vars(self.initial).items():
            yield ("initial", name), value
        for index, term in enumerate(self.damping):
            if term.acts_on is None:
                for name in ("coefficient", "matrix", "stiffness"):
                    yield ("damping", index, name), vars(term).get(name)
        for name in self.forces:
            force = getattr(self, name)
            for index, piece in enumerate(force.pieces if isinstance(force, Pieces) else ()):
                yield (name, "pieces", index, "value"), piece.value

    def stated_size(self) -> tuple[KeyPath, int] | None:
        """Path and value of the key that gives the number of coordinates; None: no key does."""
        path: KeyPath = (self.size_key,) if self.size_key else ()
        if self.size is not None:
            return path, self.size
        stated = getattr(self, self.size_key, None) if self.size_key else None
        if isinstance(stated, list):
            return path, len(stated)
        return (path, stated) if isinstance(stated, int) else None

    def own_names(self) -> tuple[str, ...]:
        """Names of the coordinates; empty: they are numbered."""
        return self.names

    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the coordinates, as in ``acts_on``."""
        if named := self.own_names():
            return named
        stated = self.stated_size()
        if stated is not None:
            return numbered(stated[1])
        entries = [self.initial.position, *self._matrices()]
        entries += [term.factor for term in self.damping if term.acts_on is None]
        return numbered(max(matrix_size(one) or 1 for one in entries))

    def _matrices(self) -> tuple[object, object]:
        return vars(self).get("mass"), vars(self).get("stiffness")

    def build_scene(self) -> Scene:
        """The scene."""
        names, forces = self.coordinate_names(), self.forces
        if self.parameters:
            check_names(names, self.parameters)
        sparse = any(map(is_sparse_file, self._matrices()))
        damping, laws = build_damping(self.damping, names, sparse=sparse)
        data: SceneData = {
            "final_time": self.final_time,
            "damping": damping,
            "laws": laws,
            "initial_position": _vector(self.initial.position, names, "initial.position"),
            "initial_velocity": _vector(self.initial.velocity, names, "initial.velocity"),
            "derivative": self.derivative,
        }
        drivers = {name: self._driver(name, names) for name in forces}
        if sum(driver is not None for driver in drivers.values()) > 1:
            raise ArgumentError(forces[1], f"give this or {forces[0]}, not both", at_key=True)
        try:
            scene = self.make_scene(**data, **drivers)
        except ArgumentError as error:
            key = re.sub("^initial_(position|velocity)", r"initial.\1", error.key)
            raise ArgumentError(key, error.message, at_key=error.at_key) from None
        check_names_of_dampers((*scene.damping, *scene.laws), "damping")
        if self.parameters:
            ready = dict.fromkeys(self.ready_quantities(), "a ready quantity")
            inputs = dict.fromkeys({*forces} - {"forcing"}, "what drives the motion")
            check_names(names, self.parameters, {**inputs, **names_of_dampers(scene), **ready})
        return scene

    def make_scene(self, **data: Any) -> Scene:
        """The scene from its own keys and the shared arguments `data`."""
        shared = {*SceneKind.model_fields, *self.forces}
        own = {name: one for name, one in self if name not in shared}
        return type(self).make(**own, **data)

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
            if reason := exact_check.objection(exact, scene):
                raise ArgumentError("exact", reason)
        ground = [name for name in self.forces if name != "forcing"]
        return Problem(
            kind=self.kind,
            scene=scene,
            exact=exact,
            exact_source=source,
            equation=_with_laws(self.equation, scene),
            coordinates=self.own_names() or numbered(scene.dimension),
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


class Forced(SceneKind):
    """A kind of scene with a force."""

    forcing: Forces = FORCING


def numbered(size: int) -> tuple[str, ...]:
    """``x``, or ``x1``, ``x2``, ..."""
    return ("x",) if size == 1 else tuple(f"x{index}" for index in range(1, size + 1))


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
    return per_coordinate(np.asarray(value, dtype=float), len(names))


def _coordinates(size: int) -> str:
    return f"{size} coordinate" if size == 1 else f"{size} coordinates"
