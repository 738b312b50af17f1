"""How far a motion may go, before anything of it is computed."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.effects.matrices import diagonal
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.growth_bound import PROBED_FRACTIONS


def likely_amplitude(scene: Scene) -> float:
    """Size of the positions of a run, a length; zero where nothing moves.

    The start position, the way at the start velocity and the way under the largest force, both in
    a quarter of the longest period (in the whole run where nothing pulls back). It does not change
    with the units of mass and time, and decides nothing but where a search begins.
    """
    time = _quarter_period(scene)
    found = float(np.abs(scene.initial_position).max())
    found = max(found, time * float(np.abs(scene.initial_velocity).max()))
    if scene.forcing is not None:
        with np.errstate(all="ignore"):
            forces = scene.forcing(scene.final_time * PROBED_FRACTIONS)
            forces = np.where(np.isfinite(forces), forces, 0.0)
            pushed = np.abs(scene.inertia.velocity(forces)).max(initial=0.0)
        found = max(found, time**2 * float(pushed))
    return found if math.isfinite(found) else 1.0


def _quarter_period(scene: Scene) -> float:
    final_time = scene.final_time
    potential = scene.potential
    if potential is None:
        return final_time
    if isinstance(potential, QuadraticPotential):
        stiffness = diagonal(potential.form)
    else:
        with np.errstate(all="ignore"):
            stiffness = np.diagonal(potential.hessian(scene.initial_position))
    if not np.isfinite(stiffness).all():
        return final_time
    # the Rayleigh quotients of the axes are all that is needed of the slowest mode
    squares = np.abs(stiffness) / diagonal(scene.inertia.form)
    slowest = float(squares[squares > 0].min(initial=math.inf))
    if not 0 < slowest < math.inf:
        return final_time
    return min(final_time, 0.5 * math.pi / math.sqrt(slowest))
