"""Structures given by matrices of finite-element programs."""

from __future__ import annotations

from typing import Annotated, Literal

from fvi_cli.scenes.forces import GROUND_ACCELERATION, TimeFunction
from fvi_cli.scenes.keys.values import BY_FORM, key
from fvi_cli.scenes.kinds.kind import Forced
from fvi_cli.scenes.structures.matrix_keys import NumberOrMatrix, PositiveOrMatrix, Vector
from fvi_cli.scenes.structures.rayleigh import Rayleigh
from fvi_cli.scenes.structures.structure import structure


class Structure(Forced):
    """A structure by its matrices."""

    equation = "M x'' + sum mu D^gamma x + K x = f(t) - M r a(t)"
    make = staticmethod(structure)
    forces = ("forcing", "ground_acceleration")
    kind: Literal["structure"] = key("Which equation.", "structure")
    mass: PositiveOrMatrix = key("M: a matrix, {file: M.mtx} or a number.", unit="unit of mass")
    stiffness: NumberOrMatrix = key(
        "K: a matrix, {file: K.mtx} or a number.", unit="mass per time^2"
    )
    rayleigh: Rayleigh | None = key(
        "Damping (a M + b K) D^gamma x, by its factors or by the ratios of two modes of M and K.",
        None,
    )
    ground_acceleration: TimeFunction = GROUND_ACCELERATION
    ground_direction: Annotated[float | list[float] | Vector, BY_FORM] = key(
        "r: how far every coordinate goes with a ground that moves by 1; a list that is shorter is "
        "a pattern, which is repeated.",
        1.0,
    )
