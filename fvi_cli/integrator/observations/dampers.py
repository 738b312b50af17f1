r"""Force, deformation and work of single dampers along a motion.

The entry k of ``damping`` and ``dampers`` acts along :math:`y = B q`, the combinations under
``acts_on`` or the coordinates themselves, with the force

.. math:: f = \mu D^\gamma y \quad\text{or}\quad f = \mu\,\bigl(G_0\,y + g\,k * \dot y\bigr)

of the sign of the deformation; on the coordinates acts :math:`-B^T f`. The part of the force with
memory is that of the method, from :math:`\dot y` at the stages; between them it is the polynomial
through its values there. The work is that of the part with memory,
:math:`W(t) = \int_0^t (f - \mu G_0 y) \cdot \dot y\, ds`, so that the works of all dampers add up
to the loss of energy; its integral over whole steps is the quadrature of the method.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, cast

import numpy as np
from numpy.polynomial import chebyshev

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import is_sparse, sparse_unit, times
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.singular_start import rate_jumps
from fvi_cli.integrator.observations.motion import DenseMotion, join_series, stage_series
from fvi_cli.integrator.observations.pieces import by_owner
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.series.chebyshev import evaluate_series

MOST_COMPONENTS = 1000
"""Most components of a damper that have names of their own."""

TOGETHER = -1
"""Place of all dampers of a scene with a given motion, which share its one coordinate."""

DamperForce = FractionalDamping | Law


@dataclass(frozen=True, kw_only=True)
class DamperValue:
    """The meaning of a name: a component of the force or deformation of a damper, or its work."""

    kind: Literal["force", "deformation", "work"]
    place: int  # among the dampers of the scene, from 0
    component: int = 0


def dampers_of(scene: Scene) -> tuple[tuple[DamperForce, ...], ...]:
    """Dampers in the order of their numbers, each with the terms and laws on one deformation.

    Terms and laws without a number are dampers of their own, after the others.
    """
    every: tuple[DamperForce, ...] = (*scene.damping, *scene.laws)
    numbers = sorted({one.number for one in every} - {0})
    found = [tuple(one for one in every if one.number == number) for number in numbers]
    return (*found, *((one,) for one in every if not one.number))


def deformation_of(scene: Scene, place: int, motion: Array) -> Array:
    """The deformation that a damper acts on, from ``(..., d)`` to ``(..., c)``."""
    return dampers_of(scene)[place][0].deformation(motion)


def damper_values(scene: Scene) -> Mapping[str, DamperValue]:
    """Quantities of dampers by name: ``force_1``, ``deformation_1`` and ``work_1``.

    The name of a damper, if it has one, may replace its number. If a damper has several components,
    the number or the storey of each follows: ``force_1_2``. If the motion is given, ``force`` is
    the force of all dampers.
    """
    found: dict[str, DamperValue] = {}
    numbered = [(str(place + 1), place, one) for place, (one, *_) in enumerate(dampers_of(scene))]
    named = [(one.name, place, one) for _, place, one in numbered if one.name]
    for label, place, one in (*numbered, *named):
        found.setdefault(f"work_{label}", DamperValue(kind="work", place=place))
        count = one.inner.shape[0]
        labels = (one.factored.labels if one.factored else ()) or range(1, count + 1)
        for component, number in enumerate(labels if count <= MOST_COMPONENTS else ()):
            end = f"_{number}" if count > 1 else ""
            for kind in ("force", "deformation"):
                value = DamperValue(
                    kind=cast(Literal["force"], kind), place=place, component=component
                )
                found.setdefault(f"{kind}_{label}{end}", value)
    if scene.prescribed is not None:
        found.setdefault("force", DamperValue(kind="force", place=TOGETHER))
    return found


def single_damper(scene: Scene, place: int, shape: RunSteps) -> tuple[Scene, RunSteps]:
    """A scene of one damper with its deformation as coordinates, and the run of this scene."""
    parts = dampers_of(scene)[place]
    single = [replace(one, coefficient=one.inner) for one in parts]
    count = parts[0].inner.shape[0]
    mass = sparse_unit(count) if is_sparse(parts[0].inner) else np.eye(count)
    found = Scene(
        inertia=Inertia(mass=mass),
        initial_position=parts[0].deformation(scene.initial_position),
        initial_velocity=parts[0].deformation(scene.initial_velocity),
        final_time=scene.final_time,
        damping=tuple(one for one in single if isinstance(one, FractionalDamping)),
        laws=tuple(one for one in single if isinstance(one, Law)),
        derivative=scene.derivative,
    )
    own = replace(
        shape,
        position=parts[0].deformation(shape.position),
        momentum=parts[0].deformation(shape.momentum),
        velocity=parts[0].deformation(shape.velocity),
        jump=None,
    )
    return found, own


def spring_force(scene: Scene, place: int, deformation: Array, time: Array) -> Array:
    """The part of a damper's force without memory, from deformations ``(n, c)``.

    It comes from the relaxed modulus of a law, and from the difference of Riemann-Liouville and
    Caputo derivatives of order below 1.
    """
    total = np.zeros_like(deformation)
    start = deformation_of(scene, place, scene.initial_position)
    for one in dampers_of(scene)[place]:
        if isinstance(one, Law):
            total += one.spring * times(deformation, one.inner)
        elif scene.derivative != "caputo" and one.order < 1 and start.any():
            with np.errstate(divide="ignore"):
                power = time**-one.order / math.gamma(1.0 - one.order)
            at_start = np.asarray(times(start, one.inner))
            total[:, at_start != 0] += power[:, None] * at_start[at_start != 0]
    return total


def remembered_at_start(scene: Scene, place: int) -> Array:
    """The force of the memory at t = 0, ``(c,)``; nan where it is infinite."""
    velocity = deformation_of(scene, place, scene.initial_velocity)
    total = np.zeros_like(velocity)
    for one in dampers_of(scene)[place]:
        if isinstance(one, Law) or one.order < 1:
            continue
        force = np.asarray(times(velocity, one.inner), dtype=float)
        if one.order == 1:
            total += force
        elif scene.derivative != "caputo":
            total[force != 0] = np.nan
    return total


def check_work(scene: Scene, name: str) -> None:
    """Refuse works that are infinite.

    Raises
    ------
    ValueError
        For Riemann-Liouville derivatives of a motion that begins away from 0.
    """
    if scene.derivative != "caputo" and np.any(scene.initial_position != 0):
        raise ValueError(
            f"{name}: the power of a Riemann-Liouville derivative is infinite at the start; use "
            "caputo, or begin at 0"
        )


def rough_dampers(scene: Scene) -> tuple[int, ...]:
    """Places of dampers whose forces at the stages keep the error of the first step."""
    if not rate_jumps(scene):
        return ()
    every = enumerate(dampers_of(scene))
    return tuple(k for k, own in every if any(getattr(one, "order", 0.0) > 1 for one in own))


def deformation_rows(scene: Scene, place: int) -> Array:
    """B of a damper, ``(c, d)``."""
    return deformation_of(scene, place, np.eye(scene.dimension)).T


@lru_cache(maxsize=8)
def is_separable(scene: Scene) -> bool:
    """Whether the balance of forces gives the force of each rough damper: independent B."""
    rough = rough_dampers(scene)
    if scene.is_sparse or not rough:
        return False
    rows = np.concatenate([deformation_rows(scene, one) for one in rough])
    return bool(np.linalg.matrix_rank(rows) == len(rows))


def loses_by_dampers(scene: Scene, steps: RunSteps) -> bool:
    """Whether the energy of a motion changes only by the work of its dampers."""
    return scene.forcing is None and scene.lagrangian is None and steps.jump is None


def running_work(shape: RunSteps, force: Array | None, rate: Array) -> Array:
    """Chebyshev coefficients, on every step, of the work since the start, ``(r + 1, n)``.

    Force and rate of deformation are those at the stages, ``(n, r, c)``; None: no force acts.
    """
    stages = shape.tables.points.size
    if force is None:
        return np.zeros((stages + 1, shape.n_steps))
    power = np.einsum("nrd,nrd->rn", force, rate)
    rates = shape.tables.stages_to_series @ power
    found = np.asarray(chebyshev.chebint(rates, lbnd=-1.0)) * 0.5 * shape.step_size
    found[0, 1:] += np.cumsum(found.sum(axis=0))[:-1]
    return found


class DampersAlong:
    """The dampers of members along their motions; forces of the memory are computed once."""

    def __init__(self, motion: DenseMotion) -> None:
        self._motion = motion
        self._series: dict[tuple[str, int], Array] = {}

    def __call__(self, value: DamperValue, steps: Places, tau: Array) -> Array:
        """A force, deformation or work at places of steps, shape ``(n,)``."""
        motion, place = self._motion, value.place
        if place == TOGETHER:
            count = len(dampers_of(motion.scenes[0]))
            every = (replace(value, place=one) for one in range(count))
            return np.asarray(sum(self(one, steps, tau) for one in every))
        if value.kind == "work":
            found = evaluate_series(self._works(place), steps, 2.0 * tau - 1.0)[:, 0]
            for member, own in by_owner(motion.owner, steps, len(motion.scenes)):
                scene = motion.scenes[member]
                is_lost = loses_by_dampers(scene, motion.steps[member])
                if rough_dampers(scene) == (place,) and is_lost:
                    found[own] = self._work_by_energy(member, place, steps[own], tau[own])
            return found
        position, found = motion.position(steps, tau), np.zeros(steps.size)
        is_force, time = value.kind == "force", motion.time(steps, tau)
        if is_force:
            series = self._remembered(place)
            found = evaluate_series(series, steps, 2.0 * tau - 1.0)[:, value.component]
        for member, own in by_owner(motion.owner, steps, len(motion.scenes)):
            scene = motion.scenes[member]
            deformation = deformation_of(scene, place, position[own])
            if not is_force:
                found[own] = deformation[:, value.component]
                continue
            if place in rough_dampers(scene) and is_separable(scene):
                balanced = self._by_balance(scene, place, steps[own], tau[own])
                found[own] = balanced[:, value.component]
                continue
            at_start = remembered_at_start(scene, place)[value.component]
            found[own] = np.where(time[own] == 0.0, at_start, found[own])
            found[own] += spring_force(scene, place, deformation, time[own])[:, value.component]
        return found

    def _work_by_energy(self, member: int, place: int, steps: Places, tau: Array) -> Array:
        """The work of the one rough damper, ``(n,)``: the lost energy less the works of others."""
        motion, scene = self._motion, self._motion.scenes[member]
        momentum = scene.momentum(scene.initial_position, scene.initial_velocity, 0.0)
        _, energy = motion.momentum_and_energy(motion.position(steps, tau), steps, tau)
        found = scene.energy(scene.initial_position, momentum, 0.0) - energy
        for other in range(len(dampers_of(scene))):
            if other != place:
                found -= self(DamperValue(kind="work", place=other), steps, tau)
        return np.asarray(found)

    def _by_balance(self, scene: Scene, place: int, steps: Places, tau: Array) -> Array:
        """The force of a rough damper, ``(n, c)``: the whole damping less the forces of others."""
        motion, rough = self._motion, rough_dampers(scene)
        rest = -motion.damping(steps, tau)
        for other in range(len(dampers_of(scene))):
            if other in rough:
                continue
            for component, row in enumerate(deformation_rows(scene, other)):
                value = DamperValue(kind="force", place=other, component=component)
                rest -= self(value, steps, tau)[:, None] * row
        rows = np.concatenate([deformation_rows(scene, one) for one in rough])
        first = sum(len(deformation_rows(scene, one)) for one in rough if one < place)
        with np.errstate(invalid="ignore"):
            # infinite at the start
            forces = rest @ np.linalg.pinv(rows)
        return np.asarray(forces[:, first : first + len(deformation_rows(scene, place))])

    def _remembered(self, place: int) -> Array:
        """Chebyshev coefficients of a damper's force with memory, ``(K, N, c)``."""
        if ("force", place) not in self._series:
            every = self._at_stages(place)
            forces = [np.zeros_like(rate) if one is None else one for one, rate, _ in every]
            self._series["force", place] = stage_series(self._motion.shapes, forces)
        return self._series["force", place]

    def _works(self, place: int) -> Array:
        """Chebyshev coefficients of the work on a damper, ``(K, N, 1)``."""
        if ("work", place) not in self._series:
            for scene in self._motion.scenes:
                check_work(scene, f"work_{place + 1}")
            found = [running_work(o, f, rate)[..., None] for f, rate, o in self._at_stages(place)]
            self._series["work", place] = join_series(found)
        return self._series["work", place]

    def _at_stages(self, place: int) -> Iterator[tuple[Array | None, Array, RunSteps]]:
        """For every member force and rate of deformation of a damper, ``(n, r, c)``."""
        motion = self._motion
        every = zip(motion.find_forces(place), motion.scenes, motion.shapes, strict=True)
        for forces, scene, shape in every:
            rate = deformation_of(scene, place, shape.velocity)
            yield None if forces is None else forces.sum(axis=0), rate, shape
