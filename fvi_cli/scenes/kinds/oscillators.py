"""One mass or a few: linear equations, nonlinear ones, and systems by their Lagrangian."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Final, Unpack

import numpy as np

from fvi_cli.effects.matrices import is_sparse
from fvi_cli.effects.scene import Scene
from fvi_cli.keys.containers import ListOf, Named
from fvi_cli.keys.scalars import Number, Text
from fvi_cli.keys.settings import NotNegative, Positive, key
from fvi_cli.scenes.data import Damper, SceneData, duffing, kepler, linear_oscillator, pendulum
from fvi_cli.scenes.kinds.damping_keys import DAMPING, NUMBER_OR_SYMMETRIC, Term, damping_terms
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.kinds.shared_keys import MASS_MATRIX, WRONG_AT_PROBLEM, dampers
from fvi_cli.scenes.lagrangian import check_names, double_pendulum, lagrangian_scene
from fvi_cli.scenes.structures.matrix_keys import file_form, matrix_of

_LINEAR: Final = "M x'' + sum mu D^gamma x + K x = f(t)"
MassMatrix = Annotated[Any, MASS_MATRIX]
Stiffness = Annotated[Any, NUMBER_OR_SYMMETRIC]
_MASS: Final = key(
    "M: a number, a symmetric positive definite matrix or {file: M.mtx}.",
    unit="unit of mass",
    default=1.0,
)
_STIFFNESS: Final = key(
    "K: a number, a symmetric matrix or {file: K.mtx}.", unit="mass per time^2", default=1.0
)


def _linear(mass: object, stiffness: object, **data: Unpack[SceneData]) -> Scene:
    size = np.size(data["initial_position"])
    sparse = any(is_sparse(file_form(one)) for one in (mass, stiffness))
    return linear_oscillator(
        mass=matrix_of(mass, size, sparse=sparse),
        stiffness=matrix_of(stiffness, size, sparse=sparse),
        **data,
    )


class DampedOscillator(SceneKind):
    """A linear equation."""

    kind = "damped-oscillator"
    equation = _LINEAR
    make = staticmethod(_linear)
    example: ClassVar = {
        "damping": "[{order: 1.0, coefficient: 0.2}]",
        "initial": "{position: 0.0, velocity: 1.0}",
        "final_time": "16.0",
    }
    sweep = "problem.damping.0.order: {from: 0.1, to: 1.9, number: 10}, problem.stiffness: [1, 10]"

    mass: MassMatrix = _MASS
    stiffness: Stiffness = _STIFFNESS


class BagleyTorvik(SceneKind):
    """A linear equation with damping of order 3/2, by default."""

    kind = "bagley-torvik"
    title = "Bagley–Torvik"
    equation = _LINEAR
    make = staticmethod(_linear)
    example: ClassVar = {
        "damping": "[{order: 1.5, coefficient: 1.0}]",
        "forcing": "15/4*sqrt(t) + 15/8*sqrt(pi)*t + t**2.5",
        "initial": "{position: 0.0, velocity: 0.0}",
        "final_time": "1.0",
        "exact": "t**2.5",
    }
    sweep = "problem.stiffness: {from: 1, to: 100, number: 5, spacing: log}"

    mass: MassMatrix = _MASS
    stiffness: Stiffness = _STIFFNESS
    damping: Annotated[tuple[Term, ...], damping_terms(1.5)] = DAMPING


class Pendulum(SceneKind):
    """A rod that turns around a fixed point."""

    kind = "pendulum"
    equation = "x'' + sum mu D^gamma x + omega^2 sin x = f(t)"
    make = staticmethod(pendulum)
    size = 1
    size_key = "omega"
    example: ClassVar = {
        "damping": "[{order: 0.5, coefficient: 0.3}]",
        "initial": "{position: 1.0, velocity: 0.0}",
        "final_time": "20.0",
    }
    sweep = "problem.initial.position: [0.1, 1.0, 3.0]"

    omega: NotNegative = key("Angular frequency of small oscillations.", unit="1/time", default=1.0)


_DUFFING: Final = (
    "not a key: x'' + delta x' + alpha x + beta x^3 = f(t) is written damping: [{order: 1, "
    "coefficient: delta}], stiffness: alpha, cubic_stiffness: beta"
)


class Duffing(
    SceneKind,
    refused={**WRONG_AT_PROBLEM, **dict.fromkeys(("alpha", "beta", "delta"), _DUFFING)},
):
    """A spring that hardens or softens, or a double well."""

    kind = "duffing"
    equation = "mass x'' + sum mu D^gamma x + stiffness x + cubic_stiffness x^3 = f(t)"
    make = staticmethod(duffing)
    size = 1
    example: ClassVar = {
        "damping": "[{order: 0.5, coefficient: 0.2}]",
        "initial": "{position: 1.0, velocity: 0.0}",
        "final_time": "10.0",
    }
    sweep = "problem.cubic_stiffness: [0.1, 1.0, 10.0]"

    mass: Positive = key("Mass.", unit="unit of mass", default=1.0)
    stiffness: float = key(
        "k of the linear force k x; negative for a double well.",
        unit="mass per time^2",
        default=1.0,
    )
    cubic_stiffness: float = key(
        "Factor of x^3 in the force.", unit="mass per time^2 and length^2", default=1.0
    )


class Kepler(SceneKind):
    """A mass in the plane around a centre that attracts it."""

    kind = "kepler"
    equation = "q'' + sum mu D^gamma q + attraction q/|q|^3 = f(t), q = (x, y)"
    make = staticmethod(kepler)
    size = 2
    names = ("x", "y")
    example: ClassVar = {
        "damping": "[{order: 0.5, coefficient: 0.01}]",
        "initial": "{position: [1.0, 0.0], velocity: [0.0, 1.0]}",
        "final_time": "10.0",
    }
    sweep = "problem.damping.0.coefficient: [0.0, 0.01, 0.1]"

    attraction: float = key(
        "k of the force k q/|q|^3 on a unit mass.", unit="length^3 per time^2", default=1.0
    )


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
    """Any mechanical system, by the formula of its Lagrangian."""

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
