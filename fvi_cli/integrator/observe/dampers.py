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

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.polynomial import chebyshev

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws import Law
from fvi_cli.effects.matrices import is_sparse, sparse_unit, times
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances import damping_along
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.motion import Motion
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array, Places

TOGETHER = -1
"""Place of all dampers of a scene with a given motion, which share its one coordinate."""

DamperForce = FractionalDamping | Law
Kind = Literal["force", "deformation", "work"]


@dataclass(frozen=True, kw_only=True)
class DamperValue:
    """The meaning of a name: a component of the force or deformation of a damper, or its work."""

    kind: Kind
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


def deformation_rows(scene: Scene, place: int) -> Array:
    """B of a damper, ``(c, d)``."""
    return deformation_of(scene, place, np.eye(scene.dimension)).T


def damper_values(scene: Scene) -> Mapping[str, DamperValue]:
    """Quantities of dampers by name: ``force_1``, ``deformation_1`` and ``work_1``.

    The name of a damper, if it has one, may replace its number. If a damper has several components,
    the number or the storey of each follows: ``force_1_2``. If the motion is given, ``force`` is
    the force of all dampers.
    """
    found: dict[str, DamperValue] = {}
    kinds: tuple[Kind, ...] = ("force", "deformation")
    numbered = [(str(place + 1), place, one) for place, (one, *_) in enumerate(dampers_of(scene))]
    named = [(one.name, place, one) for _, place, one in numbered if one.name]
    for label, place, one in (*numbered, *named):
        found.setdefault(f"work_{label}", DamperValue(kind="work", place=place))
        count = one.inner.shape[0]
        for component, number in enumerate(one.storeys or range(1, count + 1)):
            end = f"_{number}" if count > 1 else ""
            for kind in kinds:
                value = DamperValue(kind=kind, place=place, component=component)
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
) -> list[Array]:
    """Forces with memory at the stages of runs of one kind on one mesh, ``(n, r, d)``.

    For the place of a damper its force on its deformation, ``(n, r, c)``. Runs may end early.
    """
    if damper is not None:
        runs = [
            replace(run, velocity=deformation_of(scene, damper, run.velocity))
            for scene, run in zip(scenes, runs, strict=True)
        ]
        scenes = [damper_alone(scene, damper) for scene in scenes]
    found = [np.zeros_like(run.velocity) for run in runs]
    for count in {run.n_steps for run in runs} - {0}:
        own = [k for k, run in enumerate(runs) if run.n_steps == count]
        along = damping_along([scenes[k] for k in own], method, [runs[k] for k in own])
        if along is not None:
            with np.errstate(all="ignore"):
                for place, force in zip(own, along.forces(), strict=True):
                    found[place] = force
    return found


def force_objection(
    scene: Scene,
    names: Set[str],
    derived: Mapping[str, tuple[str, int]],
    *,
    has_impacts: bool = False,
) -> str:
    r"""What is wrong with a force or work among the names of an expression; empty: nothing.

    `derived` are the names of the motion with their prefixes. Above order 1 the force of a velocity
    that begins with a jump is like :math:`t^{1 - \gamma}`, and forces at the
    stages keep an error of the first step, as momenta do
    (:meth:`fvi_cli.integrator.steps.RunSteps.momenta_of_polynomials`).
    """
    dampers, is_above = damper_values(scene), scene.acts_above_order_1
    forces = {name for name, (prefix, _) in derived.items() if prefix in ("a", "d")}
    forces |= {name for name, one in dampers.items() if one.kind != "deformation"}
    for name in sorted(names & forces):
        if is_above and has_impacts:
            return (
                f"{name}: forces of orders above 1 keep an error of the step behind an impact; "
                "use orders up to 1, or leave out the impacts"
            )
        if scene.initial_loads and (is_above or name.startswith("work_")):
            return (
                f"{name}: loads of Riemann-Liouville derivatives at the start spoil works, and "
                "forces of orders above 1; use caputo, or begin at rest in 0"
            )
    return ""


def damper_along(motion: Motion, value: DamperValue, steps: Places, tau: Array) -> Array:
    """A force, deformation or work at places of steps, shape ``(n,)``."""
    place, scenes = value.place, motion.scenes
    if place == TOGETHER:
        every = (replace(value, place=one) for one in range(len(dampers_of(scenes[0]))))
        return np.asarray(sum(damper_along(motion, one, steps, tau) for one in every))
    if value.kind == "work":
        to_work = np.eye(motion.steps[0].tables.points.size + 1)
        return motion.series(value, partial(_works, motion, place), steps, tau, to_work)[:, 0]
    at_once = [partial(_without_memory, scene, value) for scene in scenes]
    found = motion.path(value, at_once, steps, tau)[:, 0]
    if value.kind == "deformation":
        return found
    found += motion.series(
        ("memory", value),
        lambda: [one[..., [value.component]] for one in motion.forces(place)],
        steps,
        tau,
    )[:, 0]
    if any(scene.initial_loads for scene in scenes):
        time = motion.time(steps, tau)
        for member, own in motion.by_member(steps):
            loads = damper_alone(scenes[member], place).initial_force(time[own])
            found[own] -= loads[:, value.component]
    return found


def _works(motion: Motion, place: int) -> list[Array]:
    """Chebyshev coefficients of the work on a damper since the start, ``(n, r + 1, 1)``."""
    found = []
    for force, scene, run in zip(motion.forces(place), motion.scenes, motion.steps, strict=True):
        rate = deformation_of(scene, place, run.velocity)
        power = run.tables.stages_to_series @ np.einsum("nrd,nrd->rn", force, rate)
        work = np.asarray(chebyshev.chebint(power, lbnd=-1.0)) * 0.5 * run.step_size
        work[0, 1:] += np.cumsum(work.sum(axis=0))[:-1]
        found.append(work.T[..., None])
    return found


def _without_memory(scene: Scene, value: DamperValue, motion: Array) -> Array:
    """What a damper takes from a motion without memory, from ``(..., d)`` to ``(..., 1)``.

    It is a component of the deformation, or of the force of the relaxed moduli of laws.
    """
    found = deformation_of(scene, value.place, motion)
    if value.kind == "force":
        laws = [one for one in dampers_of(scene)[value.place] if isinstance(one, Law)]
        found = sum((one.spring * times(found, one.inner) for one in laws), np.zeros_like(found))
    return found[..., [value.component]]
