r"""Force, deformation and work of single dampers along a motion.

The entry k of ``damping`` and ``dampers`` acts along :math:`y = B q`, the combinations under
``acts_on`` or the coordinates themselves, with the force

.. math:: f = \mu D^\gamma y \quad\text{or}\quad f = \mu\,\bigl(G_0\,y + g\,k * \dot y\bigr)

of the sign of the deformation; on the coordinates acts :math:`-B^T f`. What it remembers is the
memory of the method, driven by :math:`\dot y` at the stages; between them it is the polynomial
through its values there. The work is that of what is remembered,
:math:`W(t) = \int_0^t (f - \mu G_0 y) \cdot \dot y\, ds`, so that the works of all dampers are what
the energy loses; its integral over whole steps is the quadrature of the method.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np
from numpy.polynomial import chebyshev

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import SparseMatrix, is_sparse, times
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array

MOST_COMPONENTS = 1000
"""Components of a damper that have names of their own, at most."""

TOGETHER = -1
"""Place of all dampers of a scene with a given motion, which share its one coordinate."""

DamperForce = FractionalDamping | Law


@dataclass(frozen=True, kw_only=True)
class DamperValue:
    """What a name says: a component of the force or deformation of a damper, or its work."""

    kind: Literal["force", "deformation", "work"]
    place: int  # among the dampers of the scene, from 0
    component: int = 0


def dampers_of(scene: Scene) -> tuple[tuple[DamperForce, ...], ...]:
    """Dampers by their numbers, of one or several terms and laws on one deformation.

    Terms and laws without a number are dampers of their own, behind the others.
    """
    every: tuple[DamperForce, ...] = (*scene.damping, *scene.laws)
    numbers = sorted({one.number for one in every} - {0})
    found = [tuple(one for one in every if one.number == number) for number in numbers]
    return (*found, *((one,) for one in every if not one.number))


def deformation_of(scene: Scene, place: int, motion: Array) -> Array:
    """What a damper acts on, from ``(..., d)`` to ``(..., c)``."""
    return dampers_of(scene)[place][0].deformation(motion)


def damper_values(scene: Scene) -> Mapping[str, DamperValue]:
    """By name what can be asked of dampers: ``force_1``, ``deformation_1`` and ``work_1``.

    In place of the number stands the name of a damper that has one; behind it, where a damper has
    several components, their number: ``force_1_2``. Where the motion is given, ``force`` is that
    of all of them.
    """
    found: dict[str, DamperValue] = {}
    numbered = [(str(place + 1), place, one) for place, (one, *_) in enumerate(dampers_of(scene))]
    named = [(one.name, place, one) for _, place, one in numbered if one.name]
    for label, place, one in (*numbered, *named):
        found.setdefault(f"work_{label}", DamperValue(kind="work", place=place))
        count = one.inner.shape[0]
        for component in range(count if count <= MOST_COMPONENTS else 0):
            end = f"_{component + 1}" if count > 1 else ""
            for kind in ("force", "deformation"):
                value = DamperValue(
                    kind=cast(Literal["force"], kind), place=place, component=component
                )
                found.setdefault(f"{kind}_{label}{end}", value)
    if scene.prescribed is not None:
        found.setdefault("force", DamperValue(kind="force", place=TOGETHER))
    return found


def damper_names(scene: Scene) -> tuple[str, ...]:
    """The names of :func:`damper_values`."""
    return tuple(damper_values(scene))


def single_damper(scene: Scene, place: int, shape: RunSteps) -> tuple[Scene, RunSteps]:
    """A damper with its deformation in place of the coordinates, and the run of that."""
    parts = dampers_of(scene)[place]
    single = [replace(one, form=one.inner, factored=None) for one in parts]
    count = parts[0].inner.shape[0]
    mass: Array | SparseMatrix = np.eye(count)
    if is_sparse(parts[0].inner):
        from scipy.sparse import eye_array

        mass = cast(SparseMatrix, eye_array(count, format="csr"))
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
    """What a damper does without memory of rates, from deformations ``(n, c)``.

    That is the relaxed modulus of a law, and what Riemann-Liouville derivatives of order below 1
    have more than Caputo's.
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


def running_work(shape: RunSteps, force: Array | None, rate: Array) -> Array:
    """Chebyshev coefficients, on every step, of the work since the start, ``(r + 1, n)``.

    Force and rate of deformation are those at the stages, ``(n, r, c)``; None: nothing acts.
    """
    stages = shape.tables.points.size
    if force is None:
        return np.zeros((stages + 1, shape.n_steps))
    power = np.einsum("nrd,nrd->rn", force, rate)
    rates = shape.tables.stages_to_series @ power
    found = np.asarray(chebyshev.chebint(rates, lbnd=-1.0)) * 0.5 * shape.step_size
    found[0, 1:] += np.cumsum(found.sum(axis=0))[:-1]
    return found
