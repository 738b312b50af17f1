"""Equal parts in a row: a chain of masses, a building, a string."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache, partial
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import Field

from fvi_cli.effects.damping import Coefficient
from fvi_cli.effects.directions import Directions
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.algebra.builder import Builder
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.chains import Ends, chain, frame, neighbour_rows, string
from fvi_cli.scenes.forces import GROUND_ACCELERATION, TimeFunction
from fvi_cli.scenes.keys.values import (
    BY_FORM,
    Count,
    Fraction,
    KeyPath,
    Keys,
    Positive,
    Wrong,
    key,
)
from fvi_cli.scenes.kinds.kind import Forced, SceneKind
from fvi_cli.scenes.kinds.laws import AnyTerm, Damper, Term, damping_effects
from fvi_cli.scenes.records.samples import Column
from fvi_cli.scenes.structures.rayleigh import Rayleigh

USUAL_STOREYS: Final = 3
BASE_SHEAR: Final = "base_shear"


def _between_floors(count: int, term: AnyTerm, factor: object) -> Coefficient:
    """The coefficient of a damper in a building of `count` storeys."""
    if not isinstance(factor, float):
        raise ArgumentError("coefficient", "a damper between floors has a number")
    storeys = term.storeys or ()
    for index, storey in enumerate(storeys):
        place = "storey" if len(storeys) == 1 else f"storey.{index}"
        if storey > count:
            raise ArgumentError(place, f"{storey} is not allowed; write 1 to {count}, the storeys")
        if storey in storeys[:index]:
            raise ArgumentError(place, f"{storey} is given twice; write a damper of its own for it")
    labels = tuple(storeys) or tuple(range(1, count + 1))
    rows = neighbour_rows(count, "left")[[storey - 1 for storey in labels]]
    return Directions(rows=rows, labels=labels).factored(factor)


class Chain(Forced):
    """Equal masses in a row with springs and dampers between neighbours."""

    equation = (
        "mass x_i'' + (stiffness + sum c D^gamma) (2 x_i - x_(i-1) - x_(i+1)) + sum mu "
        "D^gamma x_i = f_i(t)"
    )
    size_key = "masses"
    kind: Literal["chain"] = key("Which equation.", "chain")
    masses: Count = key(
        "Number n of masses; the coordinates are x1 ... xn (x if there is one).", 10
    )
    mass: Positive = key("Mass.", 1.0, unit="unit of mass")
    stiffness: float = key("k of the spring between neighbours.", 1.0, unit="mass per time^2")
    ends: Ends = key(
        "Which ends of the chain are tied to a wall by a spring and its dampers.", "both"
    )
    dampers: list[Damper] = key("Fractional dampers c D^gamma parallel to every spring.", [])

    def make_scene(self, **data: Any) -> Scene:
        """The scene."""
        return chain(
            masses=self.masses,
            mass=self.mass,
            stiffness=self.stiffness,
            ends=self.ends,
            dampers=[one.value() for one in self.dampers],
            **data,
        )


_Storeys = Annotated[list[Positive], Field(min_length=1, max_length=1000)]
PerStorey = Annotated[Positive | _Storeys | Column, BY_FORM]
_MASS: Final = (
    "Mass of every storey: a number, a list from the ground up, or {file: building.csv, column: "
    "mass}; default: 1."
)
_SHEAR: Final = "Shear stiffness of every storey, likewise; default: 1."


def _each(value: object) -> Any:
    """A number or the numbers of a list or column."""
    return value.numbers.tolist() if isinstance(value, Column) else value


class FrameKind(SceneKind):
    """A building of storeys that shear, shaken by the ground."""

    equation = (
        "mass_i x_i'' + s_i - s_(i+1) + sum mu D^gamma x_i = -mass_i a(t), s_i = (stiffness_i "
        "+ sum c D^gamma) (x_i - x_(i-1))"
    )
    forces = ("ground_acceleration",)
    kind: Literal["frame"] = key("Which equation.", "frame")
    storeys: Count | None = key(
        "Number n of storeys; x1 ... xn are their displacements against the ground. Default: the "
        "length of the lists below, or 3.",
        None,
    )
    mass: PerStorey | None = key(_MASS, None, unit="unit of mass")
    masses: PerStorey | None = key("The same under another name.", None, unit="unit of mass")
    stiffness: PerStorey | None = key(_SHEAR, None, unit="mass per time^2")
    stiffnesses: PerStorey | None = key(
        "The same under another name.", None, unit="mass per time^2"
    )
    dampers: list[Term] = key(
        "Dampers of any law between floors: in one storey, or in every one.",
        [],
        unit="coefficient: mass times time^(gamma-2)",
    )
    rayleigh: Rayleigh | None = key(
        "Damping (a M + b K) D^gamma x, by its factors or by the ratios of two modes of masses and "
        "stiffnesses.",
        None,
    )
    ground_acceleration: TimeFunction = GROUND_ACCELERATION

    def mistakes(self) -> Iterator[Wrong]:
        """Two words for one property, and directions of dampers between floors, too."""
        yield from super().mistakes()
        for one, other in (("mass", "masses"), ("stiffness", "stiffnesses")):
            if getattr(self, one) is not None and getattr(self, other) is not None:
                yield Wrong((other,), f"give this or {one}, not both", of_key=True)
        for number, term in enumerate(self.dampers):
            if term.acts_on is not None:
                message = "not a key here: write storey, or give the term under damping"
                yield Wrong(("dampers", number, "acts_on"), message, of_key=True)

    @property
    def storey_masses(self) -> Array:
        """The masses from the ground up, shape ``(n,)``."""
        return self._per_storey(self.mass or self.masses or 1.0)

    def _per_storey(self, given: object) -> Array:
        return np.broadcast_to(np.asarray(_each(given), dtype=float), self.stated_size()[1])

    def make_scene(self, **data: Any) -> Scene:
        """The scene; terms of ``dampers`` come before those of ``damping``."""
        count = self.stated_size()[1]
        before = max((one.number for one in (*data["damping"], *data["laws"])), default=0)
        between = partial(_between_floors, count)
        damping, laws = damping_effects(self.dampers, between, "dampers", before=before)
        data["damping"], data["laws"] = (*damping, *data["damping"]), (*laws, *data["laws"])
        return frame(
            storeys=count,
            mass=_each(self.mass or self.masses or 1.0),
            stiffness=_each(self.stiffness or self.stiffnesses or 1.0),
            rayleigh=self.rayleigh,
            **data,
        )

    def numbers(self) -> Mapping[str, float]:
        """The parameters, and ``mass_1``, ..., the masses of the storeys."""
        masses = {f"mass_{n}": one for n, one in enumerate(self.storey_masses.tolist(), start=1)}
        if taken := masses.keys() & self.parameters.keys():
            raise ArgumentError(f"parameters.{min(taken)}", "is the mass of a storey; take another")
        return {**masses, **self.parameters}

    def ready_quantities(self) -> Mapping[str, Expression]:
        """Drifts, absolute accelerations (with the ground), and the force of the foundation."""
        return frame_quantities(self.coordinate_names())

    def stated_size(self) -> tuple[KeyPath, int]:
        """Path and value of the key with the number of storeys."""
        if self.storeys is not None:
            return ("storeys",), self.storeys
        for name in ("masses", "stiffnesses", "mass", "stiffness"):
            value = _each(getattr(self, name))
            if isinstance(value, list):
                return (name,), len(value)
        return ("storeys",), USUAL_STOREYS


@lru_cache(maxsize=8)
def frame_quantities(coordinates: tuple[str, ...]) -> Mapping[str, Expression]:
    r"""Quantities of a building by name, in its coordinates from the ground up.

    ``drift_i`` is :math:`x_i - x_{i-1}`, ``acceleration_i`` :math:`x_i'' + a`, and ``base_shear``
    :math:`\sum m_i (x_i'' + a)`, the force of the foundation.
    """
    ground = "ground_acceleration"
    found = {}
    below = "0"
    for number, name in enumerate(coordinates, start=1):
        drift = name if below == "0" else f"{name} - {below}"
        found[f"drift_{number}"] = Expression.parse(drift, variables=coordinates)
        own = f"a{name}", ground
        found[f"acceleration_{number}"] = Expression.parse(" + ".join(own), variables=own)
        below = name
    # built without text, since the sum of a tall building would exceed the longest text
    builder = Builder()
    moved = builder.number(0.0)
    total = builder.number(0.0)
    for number, name in enumerate(coordinates, start=1):
        mass = builder.variable(f"mass_{number}")
        moved, total = moved + mass * builder.variable(f"a{name}"), total + mass
    system = builder.system([moved + total * builder.variable(ground)])
    found[BASE_SHEAR] = Expression(BASE_SHEAR, system.names, (), system)
    return MappingProxyType(found)


class Pluck(Keys):
    """A triangle, the initial shape of a plucked string."""

    at: Fraction = key("Place, as a fraction of the length (no unit).", 0.5)
    height: float = key("Height there.", 0.0, unit="length")


class String(Forced):
    """The sine modes of a string that is held at both ends."""

    equation = (
        "u_tt + sum mu D^gamma u - sum eta D^gamma u_ss = wave_speed^2 u_ss in sine modes "
        "x1, x2, ..."
    )
    size_key = "modes"
    kind: Literal["string"] = key("Which equation.", "string")
    modes: Count = key("Number n of sine modes; the coordinates x1 ... xn are their amplitudes.", 8)
    wave_speed: Positive = key("c, the speed of waves.", 1.0, unit="length per time")
    length: Positive = key("L, the distance of the ends.", 1.0, unit="length")
    pluck: Pluck = key("A triangle that is added to the initial position.", Pluck())
    internal_damping: list[Damper] = key(
        "Terms -eta D^gamma u_ss of the material, eta their coefficient.", []
    )

    def make_scene(self, **data: Any) -> Scene:
        """The scene."""
        return string(
            modes=self.modes,
            wave_speed=self.wave_speed,
            length=self.length,
            pluck=(self.pluck.at, self.pluck.height),
            internal_damping=[one.value() for one in self.internal_damping],
            **data,
        )
