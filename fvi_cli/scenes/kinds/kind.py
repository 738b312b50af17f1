"""Base classes of kinds of problems: keys, lines of starter files, and the scene."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final

import numpy as np

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.matrices import is_sparse
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.meshes.graded import LEAST_POWER, force_power
from fvi_cli.keys.complaints import KeyPath
from fvi_cli.keys.cursor import PLAIN
from fvi_cli.keys.settings import Positive, Setting
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.data import SceneData
from fvi_cli.scenes.exact_check import objection
from fvi_cli.scenes.forces import (
    FORCING,
    PARAMETERS,
    Forces,
    Parameters,
    build_forcing,
    expressions,
    with_parameters,
)
from fvi_cli.scenes.kinds import shared_keys as shared
from fvi_cli.scenes.kinds.damping_keys import (
    DAMPING,
    Damping,
    build_damping,
    check_names_of_dampers,
)
from fvi_cli.scenes.lagrangian import check_names, names_of_dampers
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.scenes.structures.matrix_keys import file_form, matrix_size

_SHARED: Final = {"damping", "forcing", "ground_acceleration"}
"""Shared keys that kinds may declare again."""


class Kind(Setting):
    """A kind of problem: its fields are its keys."""

    kind: ClassVar[str]
    """The word under ``kind``."""
    equation: ClassVar[str]
    """The equation in plain text."""
    title: ClassVar[str] = ""
    """The title in figures; default: the word of the kind with blanks for hyphens."""
    example: ClassVar[Mapping[str, str]]
    """Values (YAML) in a starter file for keys that show more than their default."""
    sweep: ClassVar[str]
    final_time: Positive
    alternatives: ClassVar[Mapping[str, str]] = {}
    """By key the alternative key that a starter file shows in its place."""
    methods: ClassVar[str] = "{rk: gauss, degree: [2, 3]}"
    """Value of ``method`` in a starter file."""
    forces: ClassVar[tuple[str, ...]] = ("forcing",)
    """Keys of forces or of the motion of the ground; at most one of them may be given."""

    def stated_size(self) -> tuple[KeyPath, int] | None:
        """Path and value of the key that gives the number of coordinates; None: no key does."""
        return None

    def build_scene(self) -> Scene:
        """The scene."""
        raise ArgumentError("kind", f"{self.kind!r} is not the name of a scene")

    @abstractmethod
    def build_problem(self, *, search: bool = True) -> AnyProblem:
        """The problem; with `search` its exact solution is searched if none is given."""


class SceneKind(Kind, refused=shared.WRONG_AT_PROBLEM, declares="parameters"):
    """A kind of scene, with own keys and the keys that all scenes share."""

    make: ClassVar[Callable[..., Scene]]
    """The function that makes the scene from own keys and :class:`SceneData`."""
    size: ClassVar[int | None] = None
    """Number of coordinates if it is fixed."""
    size_key: ClassVar[str] = ""
    """The key with the number of coordinates; empty: it follows from the longest entry."""
    names: ClassVar[tuple[str, ...]] = ()
    """Names of the coordinates; empty: ``x``, or ``x1``, ``x2``, ..."""

    damping: Damping = DAMPING
    derivative: shared.DerivativeWord = shared.DERIVATIVE
    forcing: Forces = FORCING
    initial: shared.Initial = shared.INITIAL
    final_time: Positive = shared.FINAL_TIME
    exact: shared.Exact = shared.EXACT
    parameters: Parameters = PARAMETERS

    def stated_size(self) -> tuple[KeyPath, int] | None:
        """Path and value of the key that gives the number of coordinates; None: no key does."""
        path: KeyPath = (self.size_key,) if self.size_key else ()
        if self.size is not None:
            return path, self.size
        stated = getattr(self, self.size_key, None) if self.size_key else None
        if isinstance(stated, tuple):
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
        entries = [self.initial.position, *self._matrices()]
        entries += [term.factor for term in self.damping if term.acts_on is None]
        return _numbered(max(map(_size, entries)) if stated is None else stated[1])

    def _matrices(self) -> tuple[object, object]:
        return getattr(self, "mass", None), getattr(self, "stiffness", None)

    def build_scene(self) -> Scene:
        """The scene."""
        names, forces = self.coordinate_names(), self.forces
        if self.parameters:
            check_names(names, self.parameters)
        # a file of mass or stiffness may be sparse
        sparse = any(is_sparse(file_form(one)) for one in self._matrices())
        damping, laws = build_damping(self.damping, names, sparse=sparse)
        start = self.initial
        data: SceneData = {
            "final_time": float(self.final_time),
            "damping": damping,
            "laws": laws,
            "initial_position": shared.vector_of(start.position, names, "initial.position"),
            "initial_velocity": shared.vector_of(start.velocity, names, "initial.velocity"),
            "derivative": self.derivative,
        }
        drivers = {name: self._driver(name, names) for name in forces}
        if sum(driver is not None for driver in drivers.values()) > 1:
            raise ArgumentError(forces[1], f"give this or {forces[0]}, not both")
        scene = self.make_scene(**data, **drivers)
        check_names_of_dampers((*scene.damping, *scene.laws), "damping")
        if self.parameters:
            ready = dict.fromkeys(self.ready_quantities(), "a ready quantity")
            inputs = dict.fromkeys({*forces} - {"forcing"}, "what drives the motion")
            check_names(names, self.parameters, {**inputs, **names_of_dampers(scene), **ready})
        return scene

    def own_values(self) -> dict[str, Any]:
        """The values of the kind's own keys."""
        own = set(type(self).__annotations__) - _SHARED
        return {name: one for name, one in vars(self).items() if name in own}

    def make_scene(self, **data: Any) -> Scene:
        """The scene from its own keys and the shared arguments `data`."""
        return type(self).make(**self.own_values(), **data)

    def _driver(self, name: str, names: tuple[str, ...]) -> Forcing | None:
        return build_forcing(
            getattr(self, name),
            len(names) if name == "forcing" else 1,
            name,
            final_time=float(self.final_time),
            names=names,
            parameters=self.parameters,
        )

    def build_problem(self, *, search: bool = True) -> Problem:
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
            given = with_parameters(vars(self))["exact"]
            components = expressions(given, scene.dimension, "exact")
            exact, source = ForcingPiece(components=components).evaluate, "expression"
            if reason := objection(exact, scene):
                raise ArgumentError("exact", reason)
        ground = [name for name in self.forces if name != "forcing"]
        return Problem(
            kind=self.kind,
            scene=scene,
            exact=exact,
            exact_source=source,
            equation=_with_laws(self.equation, scene),
            coordinates=self.own_names() or _numbered(scene.dimension),
            inputs={name: self._driver(name, ()) for name in ground},
            numbers=self.numbers(),
            ready=self.ready_quantities(),
        )

    def numbers(self) -> Mapping[str, float]:
        """Numbers by their names in expressions along a motion."""
        return self.parameters or {}

    def ready_quantities(self) -> Mapping[str, Expression]:
        """Formulas of built-in quantities by name."""
        return {}


def _numbered(size: int) -> tuple[str, ...]:
    return ("x",) if size == 1 else tuple(f"x{index}" for index in range(1, size + 1))


def _with_laws(equation: str, scene: Scene) -> str:
    """The equation of a scene, with moduli G if its damping has relaxation laws."""
    if not scene.laws or "G(D)" in equation:
        return equation
    both = r"sum mu D^gamma \1 + sum G(D) \1" if scene.damping else r"sum G(D) \1"
    return re.sub(r"sum mu D\^gamma (\w+)", both, equation)


def _size(entry: object) -> int:
    """Number of coordinates that an entry has values for; 1 for a number."""
    if isinstance(entry, list | tuple):
        return int(np.size(entry, 0))
    return 1 if type(entry) in PLAIN else matrix_size(entry) or 1
