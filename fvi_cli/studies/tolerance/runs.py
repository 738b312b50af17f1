"""Runs with adaptive steps that are compared with each other, and where a search begins."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.method import ForcingQuadrature, Method
from fvi_cli.integrator.trajectory import Trajectory

LOOSE: Final = 30.0
POWER: Final = 1.3
"""A local tolerance e gives a run with an error below e^1.3 / 30, both relative to the motion."""
COARSEST: Final = 0.01
"""Largest local tolerance, as a share of the motion."""
PROBED_FRACTIONS = (np.arange(64) + 0.5) / 64
"""Times at which forces are evaluated for a first guess, as shares of the run."""


def gauss(scene: Scene, degree: int) -> Method:
    """The Gauss method of a tolerance; loads other than samples are integrated exactly."""
    sampled = scene.forcing is not None and bool(scene.forcing.samples)
    rule: ForcingQuadrature = "galerkin" if sampled or scene.forcing is None else "exact"
    return Method(cq="gauss", degree=degree, start="none", forcing_quadrature=rule)


def adaptive_run(scene: Scene, degree: int, steps: AdaptiveSteps) -> Trajectory:
    """A run by the Gauss method of a degree, with its polynomials."""
    return integrate(scene, gauss(scene, degree), steps, with_steps=True)


def amplitude_of(run: Trajectory) -> float:
    """Largest position of a run, a length."""
    found = float(np.abs(run.position).max())
    return found if math.isfinite(found) else 0.0


def first_local(target: float, amplitude: float) -> float:
    """Local tolerance to begin with, a length."""
    # the motion may be smaller than the tolerance: count it as equal
    amplitude = max(amplitude, target)
    return float(amplitude * min(COARSEST, (LOOSE * target / amplitude) ** (1 / POWER)))


def likely_amplitude(scene: Scene) -> float:
    """Size of the positions of a run, a length; 1 where nothing moves.

    The start position, and the displacements by the start velocity and by the largest force in a
    quarter of the longest period (in the whole run where there is no stiffness). It does not depend
    on the units of mass and time, and determines only where a search begins.
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
    return found if 0 < found < math.inf else 1.0


def _quarter_period(scene: Scene) -> float:
    potential = scene.potential
    if isinstance(potential, QuadraticPotential):
        stiffness = potential.form.diagonal()
    elif potential is not None:
        with np.errstate(all="ignore"):
            stiffness = np.diagonal(potential.hessian(scene.initial_position))
    else:
        return scene.final_time
    # Rayleigh quotients of the coordinates estimate the slowest mode well enough
    squares = np.abs(stiffness) / scene.inertia.form.diagonal()
    slowest = float(squares[squares > 0].min(initial=math.inf))
    return min(scene.final_time, 0.5 * math.pi / math.sqrt(slowest))
