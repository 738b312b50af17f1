"""Any numbers along a motion, accelerations and damping forces too, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.adjoint.gradient import Sensitivities
from fvi_cli.integrator.adjoint.variation import DIFFERENCE, FACTORS, Variation, differences
from fvi_cli.integrator.observations.dense_motion import DenseMotion

Array = NDArray[np.float64]
LEAST_CHANGE = 1e-12
"""Of the motion by a parameter, relative: what is smaller is taken for that."""
Along = Callable[[DenseMotion, int, float], Array]


def rates_along(found: Sensitivities, variations: Sequence[Variation], value: Along) -> Array:
    """Derivatives of numbers along a motion, shape ``(n, p)``.

    Central differences of fourth order of what the numbers are made of, on the motion and on what
    each parameter does to it to first order; nothing is integrated again.

    Parameters
    ----------
    found, variations
        The motion with its derivatives, and the parameters in their order.
    value
        From a motion, the index of a parameter and its value to the numbers, shape ``(n,)``.
    """
    run = found.run
    scene, steps = run.scene, run.steps
    force, by_force = stage_force(found), run.damping_changes(found.tangent, found.change)
    velocity = np.einsum("rs,nsdp->nrdp", run.to_velocity, found.tangent.unknowns)
    columns = []
    for index, one in enumerate(variations):
        total = np.zeros(())
        for beside, factor, number in differences(one, scene, is_straight=False):
            motion = DenseMotion(scene=beside, steps=steps, shape=steps, force=force)
            total = total + factor * value(motion, index, number)
        ways = (found.tangent.position[..., index], velocity[..., index], by_force[..., index])
        sizes = (steps.position, steps.velocity, force)
        step = DIFFERENCE / max(LEAST_CHANGE, *map(_ratio, ways, sizes))
        for place, factor in FACTORS.items():
            moved = replace(
                steps,
                position=steps.position + place * step * ways[0],
                velocity=steps.velocity + place * step * ways[1],
            )
            forced = force + place * step * ways[2]
            motion = DenseMotion(scene=scene, steps=moved, shape=moved, force=forced)
            total = total + factor / step * value(motion, index, one.value)
        columns.append(total)
    return np.stack(columns, axis=-1)


def stage_force(found: Sensitivities) -> Array:
    """Force of all damping at the stages of a run, ``(n, r, d)``."""
    plain, _ = found.run.damping_forces()
    return np.asarray(np.einsum("knia,kab->nib", plain, found.run.memory.matrices))


def _ratio(way: Array, size: Array) -> float:
    largest = float(np.abs(size).max(initial=0.0))
    return float(np.abs(way).max(initial=0.0)) / largest if largest > 0 else 0.0
