"""Equal parts in a row: a chain of masses, a building, a string."""

from __future__ import annotations

from functools import partial
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
from fvi_cli.scenes.chains import Ends, chain, frame, neighbour_rows, string
from fvi_cli.scenes.data import Damper
from fvi_cli.scenes.forces import GROUND_ACCELERATION, GroundMotion
from fvi_cli.scenes.kinds.damping_keys import (
    Term,
    damping_effects,
    damping_terms,
)
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.kinds.shared_keys import WRONG_AT_PROBLEM, dampers
from fvi_cli.scenes.structures.rayleigh import Rayleigh

USUAL_STOREYS: Final = 3


def _between_floors(count: int, term: Term, factor: object) -> Coefficient:
    """The coefficient of a damper of a building of so many storeys."""
    value = np.asarray(factor, dtype=float)
    if value.ndim:
        raise ArgumentError("coefficient", "a damper between two floors has a number here")
    rows, storey = neighbour_rows(count, "left"), getattr(term, "storey", None)
    if storey is not None and storey > count:
        raise ArgumentError("storey", f"{storey} is not allowed; there are {count} storeys")
    return Directions(rows=rows if storey is None else rows[[storey - 1]]).factored(value)


Count = Annotated[int, Integer(least=1, most=1000)]
_STOREYS: Final = ListOf(shape=Number(above=0.0), most=1000, example="[2.0, 1.0]")
_PER_STOREY: Final = ByForm(single=Number(above=0.0), several=_STOREYS)
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
            ("proportional", "modal_damping", "damping_ratio", "damping_ratios", "ratios"),
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
    sweep = "problem.dampers.0.order: {from: 0.1, to: 1.9, number: 10}"

    storeys: Annotated[int | None, Integer(least=1, most=1000)] = key(
        "Number n of storeys; x1 ... xn are their displacements against the ground. Default: the "
        "length of the lists below, or 3.",
        default=None,
    )
    mass: PerStorey = key(
        "Mass of every storey, or a list from the ground up.", unit="unit of mass", default=1.0
    )
    masses: Annotated[tuple[float, ...] | None, _STOREYS] = key(
        "In place of mass: a list from the ground up.", unit="unit of mass", default=None
    )
    stiffness: PerStorey = key(
        "Shear stiffness of every storey, or a list.", unit="mass per time^2", default=1.0
    )
    stiffnesses: Annotated[tuple[float, ...] | None, _STOREYS] = key(
        "In place of stiffness: a list from the ground up.", unit="mass per time^2", default=None
    )
    dampers: Annotated[tuple[Term, ...], damping_terms(at_storeys=True)] = key(
        "Dampers of any law between floors: in one storey, or in every one.",
        unit="coefficient: mass times time^(gamma-2)",
        default=[],
    )
    rayleigh: Rayleigh | None = key(
        "Damping (a M + b K) x' by the ratios of two modes of masses and stiffnesses.", default=None
    )
    ground_acceleration: GroundMotion = GROUND_ACCELERATION
    forcing = None

    @classmethod
    def check_presence(cls, at: Cursor) -> None:
        """A list of storeys stands in place of the number or list under the other name."""
        for one, several in (("mass", "masses"), ("stiffness", "stiffnesses")):
            if at.has(several) and at.has(one) and at.under(one).scalar != 1.0:
                at.refuse_key(several, f"give this or {one}, not both")

    def make_scene(self, **data: Any) -> Scene:
        """The scene; terms of its dampers stand before those of its damping."""
        count = int(np.size(data["initial_position"]))
        before = max((one.number for one in (*data["damping"], *data["laws"])), default=0)
        between, damped = partial(_between_floors, count), self.rayleigh
        damping, laws = damping_effects(self.dampers, between, "dampers", before=before)
        data["damping"], data["laws"] = (*damping, *data["damping"]), (*laws, *data["laws"])
        return frame(
            storeys=count,
            mass=self.mass if self.masses is None else self.masses,
            stiffness=self.stiffness if self.stiffnesses is None else self.stiffnesses,
            rayleigh=None if damped is None else (damped.ratios, damped.modes),
            **data,
        )

    def stated_size(self) -> tuple[KeyPath, int]:
        """The key that says the number of storeys, and that number."""
        if isinstance(self.storeys, int):
            return ("storeys",), self.storeys
        for name in ("masses", "stiffnesses", "mass", "stiffness"):
            value = getattr(self, name)
            if isinstance(value, list | tuple):
                return (name,), len(value)
        return ("storeys",), USUAL_STOREYS


class Pluck(Setting):
    """A triangle."""

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
