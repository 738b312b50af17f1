"""What a kind of problem is: its keys, what a starter file shows of them, and what they build."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.matrices import is_sparse
from fvi_cli.effects.scene import Derivative, Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import KeyPath
from fvi_cli.keys.records import Key, Record
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.data import SceneData
from fvi_cli.scenes.exact_check import objection
from fvi_cli.scenes.forces import (
    FORCING,
    GROUND_ACCELERATION,
    PARAMETERS,
    build_forcing,
    expressions,
    with_parameters,
)
from fvi_cli.scenes.kinds.damping_keys import build_damping, coefficient_of
from fvi_cli.scenes.kinds.shared_keys import SHARED_KEYS, scene_keys, vector_of
from fvi_cli.scenes.lagrangian import check_names
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.scenes.structures.matrix_keys import file_form, rows_of

Values = Mapping[str, Any]
"""Plain values under the keys of a kind, with every default filled in."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Kind(ABC):
    """A kind of problem.

    Parameters
    ----------
    name
        What stands under ``kind``.
    equation
        The equation in plain text.
    record
        Its keys.
    example
        Keys of a starter file that show more than the default, with what stands there as YAML.
    sweep
        What a starter file shows of ``sweep``.
    methods
        What it shows of ``method``.
    title
        In figures; default: the name with blanks.
    """

    name: str
    equation: str
    record: Record
    example: Mapping[str, str]
    sweep: str
    methods: str = "{rk: gauss, degree: [2, 3]}"
    title: str = ""

    @property
    def heading(self) -> str:
        """The title."""
        return self.title or self.name.replace("-", " ")

    @property
    def forces(self) -> tuple[str, ...]:
        """Keys under which what drives a motion stands."""
        return ("forcing",)

    def stated_size(self, values: Values) -> tuple[KeyPath, int] | None:
        """The path of the key that says the number of coordinates, and that number."""
        return None

    @abstractmethod
    def build(self, values: Values, *, search: bool = True) -> AnyProblem:
        """The problem.

        Parameters
        ----------
        values
            With all defaults.
        search
            Look for the exact solution where none is given, which takes long.

        Raises
        ------
        ValueError
            ``key.path: what is wrong``.
        """


def scene_record(*own: Key, default_order: float = 1.0, force: Key = FORCING) -> Record:
    """The keys of a scene: its own, then those that all scenes share."""
    return scene_keys(own, default_order=default_order, force=force)


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneKind(Kind):
    """A kind of scene.

    Parameters
    ----------
    make
        The scene of arguments that are called like the keys, and of :class:`SceneData`.
    size
        Number of coordinates where no other is possible.
    size_key
        The key that says it; none: the largest of all entries.
    coordinates
        Names of the coordinates; none: ``x``, or ``x1``, ``x2``, ...
    names
        The names where they stand in the values.
    """

    make: Callable[..., Scene]
    size: int | None = None
    size_key: str = ""
    coordinates: tuple[str, ...] = ()
    names: Callable[[Values], tuple[str, ...]] | None = None

    @property
    def forces(self) -> tuple[str, ...]:
        """Keys under which what drives a motion stands; no more than one of them is given."""
        known = (FORCING.name, GROUND_ACCELERATION.name)
        return tuple(name for name in known if name in self.record.names)

    def stated_size(self, values: Values) -> tuple[KeyPath, int] | None:
        """The path of the key that says the number of coordinates, and that number."""
        path: KeyPath = (self.size_key,) if self.size_key else ()
        if self.size is not None:
            return path, self.size
        stated = values.get(self.size_key)
        if isinstance(stated, list | tuple):
            return path, len(stated)
        return (path, stated) if isinstance(stated, int) else None

    def coordinate_names(self, values: Values) -> tuple[str, ...]:
        """Names of the coordinates, as ``acts_on`` knows them."""
        if self.names is not None:
            return self.names(values)
        stated = self.stated_size(values)
        entries = [values["initial"]["position"], values.get("mass"), values.get("stiffness")]
        entries += [coefficient_of(term) for term in values["damping"] if "acts_on" not in term]
        size = max(_size(entry) for entry in entries)
        size = size if stated is None else stated[1]
        numbered = ("x",) if size == 1 else tuple(f"x{index}" for index in range(1, size + 1))
        return self.coordinates or numbered

    def is_sparse(self, values: Values) -> bool:
        """Whether mass or stiffness come from a file with entries only."""
        given = (values.get(name) for name in ("mass", "stiffness"))
        return any(is_sparse(file_form(one)) for one in given)

    def scene(self, values: Values) -> Scene:
        """The scene of values with all defaults.

        Raises
        ------
        ValueError
            ``key.path: what is wrong``.
        """
        names = self.coordinate_names(values)
        if values.get(PARAMETERS.name):
            check_names(names, values[PARAMETERS.name])
        damping, laws = build_damping(values["damping"], names, sparse=self.is_sparse(values))
        data: SceneData = {
            "final_time": float(values["final_time"]),
            "damping": damping,
            "laws": laws,
            "initial_position": vector_of(values["initial"]["position"], names, "initial.position"),
            "initial_velocity": vector_of(values["initial"]["velocity"], names, "initial.velocity"),
            "derivative": cast(Derivative, values["derivative"]),
        }
        own = {
            key.name: values[key.name] if key.build is None else key.build(values[key.name])
            for key in self.record.keys
            if key.name not in SHARED_KEYS and key is not PARAMETERS and key.name in values
        }
        drivers = {key: self._driver(values, key, names) for key in self.forces}
        if sum(driver is not None for driver in drivers.values()) > 1:
            raise ArgumentError(self.forces[1], f"give this or {self.forces[0]}, not both")
        return self.make(**{**own, **data, **drivers})

    def _driver(self, values: Values, key: str, names: tuple[str, ...]) -> Forcing | None:
        return build_forcing(
            with_parameters(values)[key],
            len(names) if key == FORCING.name else 1,
            key,
            final_time=float(values["final_time"]),
            names=names,
        )

    def build(self, values: Values, *, search: bool = True) -> Problem:
        """The scene with its exact solution, as far as that is known."""
        scene = self.scene(values)
        exact: Callable[[Array], Array] | None = None
        source = "unknown"
        if values["exact"] == "none":
            source = "none"
        elif values["exact"] != "auto":
            given = with_parameters(values)["exact"]
            components = expressions(given, scene.dimension, "exact")
            exact, source = ForcingPiece(components=components).evaluate, "expression"
            if said := objection(exact, scene):
                raise ArgumentError("exact", said)
        elif search and scene.is_linear:
            # looking for it takes long to import
            from fvi_cli.scenes.linear_response import match_scene

            solution = match_scene(scene)
            if solution is not None:
                exact, source = solution.position, solution.source
        return Problem(
            kind=self.name,
            scene=scene,
            exact=exact,
            exact_source=source,
            equation=_with_laws(self.equation, scene),
            coordinates=self.coordinate_names(values),
            inputs=self._inputs(values),
        )

    def _inputs(self, values: Values) -> dict[str, Forcing | None]:
        key = GROUND_ACCELERATION.name
        return {key: self._driver(values, key, ())} if key in self.forces else {}


def _with_laws(equation: str, scene: Scene) -> str:
    """The equation of a scene whose damping has relaxation laws: their moduli G stand in it."""
    if not scene.laws or "G(D)" in equation:
        return equation
    both = r"sum mu D^gamma \1 + sum G(D) \1" if scene.damping else r"sum G(D) \1"
    return re.sub(r"sum mu D\^gamma (\w+)", both, equation)


def _size(entry: object) -> int:
    """Number of coordinates that an entry speaks of; 1 where it does not say."""
    if isinstance(entry, list | tuple):
        return int(np.size(entry, 0))
    return rows_of(entry) or 1
