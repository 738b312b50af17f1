"""Symmetries of a scene, and the momenta that are conserved with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array, set_arrays

TRIALS = 16  # random states at which a symmetry is tested


@dataclass(frozen=True, kw_only=True, eq=False)
class Symmetry:
    r"""The flow of :math:`\xi(q) = G q + g`, with the momentum map :math:`J = p \cdot \xi(q)`.

    A turn has a skew matrix G, a translation the vector g alone (Marsden, West, *Discrete
    mechanics and variational integrators*, Acta Numerica 2001, section 1.2.3).

    Raises
    ------
    ValueError
        For sizes that do not match, entries that are not finite, or a flow that stands still.
    """

    name: str  # name of the momentum in files and figures
    generator: Array  # G, shape (d, d)
    shift: Array  # g, shape (d,)

    def __post_init__(self) -> None:
        set_arrays(self, generator=self.generator, shift=np.atleast_1d(self.shift))
        generator, shift = self.generator, self.shift
        d = shift.size
        if generator.shape != (d, d) or shift.shape != (d,):
            raise ValueError(
                f"symmetry {self.name}: a {d} x {d} generator is needed beside {d} shifts"
            )
        if not (np.isfinite(generator).all() and np.isfinite(shift).all()):
            raise ValueError(f"symmetry {self.name}: every entry must be finite")
        if not (np.any(generator) or np.any(shift)):
            raise ValueError(f"symmetry {self.name}: generator and shift are zero")

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return int(self.shift.size)

    def direction(self, position: Array) -> Array:
        r""":math:`\xi(q)`, shape ``(..., d)`` to the same."""
        return position @ self.generator.T + self.shift

    def momentum(self, position: Array, momentum: Array) -> Array:
        """The momentum map J, shapes ``(..., d)`` to ``(...)``."""
        return np.asarray(np.einsum("...i,...i->...", momentum, self.direction(position)))


def symmetry_defect(scene: Scene, symmetry: Symmetry) -> float:
    r"""How much the Lagrangian without forcing changes along the flow, relative to its parts.

    .. math:: \max \frac{|\partial_q L \cdot \xi(q) + \partial_v L \cdot G v|}
                        {|\partial_q L|\,|\xi(q)| + |\partial_v L|\,|G v|}

    over 16 positions and velocities around the start; round-off for a symmetry, about 1 otherwise.
    """
    random = np.random.default_rng(12)
    shape = (TRIALS, scene.dimension)
    q0, v0 = scene.initial_position, scene.initial_velocity
    reach = max(float(np.abs(q0).max()), 1e-3) * 0.5
    speed = max(float(np.abs(v0).max()), 1.0)
    position = q0 + reach * random.standard_normal(shape)
    velocity = v0 + speed * random.standard_normal(shape)
    time = scene.final_time * random.random(TRIALS)
    momentum, force = scene.forces(position, velocity, time)
    along, turned = symmetry.direction(position), velocity @ symmetry.generator.T
    change = np.einsum("ni,ni->n", force, along) + np.einsum("ni,ni->n", momentum, turned)
    size = np.einsum("ni,ni->n", np.abs(force), np.abs(along))
    size += np.einsum("ni,ni->n", np.abs(momentum), np.abs(turned))
    # where all terms are zero the defect is zero
    parts = np.linalg.norm(force, axis=1) * np.linalg.norm(along, axis=1) + size
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.where(parts > 0, np.abs(change) / parts, 0.0)
    return float(relative.max())
