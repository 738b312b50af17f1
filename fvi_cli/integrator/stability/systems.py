"""The independent linear systems of a scene."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import decouple_forms
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class MatrixPencil:
    r"""A homogeneous linear scene :math:`M x'' + \sum_j D_j D^{\gamma_j} x + K x = 0`."""

    mass: Array  # M, (d, d)
    stiffness: Array  # K
    damping: tuple[tuple[float, Array], ...]  # orders with their matrices, one per order

    @property
    def dimension(self) -> int:
        """Number d of components."""
        return int(self.mass.shape[0])


def matrix_pencil(scene: Scene) -> MatrixPencil:
    """Matrices of a linear scene, damping terms of one order added up."""
    sums: dict[float, Array] = {}
    for term in scene.active_damping:
        sums[term.order] = sums.get(term.order, 0.0) + term.matrix
    return MatrixPencil(
        mass=scene.inertia.mass,
        stiffness=scene.stiffness,
        damping=tuple((order, matrix) for order, matrix in sums.items() if np.any(matrix != 0)),
    )


def independent_systems(scene: Scene) -> tuple[MatrixPencil, ...]:
    """The independent linear systems of a scene, equal ones once; or itself, if it is coupled.

    All have the same orders of damping. If there are several, each has one component.
    """
    whole = matrix_pencil(scene)
    parts = decouple_forms(whole.mass, whole.stiffness, [form for _, form in whole.damping])
    if parts.batch == 1:
        return (whole,)
    orders = [order for order, _ in whole.damping]
    forms = (whole.mass, whole.stiffness, *(form for _, form in whole.damping))
    systems: dict[tuple[str, ...], MatrixPencil] = {}
    for mass, stiffness, *damping in zip(*map(parts.matrices, forms), strict=True):
        key = _digits((mass, stiffness, *damping))
        if key not in systems:
            pairs = tuple(zip(orders, damping, strict=True))
            systems[key] = MatrixPencil(mass=mass, stiffness=stiffness, damping=pairs)
    return tuple(systems.values())


def _digits(forms: Iterable[Array]) -> tuple[str, ...]:
    """A key, the same for systems that are equal up to round-off."""
    return tuple(f"{form[0, 0]:.12e}" for form in forms)
