"""Scenes of structures that are given by their matrices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Final, Unpack

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.matrices import Form, is_sparse, times
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.scalars import Number
from fvi_cli.keys.settings import NotNegative, Setting, key
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.chains import ground_force
from fvi_cli.scenes.data import SceneData, linear_oscillator, per_coordinate, scene_function
from fvi_cli.scenes.structures.matrix_keys import matrix_of
from fvi_cli.scenes.structures.rayleigh import Rayleigh, natural_modes, rayleigh_damping

LARGEST_MODAL: Final = 400
"""Most degrees of freedom for damping by modes, whose matrix is full."""


class Proportional(Setting):
    """Damping (a M + b K) D^gamma x."""

    mass: NotNegative = key("a.", unit="time^(gamma-2)", default=0.0)
    stiffness: NotNegative = key("b.", unit="time^gamma", default=0.0)
    order: Annotated[float, Number(above=0.0, below=2.0)] = key(
        "Order gamma of the derivative in the equation of motion; of laws in (0, 1) (no unit).",
        default=1.0,
    )


@scene_function
def structure(
    *,
    mass: object,
    stiffness: object,
    proportional: Proportional | None = None,
    modal_damping: Sequence[float] = (),
    rayleigh: Rayleigh | None = None,
    ground_acceleration: Forcing | str | None = None,
    ground_direction: ArrayLike = 1.0,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of a structure by its matrices, shaken by the ground.

    .. math:: M x'' + \sum_j C_j D^{\gamma_j} x + (a M + b K) D^{\gamma} x
              + \sum_i 2 \zeta_i \omega_i (M \phi_i)(M \phi_i)^T x' + K x = f(t) - M r a(t)

    `mass` and `stiffness` are numbers, matrices or mappings of files, `modal_damping` the ratios
    :math:`\zeta_i` of the first modes :math:`\phi_i` of M and K; a(t) has one component, r has
    shape ``(d,)`` or is a number.
    """
    found = [matrix_of(one, 1) for one in (mass, stiffness)]
    given = np.size(data.get("initial_position", 0.0))
    size = max(int(given), *(one.shape[0] for one in found))
    sparse = any(map(is_sparse, found))
    m = matrix_of(mass, size, sparse=sparse)
    k = matrix_of(stiffness, size, sparse=sparse)
    damping = list(data.get("damping", ()))
    if proportional is not None:
        together = proportional.mass * m + proportional.stiffness * k
        damping.append(FractionalDamping(order=proportional.order, coefficient=together))
    if rayleigh is not None:
        damping.append(rayleigh_damping(m, k, rayleigh.ratios, rayleigh.modes))
    if modal_damping:
        damping.append(FractionalDamping(order=1.0, coefficient=modal_matrix(m, k, modal_damping)))
    if ground_acceleration is not None:
        along = per_coordinate(ground_direction, size)
        if along.shape != (size,):
            raise ArgumentError(
                "ground_direction", f"{along.size} entries for {size} degrees of freedom"
            )
        data["forcing"] = ground_force(ground_acceleration, times(along, m))
    data["damping"] = damping
    return linear_oscillator(mass=m, stiffness=k, **data)


def modal_matrix(mass: Form, stiffness: Form, ratios: Sequence[float]) -> Array:
    r"""The matrix :math:`\sum_i 2 \zeta_i \omega_i (M \phi_i)(M \phi_i)^T`."""
    size = mass.shape[0]
    if size > LARGEST_MODAL:
        raise ArgumentError(
            "modal_damping",
            f"its matrix is full, {size} x {size} numbers; it is for up to "
            f"{LARGEST_MODAL} degrees of freedom; use proportional, or damping with a file",
        )
    if len(ratios) > size:
        raise ArgumentError("modal_damping", f"{len(ratios)} ratios for {size} modes")
    values, pushes = natural_modes(mass, stiffness)
    total = np.zeros((size, size))
    for ratio, value, push in zip(ratios, values, pushes.T, strict=False):
        total += 2.0 * ratio * math.sqrt(max(float(value), 0.0)) * np.outer(push, push)
    return total
