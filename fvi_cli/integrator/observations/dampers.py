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

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, cast

import numpy as np
from numpy.polynomial import chebyshev

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import is_sparse, sparse_unit, times
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.damping_along import damping_along
from fvi_cli.integrator.memory.damping import pattern_of
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.motion import (
    Combination,
    DenseMotion,
    combination_of,
    join_series,
    stage_series,
)
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


def damper_alone(scene: Scene, place: int) -> Scene:
    """A scene of one damper with its deformation as coordinates."""
    parts = dampers_of(scene)[place]
    single = [replace(one, coefficient=one.inner) for one in parts]
    count = parts[0].inner.shape[0]
    mass = sparse_unit(count) if is_sparse(parts[0].inner) else np.eye(count)
    return Scene(
        inertia=Inertia(mass=mass),
        initial_position=parts[0].deformation(scene.initial_position),
        initial_velocity=parts[0].deformation(scene.initial_velocity),
        final_time=scene.final_time,
        damping=tuple(one for one in single if isinstance(one, FractionalDamping)),
        laws=tuple(one for one in single if isinstance(one, Law)),
        derivative=scene.derivative,
    )


def forces_along(
    scenes: Sequence[Scene],
    method: Method,
    runs: Sequence[RunSteps],
    damper: int | None = None,
) -> list[Array | None]:
    """Forces with memory at the stages of runs; those of one mesh and pattern at once.

    Each is ``(k, n, r, d)`` by direction or, for one damper, ``(1, n, r, c)`` on its deformation;
    None without damping.
    """
    velocities = [run.velocity for run in runs]
    if damper is not None:
        velocities = [
            deformation_of(scene, damper, one)
            for scene, one in zip(scenes, velocities, strict=True)
        ]
        scenes = [damper_alone(scene, damper) for scene in scenes]
    found: list[Array | None] = [None] * len(scenes)
    groups: dict[Hashable, list[int]] = {}
    for index, (scene, run) in enumerate(zip(scenes, runs, strict=True)):
        if scene.active_forces and run.n_steps:
            # laws change the rates of all, and sparse matrices are not batched
            runs_individually = bool(scene.active_laws) or scene.is_sparse
            key = (run.time.tobytes(), pattern_of(scene), scene.final_time)
            groups.setdefault(index if runs_individually else key, []).append(index)
    for places in groups.values():
        first = runs[places[0]]
        along = damping_along(
            [scenes[index] for index in places],
            method,
            first.mesh(scenes[places[0]].break_points),
            [replace(runs[index], velocity=velocities[index]) for index in places],
        )
        if along is None:  # pragma: no cover - there are forces
            continue
        with np.errstate(all="ignore"):
            for index, force in zip(places, along.forces().swapaxes(0, 1), strict=True):
                found[index] = force
    return found


def taken_at_once(scene: Scene, value: DamperValue, motion: Array) -> Array:
    """What a damper takes from a motion without memory, from ``(..., d)`` to ``(..., 1)``.

    It is a component of the deformation, or of the force of the relaxed moduli of laws.
    """
    found = deformation_of(scene, value.place, motion)
    if value.kind == "force":
        laws = [one for one in dampers_of(scene)[value.place] if isinstance(one, Law)]
        found = sum((one.spring * times(found, one.inner) for one in laws), np.zeros_like(found))
    return found[..., [value.component]]


def check_forces(scene: Scene, name: str, *, is_work: bool = False) -> None:
    """Refuse forces and works that the initial data of Riemann-Liouville derivatives spoil.

    Above order 1 forces at the stages keep an error like those of
    :meth:`fvi_cli.integrator.results.run_steps.RunSteps.momenta_of_polynomials`.

    Raises
    ------
    ValueError
        For works of forces with loads of the initial data, and forces of orders above 1 with them.
    """
    if not scene.initial_loads:
        return
    if is_work:
        reason = "the power of a Riemann-Liouville derivative is infinite at the start"
    elif scene.acts_above_order_1:
        reason = (
            "forces of Riemann-Liouville derivatives above order 1 keep an error of the first step"
        )
    else:
        return
    raise ValueError(f"{name}: {reason}; use caputo, or begin at rest in 0")


def deformation_rows(scene: Scene, place: int) -> Array:
    """B of a damper, ``(c, d)``."""
    return deformation_of(scene, place, np.eye(scene.dimension)).T


def running_work(run: RunSteps, force: Array | None, rate: Array) -> Array:
    """Chebyshev coefficients, on every step, of the work since the start, ``(r + 1, n)``.

    Force and rate of deformation are those at the stages, ``(n, r, c)``; None: no force acts.
    """
    stages = run.tables.points.size
    if force is None:
        return np.zeros((stages + 1, run.n_steps))
    power = np.einsum("nrd,nrd->rn", force, rate)
    rates = run.tables.stages_to_series @ power
    found = np.asarray(chebyshev.chebint(rates, lbnd=-1.0)) * 0.5 * run.step_size
    found[0, 1:] += np.cumsum(found.sum(axis=0))[:-1]
    return found


class DampersAlong:
    """The dampers of members along their motions; forces of the memory are computed once."""

    def __init__(self, motion: DenseMotion) -> None:
        self._motion = motion
        self._series: dict[tuple[str, int], Array] = {}
        self._combinations: dict[DamperValue, Combination] = {}

    def __call__(self, value: DamperValue, steps: Places, tau: Array) -> Array:
        """A force, deformation or work at places of steps, shape ``(n,)``."""
        motion, place = self._motion, value.place
        if place == TOGETHER:
            count = len(dampers_of(motion.scenes[0]))
            every = (replace(value, place=one) for one in range(count))
            return np.asarray(sum(self(one, steps, tau) for one in every))
        if value.kind == "work":
            return evaluate_series(self._works(place), steps, 2.0 * tau - 1.0)[:, 0]
        if value not in self._combinations:
            taken = [partial(taken_at_once, scene, value) for scene in motion.scenes]
            self._combinations[value] = combination_of(motion.steps, taken)
        found = motion.along(self._combinations[value], steps, tau)[:, 0]
        if value.kind == "deformation":
            return found
        for scene in motion.scenes:
            check_forces(scene, f"force_{place + 1}")
        series = self._remembered(place)[..., value.component, None]
        found += evaluate_series(series, steps, 2.0 * tau - 1.0)[:, 0]
        time = motion.time(steps, tau)
        for member, own in by_owner(motion.owner, steps, len(motion.scenes)):
            scene = motion.scenes[member]
            if scene.initial_loads:
                loads = damper_alone(scene, place).initial_force(time[own])
                found[own] -= loads[:, value.component]
        return found

    def _remembered(self, place: int) -> Array:
        """Chebyshev coefficients of a damper's force with memory, ``(K, N, c)``."""
        if ("force", place) not in self._series:
            every = self._at_stages(place)
            forces = [np.zeros_like(rate) if one is None else one for one, rate, _ in every]
            self._series["force", place] = stage_series(self._motion.steps, forces)
        return self._series["force", place]

    def _works(self, place: int) -> Array:
        """Chebyshev coefficients of the work on a damper, ``(K, N, 1)``."""
        if ("work", place) not in self._series:
            for scene in self._motion.scenes:
                check_forces(scene, f"work_{place + 1}", is_work=True)
            found = [running_work(o, f, rate)[..., None] for f, rate, o in self._at_stages(place)]
            self._series["work", place] = join_series(found)
        return self._series["work", place]

    def _at_stages(self, place: int) -> Iterator[tuple[Array | None, Array, RunSteps]]:
        """For every member force and rate of deformation of a damper, ``(n, r, c)``."""
        motion = self._motion
        every = zip(motion.find_forces(place), motion.scenes, motion.steps, strict=True)
        for forces, scene, run in every:
            rate = deformation_of(scene, place, run.velocity)
            yield None if forces is None else forces.sum(axis=0), rate, run
