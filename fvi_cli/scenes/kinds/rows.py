"""Equal parts in a row: a chain of masses, a building, a string."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, partial
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Final

import numpy as np

from fvi_cli.effects.damping import Coefficient
from fvi_cli.effects.directions import Directions
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import KeyPath
from fvi_cli.keys.containers import ByForm, ListOf
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Integer, Number
from fvi_cli.keys.settings import Fraction, Positive, Setting, key
from fvi_cli.mathematics.algebra.builder import Builder
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.chains import Ends, chain, frame, neighbour_rows, string
from fvi_cli.scenes.data import Damper
from fvi_cli.scenes.forces import GROUND_ACCELERATION, GroundMotion
from fvi_cli.scenes.kinds.damping_keys import (
    AtStorey,
    Term,
    damping_effects,
    damping_terms,
)
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.kinds.shared_keys import WRONG_AT_PROBLEM, dampers
from fvi_cli.scenes.records.column_file import COLUMN_FILE
from fvi_cli.scenes.structures.rayleigh import Rayleigh

USUAL_STOREYS: Final = 3
BASE_SHEAR: Final = "base_shear"


def _between_floors(count: int, term: Term, factor: float) -> Coefficient:
    """The coefficient of a damper in a building of `count` storeys."""
    storeys = term.storey if isinstance(term, AtStorey) else None
    for index, storey in enumerate(storeys or ()):
        place = "storey" if len(storeys or ()) == 1 else f"storey.{index}"
        if storey > count:
            raise ArgumentError(place, f"{storey} is not allowed; write 1 to {count}, the storeys")
        if storey in (storeys or ())[:index]:
            raise ArgumentError(place, f"{storey} is given twice; write a damper of its own for it")
    labels = storeys or tuple(range(1, count + 1))
    rows = neighbour_rows(count, "left")[[storey - 1 for storey in labels]]
    return Directions(rows=rows, labels=labels).factored(factor)


Count = Annotated[int, Integer(least=1, most=1000)]
_STOREYS: Final = ListOf(shape=Number(above=0.0), most=1000, example="[2.0, 1.0]")
_FROM_GROUND: Final = ByForm(several=_STOREYS, mappings=(COLUMN_FILE,))
_PER_STOREY: Final = ByForm(
    single=Number(above=0.0),
    several=_STOREYS,
    example="masses: {file: building.csv, column: mass}, and stiffnesses alike",
)
PerStorey = Annotated[float | tuple[float, ...], _PER_STOREY]
Dampers = Annotated[tuple[Damper, ...], dampers("mass times time^(gamma-2)")]


class Chain(SceneKind):
    """Equal masses in a row with springs and dampers between neighbours."""

    kind = "chain"
    equation = (
        "mass x_i'' + (stiffness + sum c D^gamma) (2 x_i - x_(i-1) - x_(i+1)) + sum mu "
        "D^gamma x_i = f_i(t)"
    )
    make = staticmethod(chain)
    size_key = "masses"
    example: ClassVar = {
        "masses": "3",
        "dampers": "[{order: 0.5, coefficient: 0.2}]",
        "initial": "{position: [1.0, 0.0, 0.0], velocity: 0.0}",
        "final_time": "10.0",
    }
    sweep = "problem.dampers.0.coefficient: [0.1, 0.2, 0.4]"

    masses: Count = key(
        "Number n of masses; the coordinates are x1 ... xn (x if there is one).", default=10
    )
    mass: Positive = key("Mass.", unit="unit of mass", default=1.0)
    stiffness: float = key(
        "k of the spring between neighbours.", unit="mass per time^2", default=1.0
    )
    ends: Ends = key(
        "Which ends of the chain are tied to a wall by a spring and its dampers.", default="both"
    )
    dampers: Dampers = key("Fractional dampers c D^gamma parallel to every spring.", default=[])


class FrameKind(
    SceneKind,
    refused={
        **WRONG_AT_PROBLEM,
        **dict.fromkeys(
            ("damping_ratio", "damping_ratios", "ratios"),
            "not a key of frame: write rayleigh: {ratios: [0.02, 0.05], modes: [1, 3]}",
        ),
        **dict.fromkeys(
            ("forcing", "force", "earthquake", "quake", "record", "ground"),
            "not a key of frame: write ground_acceleration",
        ),
        **dict.fromkeys(("floors", "stories", "levels"), "not a key: write storeys"),
    },
):
    """A building of storeys that shear, shaken by the ground."""

    kind = "frame"
    equation = (
        "mass_i x_i'' + s_i - s_(i+1) + sum mu D^gamma x_i = -mass_i a(t), s_i = (stiffness_i "
        "+ sum c D^gamma) (x_i - x_(i-1))"
    )
    forces = ("ground_acceleration",)
    size_key = "storeys"
    example: ClassVar = {
        "storeys": "3",
        "masses": "[2.0, 2.0, 1.6]",
        "stiffnesses": "[12.0, 10.0, 8.0]",
        "rayleigh": "{ratios: [0.02, 0.02], modes: [1, 3]}",
        "dampers": "[{storey: 1, order: 0.5, coefficient: 0.5}]",
        "ground_acceleration": "t**3*exp(-t)*sin(3*t)",
        "final_time": "8.0",
    }
    alternatives: ClassVar = {"storeys": "masses", "mass": "masses", "stiffness": "stiffnesses"}
    sweep = "problem.dampers.0.order: {from: 0.1, to: 1.9, number: 10}"

    storeys: Annotated[int | None, Integer(least=1, most=1000)] = key(
        "Number n of storeys; x1 ... xn are their displacements against the ground. Default: the "
        "length of the lists below, or 3.",
        default=None,
    )
    mass: PerStorey = key(
        "Mass of every storey, or a list from the ground up.",
        unit="unit of mass",
        default=1.0,
    )
    masses: Annotated[tuple[float, ...] | None, _FROM_GROUND] = key(
        "In place of mass: a list from the ground up, or {file: building.csv, column: mass}.",
        unit="unit of mass",
        default=None,
    )
    stiffness: PerStorey = key(
        "Shear stiffness of every storey, or a list.",
        unit="mass per time^2",
        default=1.0,
    )
    stiffnesses: Annotated[tuple[float, ...] | None, _FROM_GROUND] = key(
        "In place of stiffness: a list from the ground up, or a column of a file.",
        unit="mass per time^2",
        default=None,
    )
    dampers: Annotated[tuple[Term, ...], damping_terms(at_storeys=True)] = key(
        "Dampers of any law between floors: in one storey, or in every one.",
        unit="coefficient: mass times time^(gamma-2)",
        default=[],
    )
    rayleigh: Rayleigh | None = key(
        "Damping (a M + b K) D^gamma x, by its factors or by the ratios of two modes of masses and "
        "stiffnesses.",
        default=None,
    )
    ground_acceleration: GroundMotion = GROUND_ACCELERATION
    forcing = None

    @classmethod
    def check_presence(cls, at: Cursor) -> None:
        """Refuse a number and a list of storeys for the same property, e.g. mass and masses."""
        for one in ("mass", "stiffness"):
            several = cls.alternatives[one]
            if at.has(several) and at.has(one) and at.under(one).scalar != 1.0:
                at.refuse_key(several, f"give this or {one}, not both")

    def make_scene(self, **data: Any) -> Scene:
        """The scene; terms of ``dampers`` come before those of ``damping``."""
        count = int(np.size(data["initial_position"]))
        before = max((one.number for one in (*data["damping"], *data["laws"])), default=0)
        between = partial(_between_floors, count)
        damping, laws = damping_effects(self.dampers, between, "dampers", before=before)
        data["damping"], data["laws"] = (*damping, *data["damping"]), (*laws, *data["laws"])
        return frame(
            storeys=count,
            mass=self.mass if self.masses is None else self.masses,
            stiffness=self.stiffness if self.stiffnesses is None else self.stiffnesses,
            rayleigh=self.rayleigh,
            **data,
        )

    def numbers(self) -> Mapping[str, float]:
        """The parameters, and ``mass_1``, ..., the masses of the storeys."""
        given = self.mass if self.masses is None else self.masses
        each = np.broadcast_to(np.asarray(given, dtype=float), self.stated_size()[1])
        masses = {f"mass_{number}": one for number, one in enumerate(each.tolist(), start=1)}
        if taken := masses.keys() & (self.parameters or {}).keys():
            raise ArgumentError(f"parameters.{min(taken)}", "is the mass of a storey; take another")
        return {**masses, **(self.parameters or {})}

    def ready_quantities(self) -> Mapping[str, Expression]:
        """Drifts, absolute accelerations (with the ground), and the force on the foundation."""
        return frame_quantities(self.coordinate_names())

    def stated_size(self) -> tuple[KeyPath, int]:
        """Path and value of the key with the number of storeys."""
        if isinstance(self.storeys, int):
            return ("storeys",), self.storeys
        for name in ("masses", "stiffnesses", "mass", "stiffness"):
            value = getattr(self, name)
            if isinstance(value, list | tuple):
                return (name,), len(value)
        return ("storeys",), USUAL_STOREYS


@lru_cache(maxsize=8)
def frame_quantities(coordinates: tuple[str, ...]) -> Mapping[str, Expression]:
    r"""Quantities of a building by name, in its coordinates from the ground up.

    ``drift_i`` is :math:`x_i - x_{i-1}`, ``acceleration_i`` :math:`x_i'' + a`, and ``base_shear``
    :math:`\sum m_i (x_i'' + a)`, the force on the foundation.
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


class Pluck(Setting):
    """A triangle, the initial shape of a plucked string."""

    at: Fraction = key("Place, as a fraction of the length (no unit).", default=0.5)
    height: float = key("Height there.", unit="length", default=0.0)

    def value(self) -> tuple[float, float]:
        """Place and height."""
        return self.at, self.height


class String(SceneKind):
    """The sine modes of a string that is held at both ends."""

    kind = "string"
    equation = (
        "u_tt + sum mu D^gamma u - sum eta D^gamma u_ss = wave_speed^2 u_ss in sine modes "
        "x1, x2, ..."
    )
    make = staticmethod(string)
    size_key = "modes"
    example: ClassVar = {
        "modes": "4",
        "pluck": "{at: 0.3, height: 0.1}",
        "internal_damping": "[{order: 0.5, coefficient: 0.01}]",
        "final_time": "2.0",
    }
    sweep = "problem.pluck.at: [0.1, 0.3, 0.5]"

    modes: Count = key(
        "Number n of sine modes; the coordinates x1 ... xn are their amplitudes.", default=8
    )
    wave_speed: Positive = key("c, the speed of waves.", unit="length per time", default=1.0)
    length: Positive = key("L, the distance of the ends.", unit="length", default=1.0)
    pluck: Pluck = key(
        "A triangle that is added to the initial position.", default={"at": 0.5, "height": 0.0}
    )
    internal_damping: Annotated[
        tuple[Damper, ...], dampers("length^2 times time^(gamma-2)", "-of-string")
    ] = key("Terms -eta D^gamma u_ss of the material, eta their coefficient.", default=[])
