"""Systems by their Lagrangian: any one as a formula, and the double pendulum."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Final

from fvi_cli.keys.containers import ListOf, Named
from fvi_cli.keys.scalars import Number, Text
from fvi_cli.keys.settings import key
from fvi_cli.scenes.data import Damper
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.kinds.shared_keys import dampers
from fvi_cli.scenes.lagrangian import check_names, double_pendulum, lagrangian_scene

_PAIR: Final = ListOf(shape=Number(above=0.0), least=2, most=2, example="[1.0, 1.0]")
Pair = Annotated[tuple[float, float], _PAIR]
_NAMES: Final = ListOf(shape=Text(what="a name"), most=100, example="[x, y]")
_FORMULA: Final = Text(what="an expression in coordinates, velocities, parameters and t")


class DoublePendulum(SceneKind):
    """Two rods in a row with damped joints."""

    kind = "double-pendulum"
    equation = (
        "two rods, angles theta1, theta2 from the vertical; the joints turn "
        "against c D^gamma of theta1 and of theta2 - theta1"
    )
    make = staticmethod(double_pendulum)
    size = 2
    names = ("theta1", "theta2")
    example: ClassVar = {
        "joints": "[{order: 0.5, coefficient: 0.2}]",
        "initial": "{position: [1.0, -0.5], velocity: 0.0}",
        "final_time": "4.0",
    }
    sweep = "problem.joints.0.order: [0.5, 1.0]"

    masses: Pair = key(
        "Point masses at the ends of the first and the second rod.",
        unit="unit of mass",
        default=[1.0, 1.0],
    )
    lengths: Pair = key("Lengths of the rods.", unit="length", default=[1.0, 1.0])
    gravity: float = key("Acceleration of free fall.", unit="length per time^2", default=1.0)
    joints: Annotated[
        tuple[Damper, ...], dampers("mass length^2 times time^(gamma-2)", "-of-joint")
    ] = key("Fractional dampers c D^gamma in both joints.", default=[])


class LagrangianKind(SceneKind):
    """Any mechanical system, by its Lagrangian as a formula."""

    kind = "lagrangian"
    equation = "d/dt dL/dv - dL/dq + sum mu D^gamma q = f(t)"
    make = staticmethod(lagrangian_scene)
    size_key = "coordinates"
    example: ClassVar = {
        "coordinates": "[x]",
        "parameters": "{m: 1.0, g: 9.81}",
        "lagrangian": "m*vx**2/2 - m*g*(1 - cos(x))",
        "damping": "[{order: 0.5, coefficient: 0.3, acts_on: [x]}]",
        "initial": "{position: 1.0, velocity: 0.0}",
        "final_time": "4.0",
    }
    sweep = "problem.parameters.g: [1.62, 9.81]"

    coordinates: Annotated[tuple[str, ...], _NAMES] = key(
        "Names of the coordinates q; the velocity of x is vx."
    )
    parameters: Annotated[
        Mapping[str, float], Named(shape=Number(), example="{m: 1.0, g: 9.81}")
    ] = key(
        "Values of further names in the Lagrangian and in all expressions; can be swept.",
        default={},
    )
    lagrangian: Annotated[str, _FORMULA] = key(
        "L(q, v, t), kinetic minus potential energy.", unit="energy"
    )

    def own_names(self) -> tuple[str, ...]:
        """The coordinates."""
        check_names(self.coordinates, self.parameters)
        return self.coordinates
