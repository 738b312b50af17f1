"""Scenes of structures that are given by their matrices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.matrices import is_sparse, times
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.chains import ground_force
from fvi_cli.scenes.data import SceneData, linear_oscillator, scene_function
from fvi_cli.scenes.records.inputs import kept_numbers
from fvi_cli.scenes.structures.matrix_keys import Vector, matrix_of
from fvi_cli.scenes.structures.rayleigh import Rayleigh, rayleigh_damping


@scene_function
def structure(
    *,
    mass: object,
    stiffness: object,
    rayleigh: Rayleigh | None = None,
    ground_acceleration: Forcing | str | None = None,
    ground_direction: ArrayLike | Vector = 1.0,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of a structure by its matrices, shaken by the ground.

    .. math:: M x'' + \sum_j C_j D^{\gamma_j} x + (a M + b K) D^{\gamma} x
              + K x = f(t) - M r a(t)

    `mass` and `stiffness` are numbers, matrices or mappings of files, `rayleigh` gives a, b and
    :math:`\gamma`; a(t) has one component. r has shape ``(d,)``, or is a number or a pattern that
    is repeated: ``[1, 0]`` shakes the first of the two coordinates of every node.
    """
    found = [matrix_of(one, 1) for one in (mass, stiffness)]
    given = np.size(data.get("initial_position", 0.0))
    size = max(int(given), *(one.shape[0] for one in found))
    sparse = any(map(is_sparse, found))
    m = matrix_of(mass, size, sparse=sparse)
    k = matrix_of(stiffness, size, sparse=sparse)
    damping = list(data.get("damping", ()))
    if rayleigh is not None:
        damping.append(rayleigh_damping(m, k, rayleigh))
    if ground_acceleration is not None:
        along = ground_shares(ground_direction, size)
        data["forcing"] = ground_force(ground_acceleration, times(along, m))
    data["damping"] = damping
    return linear_oscillator(mass=m, stiffness=k, **data)


def ground_shares(direction: ArrayLike | Vector | Mapping[str, Any], size: int) -> Array:
    """The share r of the ground's motion in every coordinate, by a number, a pattern or a file.

    Raises
    ------
    ArgumentError
        If a pattern does not fit the number of coordinates.
    """
    if isinstance(direction, Mapping):
        direction = kept_numbers(str(direction["digest"]))
    elif isinstance(direction, Vector):
        direction = direction.numbers
    pattern = np.atleast_1d(np.asarray(direction, dtype=float)).ravel()
    if pattern.size == 0 or size % pattern.size:
        raise ArgumentError(
            "ground_direction",
            f"{pattern.size} entries for {size} degrees of freedom; write one for each, or a "
            "pattern that is repeated",
        )
    return np.tile(pattern, size // pattern.size)
