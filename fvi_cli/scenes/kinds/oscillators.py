"""One mass or a few: linear equations, the pendulum, Duffing's equation, Kepler's problem."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Final, Unpack

import numpy as np

from fvi_cli.effects.matrices import is_sparse
from fvi_cli.effects.scene import Scene
from fvi_cli.keys.settings import NotNegative, Positive, key
from fvi_cli.scenes.data import SceneData
from fvi_cli.scenes.kinds.damping_keys import DAMPING, NUMBER_OR_SYMMETRIC, Term, damping_terms
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.kinds.shared_keys import MASS_MATRIX
from fvi_cli.scenes.named import linear_oscillator, pendulum
from fvi_cli.scenes.nonlinear import duffing, kepler
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
    """A linear equation with damping of order 3/2, where nothing else is said."""

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


class Duffing(SceneKind):
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
