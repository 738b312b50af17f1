"""Structures given by matrices of finite-element programs."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Final

from fvi_cli.keys.containers import ByForm, ListOf
from fvi_cli.keys.scalars import Number
from fvi_cli.keys.settings import key
from fvi_cli.scenes.forces import GROUND_ACCELERATION, GroundMotion
from fvi_cli.scenes.kinds.damping_keys import NUMBER_OR_SYMMETRIC
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.kinds.shared_keys import MASS_MATRIX, MOST_COORDINATES
from fvi_cli.scenes.structures.rayleigh import Rayleigh
from fvi_cli.scenes.structures.structure import structure

_DIRECTION: Final = ByForm(
    single=Number(), several=ListOf(shape=Number(), most=MOST_COORDINATES, example="[1, 0]")
)


class Structure(SceneKind):
    """A structure by its matrices."""

    kind = "structure"
    equation = "M x'' + sum mu D^gamma x + K x = f(t) - M r a(t)"
    make = staticmethod(structure)
    forces = ("forcing", "ground_acceleration")
    example: ClassVar = {
        "mass": "[[2.0, 0.0], [0.0, 1.0]]",
        "stiffness": "[[300.0, -100.0], [-100.0, 100.0]]",
        "damping": "[{order: 0.5, coefficient: 4.0, acts_on: [x2 - x1]}]",
        "rayleigh": "{mass: 0.1, stiffness: 0.001, order: 0.5}",
        "ground_acceleration": "t**3*exp(-t)*sin(3*t)",
        "final_time": "4.0",
    }
    sweep = "problem.damping.0.coefficient: [0.5, 1.0, 2.0]"

    mass: Annotated[Any, MASS_MATRIX] = key(
        "M: a matrix, {file: M.mtx} or a number.", unit="unit of mass"
    )
    stiffness: Annotated[Any, NUMBER_OR_SYMMETRIC] = key(
        "K: a matrix, {file: K.mtx} or a number.", unit="mass per time^2"
    )
    rayleigh: Rayleigh | None = key(
        "Damping (a M + b K) D^gamma x, by its factors or by the ratios of two modes of M and K.",
        default=None,
    )
    ground_acceleration: GroundMotion = GROUND_ACCELERATION
    ground_direction: Annotated[float | tuple[float, ...], _DIRECTION] = key(
        "r: how far every coordinate goes with a ground that moves by 1.", default=1.0
    )
