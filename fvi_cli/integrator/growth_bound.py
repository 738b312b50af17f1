"""When a run is far outside of all motions that its scene permits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.matrices import is_semidefinite, is_sparse
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.failure import Failure
from fvi_cli.mathematics.arrays import Array, Mask
from fvi_cli.mathematics.transforms.zeros import largest_root

TOLERATED_FACTOR = 1e8
"""Factor by which a position may exceed the distance that start values and forces can cause."""

TOLERATED_ENERGY = 1e12
"""Factor by which a nonlinear scene may gain more energy than start, forces and potential give."""

PERMITTED_ENERGY = 4.0
"""A run with more than 4 times the energy that its scene permits is wrong: twice the amplitude."""

GAINS_ENERGY = "unstable: its energy rises to "
"""How the remark on a run begins; it is left out where growth was predicted."""

FLEXIBILITY_SWEEPS = 10  # power iterations

POORLY_RESOLVED = 1.25
"""A poorly resolved mode may grow this many times faster than the exact one (a guess)."""

SHARES = np.concatenate([np.linspace(0.0, 1.0, 65), 2.0 ** -np.arange(7.0, 60.0)])
"""Where a potential is evaluated between the start and a point, as shares of the distance."""

PROBED_FRACTIONS = (np.arange(64) + 0.5) / 64
"""Places where forces are evaluated, as shares of every interval between break points."""


@dataclass(frozen=True, kw_only=True)
class GrowthBound:
    r"""The bound :math:`|x(t)| \le C e^{\sigma t}` that no sound run leaves."""

    # C: 1e8 times the sum of start position, distance at the start velocity and distance under the
    # largest force; infinite for a scene at rest without forces
    size: float
    # a bound on the growth of the exact linear scene and a quarter more; 0 for a nonlinear one
    rate: float
    per_force: float = 0.0  # what a unit of the largest force adds to C
    force: float = 0.0  # the largest force
    # a nonlinear scene, which may exceed C: then its energy decides
    scene: Scene | None = None

    def with_force(self, force: float) -> GrowthBound:
        """The bound for a larger force, met during the run: `scene_bound` may miss a pulse."""
        return replace(self, size=self.size + self.per_force * force, force=max(self.force, force))

    def outside(self, position: Array, momentum: Array, times: Array) -> Mask:
        """Which of successive points, shapes ``(n, d)`` and ``(n,)``, no sound run reaches."""
        with np.errstate(all="ignore"):
            found: Mask = np.abs(position).max(axis=1, initial=0.0) > self.at(times)
            if self.scene is not None and found.any():
                found[found] = self._gains_too_much(
                    self.scene, position[found], momentum[found], times[found]
                )
        return found

    def _gains_too_much(self, scene: Scene, position: Array, momentum: Array, times: Array) -> Mask:
        r"""Whether the energy is far above what start, forces and potential can give.

        .. math:: H(x, p, t) - H_0 > 10^{12} \bigl(T_0 + (|\nabla V(x_0)| + F) c
                  + \max(V(x_0) - V) + |V(x, t) - V(x, 0)|\bigr)

        with the length :math:`c = 10^{-8} C` and V over the points and the straight lines to them.
        """
        start = scene.initial_position
        rest = np.zeros_like(start)

        def potential(x: Array, t: Array | float) -> Array:
            if scene.lagrangian is not None:
                return -scene.lagrangian.lagrangian(x, np.zeros_like(x), t)
            return scene.potential_energy(x)

        level = float(potential(start, 0.0))
        impulse = scene.momentum(start, scene.initial_velocity, 0.0)
        begun = float(scene.energy(start, impulse, 0.0))
        force = np.abs(scene.forces(start, rest, np.asarray(0.0))[1]).max() + self.force
        given = begun - level + force * self.size / TOLERATED_FACTOR
        here = potential(position, times)
        given = abs(given) + np.maximum(level - np.fmin.accumulate(here), 0.0)
        given = given + np.abs(here - potential(position, 0.0))
        gain = scene.energy(position, momentum, times) - begun
        too_much: Mask = gain > TOLERATED_ENERGY * given
        for index in np.flatnonzero(too_much):
            between = start + SHARES[:, None] * (position[index] - start)
            drop = level - np.nanmin(potential(between, times[index]))
            if not gain[index] <= TOLERATED_ENERGY * (given[index] + max(drop, 0.0)):
                break
            too_much[index] = False
        return too_much

    def at(self, time: Array) -> Array:
        """The bound at each time."""
        with np.errstate(over="ignore"):
            return np.asarray(self.size * np.exp(self.rate * time))


def beyond(
    position: Array, velocity: Array, bound: GrowthBound, n_done: int, step_size: float
) -> Failure | None:
    """Why a run ends at this position after `n_done` steps; None if it continues."""
    size, time = float(np.abs(position).max()), n_done * step_size
    if not math.isfinite(size):
        return Failure.not_finite(n_done - 1, time)
    if size <= bound.size:
        return None
    momentum = velocity if bound.scene is None else velocity @ bound.scene.inertia.mass
    found = first_outside(bound, position[None], momentum[None], np.array([time]), n_done - 1)
    return None if found is None else found[1]


def growth_limit(scene: Scene) -> float:
    r"""A bound on Re s of all modes of a linear scene with dense matrices; 0: no mode grows.

    For a mode x with :math:`x^* M x = 1` and :math:`\sigma = \mathrm{Re}\, s > 0` the real part of
    :math:`x^* (s M + \sum_j s^{\gamma_j - 1} D_j + K / s) x = 0` gives

    .. math:: \sigma^2 \le k^- + \sum_{\gamma_j \le 1} d_j^- \sigma^{\gamma_j}
              + \sigma \sum_{\gamma_j > 1} d_j^- S^{\gamma_j - 1}, \qquad
              |s| \le S, \quad S^2 = \|K\| + \sum_j \|D_j\| S^{\gamma_j},

    with the sizes :math:`k^-, d_j^-` of the negative eigenvalues relative to M.
    """
    if scene.is_dissipative:
        return 0.0
    root = np.linalg.inv(np.linalg.cholesky(scene.inertia.mass))
    pairs = [*((one.order, one.matrix) for one in scene.active_damping), (0.0, scene.stiffness)]
    values = [np.linalg.eigvalsh(root @ form @ root.T) for _, form in pairs]
    orders = np.array([order for order, _ in pairs])
    sizes = np.array([np.abs(one).max() for one in values])
    negative = np.array([max(-one[0], 0.0) for one in values])
    largest = largest_root(orders, sizes)
    is_high = orders > 1
    high = float((negative[is_high] * largest ** (orders[is_high] - 1.0)).sum())
    return largest_root(np.append(orders[~is_high], 1.0), np.append(negative[~is_high], high))


def scene_bound(scene: Scene) -> GrowthBound:
    """The bound of a run of `scene`, from its own data."""
    force = 0.0
    if scene.forcing is not None:
        ends = np.array([0.0, *scene.break_points, scene.final_time])
        inside = (ends[:-1, None] + np.diff(ends)[:, None] * PROBED_FRACTIONS).ravel()
        with np.errstate(all="ignore"):
            values = np.abs(scene.forcing(inside))
        force = float(values[np.isfinite(values)].max(initial=0.0))
    least, per_force = least_bound(scene)
    size, rate = least + per_force * force, 0.0
    if scene.is_sparse or (scene.is_linear and scene.active_laws):
        # growth is not computed for large structures and with laws: then there is no bound
        size = size if scene.is_dissipative else math.inf
    elif scene.is_linear:
        rate = POORLY_RESOLVED * growth_limit(scene)
    elif not all(is_semidefinite(term.form) for term in scene.active_forces):
        # damping may supply energy without limit
        size = math.inf
    return GrowthBound(
        size=size if 0 < size < math.inf else math.inf,
        rate=rate,
        per_force=per_force,
        force=force,
        scene=None if scene.is_linear else scene,
    )


def _largest_flexibility(inertia: Inertia) -> float:
    """Largest eigenvalue of the inverse mass; estimated by a few iterations if it is sparse."""
    if not is_sparse(inertia.form):
        return float(np.linalg.norm(np.linalg.inv(inertia.mass), 2))
    vector = np.random.default_rng(1).standard_normal(inertia.dimension)
    size = 0.0
    for _ in range(FLEXIBILITY_SWEEPS):
        vector = vector / np.linalg.norm(vector)
        vector = inertia.velocity(vector)
        size = float(np.linalg.norm(vector))
    return size


def first_outside(
    bound: GrowthBound, position: Array, momentum: Array, times: Array, done: int
) -> tuple[int, Failure] | None:
    """The first position outside of `bound`, with the failure; None if all are inside.

    Takes successive points, ``(n, d)``, ``(n, d)`` and ``(n,)``, after `done` steps.
    """
    outside = bound.outside(position, momentum, times)
    if not outside.any():
        return None
    index = int(outside.argmax())
    size, step, time = float(np.abs(position[index]).max()), done + index, float(times[index])
    words = (
        f"diverged: |x| = {size:.3g} after step {step}, t = {time:.6g}, is "
        f"{TOLERATED_FACTOR:.0e} times beyond what the scene can do"
    )
    return index, Failure(words, "diverged", step, time)


def least_bound(scene: Scene) -> tuple[float, float]:
    r"""C of :class:`GrowthBound` without forces, and what a unit of the largest force adds to it.

    A position that is smaller is inside of the bound at any time.
    """
    scale = float(np.abs(scene.initial_position).max())
    scale += scene.final_time * float(np.abs(scene.initial_velocity).max())
    per_force = 0.0
    if scene.forcing is not None:
        per_force = scene.final_time**2 * _largest_flexibility(scene.inertia)
    return TOLERATED_FACTOR * scale, TOLERATED_FACTOR * per_force


def energy_remarks(
    scene: Scene, position: Array, energy: Array, largest_force: float
) -> tuple[str, ...]:
    r"""Remark on a run that has far more energy than its scene permits; empty for others.

    With damping forces that only dissipate energy

    .. math:: \sqrt{E(t) - V_0} \le \sqrt{E(0) - V_0} + F t \sqrt{d / (2 m)}

    with the least potential energy :math:`V_0` along the motion, the largest entry F of the forcing
    and the least eigenvalue m of the mass. It does not hold for derivatives of order above 1 that
    begin with a velocity, nor for Riemann-Liouville derivatives, whose start gives energy.
    """
    starts_free = scene.derivative == "caputo" and (
        not scene.initial_velocity.any() or all(one.order <= 1 for one in scene.active_damping)
    )
    own = scene.lagrangian
    if own is not None and (own.depends_on_time or scene.forcing is not None):
        return ()
    if not starts_free or not energy.size or energy.max() <= energy[0]:
        return ()
    with np.errstate(all="ignore"):
        level = scene.potential_energy(position)
        if own is not None:
            level = -own.lagrangian(position, np.zeros_like(position), 0.0)
        least = float(level.min())
        push = largest_force * scene.final_time * math.sqrt(0.5 * scene.dimension)
        push *= math.sqrt(_largest_flexibility(scene.inertia)) if push else 0.0
        permitted = (math.sqrt(max(float(energy[0]) - least, 0.0)) + push) ** 2
        reached = float(energy.max()) - least
    if not 0 < PERMITTED_ENERGY * permitted < reached:
        return ()
    if not all(is_semidefinite(one.form) for one in scene.active_forces):
        return ()
    return (
        f"{GAINS_ENERGY}{reached / permitted:.2g} times what the start and the forces of the scene "
        "permit; take shorter steps, or rk: gauss",
    )
