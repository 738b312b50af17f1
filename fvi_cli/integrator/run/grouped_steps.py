"""Equal steps of large linear scenes, one by one, with the memory of a group at a time."""

from __future__ import annotations

import numpy as np

from fvi_cli.integrator.convolution.damping import Damping
from fvi_cli.integrator.convolution.step_group import StepGroup
from fvi_cli.integrator.run.loop import Marker, Stepper
from fvi_cli.mathematics.arrays import Array


def grouped_steps(
    stepper: Stepper,
    damping: Damping,
    group: StepGroup,
    marker: Marker,
    step_size: float,
    count: int,
    loads: Array | None,
) -> tuple[Array, Array, Array]:
    """Do `count` steps of one size; the marker goes on to their end.

    Parameters
    ----------
    stepper, damping, group
        Single steps of a linear scene, its damping, and the past for this step size.
    marker
        Where they begin.
    step_size, count, loads
        h, how many, and load vectors ``(count, s + 1, d)`` of known forces.

    Returns
    -------
    tuple
        Positions and momenta after every step, ``(n, d)``, and velocities at the stages,
        ``(n, r, d)``; fewer where a position is not finite.
    """
    d, r = marker.position.value.size, stepper.solver.tables.points.size
    positions, momenta = np.empty((count, d)), np.empty((count, d))
    velocities = np.empty((count, r, d))
    at, begin = stepper.matrices(step_size), marker.time
    done = 0
    group.begin(marker.states)
    while done < count:
        result = stepper.solver.solve(
            at,
            marker.time,
            marker.position.value,
            marker.momentum.value,
            marker.states,
            None if loads is None else loads[done],
            None,
            past=group.force(),
        )
        group.push(damping.input_of(result.driving))
        marker.position.add(step_size * result.unknowns[-1])
        marker.momentum.add(result.momentum_change)
        marker.time = begin + (done + 1) * step_size
        positions[done], momenta[done] = marker.position.value, marker.momentum.value
        velocities[done] = result.velocity
        done += 1
        if group.is_full:
            marker.states = group.end()
            group.begin(marker.states)
        if not np.isfinite(positions[done - 1]).all():
            break
    marker.states = group.end()
    marker.unknowns, marker.step_size = None, step_size
    return positions[:done], momenta[:done], velocities[:done]
