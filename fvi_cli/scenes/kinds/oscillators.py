"""One mass or a few, and systems by their Lagrangian."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from fvi_cli.scenes.data import duffing, kepler, pendulum
from fvi_cli.scenes.keys.values import NotNegative, Pair, Positive, key
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.kinds.laws import Term
from fvi_cli.scenes.lagrangian import double_pendulum, lagrangian_scene
from fvi_cli.scenes.records.matrices import NumberOrMatrix, PositiveOrMatrix
from fvi_cli.scenes.structures import structure


class DampedOscillator(SceneKind):
    """A linear equation."""

    equation = "M x'' + sum mu D^gamma x + K x = f(t)"
    make = staticmethod(structure)
    kind: Literal["damped-oscillator"] = key("Which equation.", "damped-oscillator")
    mass: PositiveOrMatrix = key(
        "M: a number, a symmetric positive definite matrix or {file: M.mtx}.",
        1.0,
        unit="unit of mass",
    )
    stiffness: NumberOrMatrix = key(
        "K: a number, a symmetric matrix or {file: K.mtx}.", 1.0, unit="mass per time^2"
    )


class BagleyTorvik(DampedOscillator):
    """A linear equation with damping of order 1/2 or 3/2."""

    kind: Literal["bagley-torvik"] = key("Which equation.", "bagley-torvik")  # type: ignore[assignment]


class Pendulum(SceneKind):
    """A rod that turns around a fixed point."""

    equation = "x'' + sum mu D^gamma x + omega^2 sin x = f(t)"
    make = staticmethod(pendulum)
    names = ("x",)
    kind: Literal["pendulum"] = key("Which equation.", "pendulum")
    omega: NotNegative = key("Angular frequency of small oscillations.", 1.0, unit="1/time")


class Duffing(SceneKind):
    """A spring that hardens or softens, or a double well."""

    equation = "mass x'' + sum mu D^gamma x + stiffness x + cubic_stiffness x^3 = f(t)"
    make = staticmethod(duffing)
    names = ("x",)
    kind: Literal["duffing"] = key("Which equation.", "duffing")
    mass: Positive = key("Mass.", 1.0, unit="unit of mass")
    stiffness: float = key(
        "k of the linear force k x; negative for a double well.", 1.0, unit="mass per time^2"
    )
    cubic_stiffness: float = key(
        "Factor of x^3 in the force.", 1.0, unit="mass per time^2 and length^2"
    )


class Kepler(SceneKind):
    """A mass in the plane around a centre that attracts it."""

    equation = "q'' + sum mu D^gamma q + attraction q/|q|^3 = f(t), q = (x, y)"
    make = staticmethod(kepler)
    names = ("x", "y")
    kind: Literal["kepler"] = key("Which equation.", "kepler")
    attraction: float = key(
        "k of the force k q/|q|^3 on a unit mass.", 1.0, unit="length^3 per time^2"
    )


class DoublePendulum(SceneKind):
    """Two rods in a row with damped joints."""

    equation = (
        "two rods, angles theta1, theta2 from the vertical; the joints turn "
        "against c D^gamma of theta1 and of theta2 - theta1"
    )
    make = staticmethod(double_pendulum)
    names = ("theta1", "theta2")
    dampers_key = "joints"
    kind: Literal["double-pendulum"] = key("Which equation.", "double-pendulum")
    masses: Pair[Positive] = key(
        "Point masses at the ends of the first and the second rod.",
        [1.0, 1.0],
        unit="unit of mass",
    )
    lengths: Pair[Positive] = key("Lengths of the rods.", [1.0, 1.0], unit="length")
    gravity: float = key("Acceleration of free fall.", 1.0, unit="length per time^2")
    joints: list[Term] = key("Dampers, c D^gamma or any law, in both joints.", [])


class LagrangianKind(SceneKind):
    """Any mechanical system, by the formula of its Lagrangian."""

    equation = "d/dt dL/dv - dL/dq + sum mu D^gamma q = f(t)"
    kind: Literal["lagrangian"] = key("Which equation.", "lagrangian")
    coordinates: Annotated[list[str], Field(min_length=1, max_length=100)] = key(
        "Names of the coordinates q; the velocity of x is vx."
    )
    lagrangian: str = key(
        "L(q, v, t), kinetic minus potential energy: an expression in coordinates, velocities, "
        "parameters and t.",
        unit="energy",
    )

    def coordinate_names(self) -> tuple[str, ...]:
        """The coordinates."""
        return tuple(self.coordinates)

    def own(self) -> dict[str, Any]:
        """The values of its own keys."""
        return {**super().own(), "parameters": self.parameters}

    make = staticmethod(lagrangian_scene)
