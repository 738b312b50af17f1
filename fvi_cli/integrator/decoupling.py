r"""Coordinates in which a linear scene falls apart into independent systems.

When mass M, stiffness K and all damping directions D are simultaneously diagonalisable there are
modes :math:`\Phi` with :math:`\Phi^T M \Phi = 1` and diagonal :math:`\Phi^T K \Phi`,
:math:`\Phi^T D \Phi`, and the components of y in :math:`q = \Phi y` do not know of each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.damping import distinct_directions
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array

DIAGONAL_TOLERANCE = 1e-13


@dataclass(frozen=True, kw_only=True, eq=False)
class Decoupling:
    """How d components of a scene map to a batch of d systems of one component each."""

    mass: Array  # M, shape (d, d)
    modes: Array  # Phi, shape (d, d)

    def matrices(self, matrix: Array) -> Array:
        """A form of the scene (M, K or D) in the coordinates of the batch, ``(d, 1, 1)``."""
        return np.diagonal(self.modes.T @ matrix @ self.modes).copy()[:, None, None]

    def positions(self, values: Array) -> Array:
        """Positions ``(..., d)`` as ``(d, ..., 1)``."""
        return _split(values @ (self.mass @ self.modes))

    def forces(self, values: Array) -> Array:
        """Momenta and forces ``(..., d)`` as ``(d, ..., 1)``."""
        return _split(values @ self.modes)

    def scene_positions(self, values: Array) -> Array:
        """Positions ``(d, ..., 1)`` as ``(..., d)``."""
        return np.asarray(_join(values) @ self.modes.T)

    def scene_forces(self, values: Array) -> Array:
        """Momenta and forces ``(d, ..., 1)`` as ``(..., d)``."""
        return np.asarray(_join(values) @ (self.mass @ self.modes).T)


def decouple_forms(mass: Array, stiffness: Array, directions: Sequence[Array]) -> Decoupling | None:
    """Modes of the scene; None where it has none, or one component."""
    d = mass.shape[0]
    if d == 1:
        return None
    inverse = np.linalg.inv(np.linalg.cholesky(mass))
    reduced = [inverse @ form @ inverse.T for form in (stiffness, *directions)]
    scaled = [form / size for form in reduced if (size := float(np.abs(form).max())) > 0]
    # eigenvectors of a combination with unequal weights are common ones, unless these weights
    # make two eigenvalues equal by chance; then the check below fails, and all stays coupled
    mixed = sum(
        (np.sqrt(2.0 + 3.0 * index) * form for index, form in enumerate(scaled)),
        start=np.zeros((d, d)),
    )
    vectors = np.linalg.eigh(mixed)[1] if scaled else np.eye(d)
    for form in scaled:
        diagonal = vectors.T @ form @ vectors
        if np.abs(diagonal - np.diag(np.diagonal(diagonal))).max() > DIAGONAL_TOLERANCE * d:
            return None
    return Decoupling(mass=mass, modes=inverse.T @ vectors)


def linear_decoupling(scene: Scene) -> Decoupling | None:
    """The coordinates in which a scene falls apart; None where it does not, or is sparse."""
    if scene.is_sparse or not scene.is_linear:
        return None
    directions = [dense(matrix) for matrix in distinct_directions(scene.active_damping)]
    directions += [law.matrix for law in scene.active_laws]
    return decouple_forms(scene.inertia.mass, scene.stiffness, directions)


def _split(values: Array) -> Array:
    """Components first, each a system of its own: ``(..., d)`` to ``(d, ..., 1)``."""
    return np.moveaxis(values, -1, 0)[..., None]


def _join(values: Array) -> Array:
    """Systems as components, ``(d, ..., 1)`` to ``(..., d)``."""
    return np.ascontiguousarray(np.moveaxis(values[..., 0], 0, -1))
