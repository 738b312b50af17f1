"""Equal parts in a row: a chain of masses, a building, a string."""

from __future__ import annotations

from typing import Annotated, ClassVar, Final

from fvi_cli.keys.containers import ByForm, ListOf
from fvi_cli.keys.scalars import Integer, Number
from fvi_cli.keys.settings import Fraction, Positive, Setting, key
from fvi_cli.scenes.chains import Ends, chain, frame, string
from fvi_cli.scenes.data import Damper
from fvi_cli.scenes.forces import GROUND_ACCELERATION, GroundMotion
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.kinds.shared_keys import dampers

Count = Annotated[int, Integer(least=1, most=1000)]
_PER_STOREY: Final = ByForm(
    single=Number(above=0.0), several=ListOf(shape=Number(above=0.0), example="[2.0, 1.0]")
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
    dampers: Dampers = key("Fractional dampers c D^gamma beside every spring.", default=[])


class Frame(SceneKind):
    """A building of storeys that shear, shaken by the ground."""

    kind = "frame"
    equation = (
        "mass_i x_i'' + s_i - s_(i+1) + sum mu D^gamma x_i = -mass_i a(t), s_i = (stiffness_i "
        "+ sum c D^gamma) (x_i - x_(i-1))"
    )
    make = staticmethod(frame)
    forces = ("ground_acceleration",)
    size_key = "storeys"
    example: ClassVar = {
        "stiffness": "10.0",
        "dampers": "[{order: 0.5, coefficient: 0.5}]",
        "ground_acceleration": "t**3*exp(-t)*sin(3*t)",
        "final_time": "8.0",
    }
    sweep = "problem.dampers.0.order: {from: 0.1, to: 1.9, number: 10}"

    storeys: Count = key(
        "Number n of storeys; x1 ... xn are their displacements against the ground.", default=3
    )
    mass: PerStorey = key(
        "Mass of every storey, or a list from the ground up.", unit="unit of mass", default=1.0
    )
    stiffness: PerStorey = key(
        "Shear stiffness of every storey, or a list.", unit="mass per time^2", default=1.0
    )
    dampers: Dampers = key("Fractional dampers c D^gamma between storeys.", default=[])
    ground_acceleration: GroundMotion = GROUND_ACCELERATION
    forcing = None


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
