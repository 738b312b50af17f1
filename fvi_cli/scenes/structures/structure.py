"""Scenes of structures that are given by their matrices."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, Unpack

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.matrices import Form, added, dense, is_sparse, scaled, times
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.chains import ground_force
from fvi_cli.scenes.data import SceneData, per_coordinate
from fvi_cli.scenes.named import linear_oscillator
from fvi_cli.scenes.structures.matrix_keys import matrix_of

LARGEST_MODAL: Final = 400
"""Degrees of freedom up to which damping is given by modes: its matrix is full."""


def structure(
    *,
    mass: object,
    stiffness: object,
    proportional: Mapping[str, Any] | None = None,
    modal_damping: Sequence[float] = (),
    ground_acceleration: Forcing | None = None,
    ground_direction: ArrayLike = 1.0,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of a structure by its matrices, shaken by the ground.

    .. math:: M x'' + \sum_j C_j D^{\gamma_j} x + (a M + b K) D^{\gamma} x
              + \sum_i 2 \zeta_i \omega_i (M \phi_i)(M \phi_i)^T x' + K x = f(t) - M r a(t)

    Parameters
    ----------
    mass, stiffness
        M and K: numbers, matrices or mappings of files.
    proportional
        ``mass``: a, ``stiffness``: b and ``order``: gamma; None: none.
    modal_damping
        Damping ratios :math:`\zeta_i` of the first modes :math:`\phi_i` of M and K.
    ground_acceleration
        a(t), one component; None: the ground rests.
    ground_direction
        r, shape ``(d,)`` or a number.

    Raises
    ------
    ValueError
        ``key: what is wrong``.
    """
    size = int(np.size(data["initial_position"]))
    sparse = any(is_sparse(matrix_of(one, 1)) for one in (mass, stiffness))
    m = matrix_of(mass, size, sparse=sparse)
    k = matrix_of(stiffness, size, sparse=sparse)
    damping = list(data.get("damping", ()))
    if proportional is not None:
        a, b = float(proportional["mass"]), float(proportional["stiffness"])
        together = added(scaled(m, a), scaled(k, b))
        damping.append(FractionalDamping(order=float(proportional["order"]), coefficient=together))
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
    r"""The matrix :math:`\sum_i 2 \zeta_i \omega_i (M \phi_i)(M \phi_i)^T`.

    Parameters
    ----------
    mass, stiffness
        M and K.
    ratios
        :math:`\zeta_i` of the modes with the lowest frequencies.

    Raises
    ------
    ValueError
        For more ratios than modes, and structures too large for a full matrix.
    """
    size = mass.shape[0]
    if size > LARGEST_MODAL:
        raise ArgumentError(
            "modal_damping",
            f"its matrix is full, {size} x {size} numbers; it is for up to "
            f"{LARGEST_MODAL} degrees of freedom; use proportional, or damping with a file",
        )
    if len(ratios) > size:
        raise ArgumentError("modal_damping", f"{len(ratios)} ratios for {size} modes")
    m, k = dense(mass), dense(stiffness)
    root = np.linalg.cholesky(m)
    reduced = np.linalg.solve(root, np.linalg.solve(root, k).T)
    values, vectors = np.linalg.eigh(0.5 * (reduced + reduced.T))
    total = np.zeros((size, size))
    for ratio, value, vector in zip(ratios, values, vectors.T, strict=False):
        push = root @ vector
        total += 2.0 * ratio * math.sqrt(max(float(value), 0.0)) * np.outer(push, push)
    return total
