"""Runs to compare with each other: adaptive, and on the same mesh."""

from __future__ import annotations

import math

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import ForcingQuadrature, Method
from fvi_cli.integrator.run.on_mesh import engine_for, integrate_scenes
from fvi_cli.integrator.trajectory import Trajectory

MOST_STEPS = 200_000


def gauss(scene: Scene, degree: int) -> Method:
    """The Gauss method of a tolerance; loads other than samples are integrated exactly."""
    sampled = scene.forcing is not None and bool(scene.forcing.samples)
    rule: ForcingQuadrature = "galerkin" if sampled or scene.forcing is None else "exact"
    return Method(cq="gauss", degree=degree, start="none", forcing_quadrature=rule)


class AdaptiveRuns:
    """Runs of one scene by one Gauss method; each run has one local tolerance.

    A run with more than `most_steps` fails.
    """

    def __init__(
        self,
        scene: Scene,
        degree: int,
        *,
        max_step: float | None = None,
        most_steps: int = MOST_STEPS,
    ) -> None:
        self._scene, self._method = scene, gauss(scene, degree)
        self._most_steps = most_steps
        self._max_step = math.inf if max_step is None else max_step
        self._engine: Engine | None = None

    def run(self, local: float, *, may_miss: float = math.inf) -> Trajectory:
        """A run with a local tolerance, a length, with its polynomials."""
        steps = AdaptiveSteps(
            tolerance=local,
            may_miss=may_miss,
            most_steps=self._most_steps,
            max_step=self._max_step,
        )
        scene, method = self._scene, self._method
        if self._engine is None:
            self._engine = engine_for([scene], method, steps)
        (found,) = integrate_scenes([scene], method, steps, with_steps=True, engine=self._engine)
        return found


def run_on(scene: Scene, degree: int, mesh: Mesh) -> Trajectory:
    """A run on a given mesh, with its polynomials."""
    return integrate(scene, gauss(scene, degree), mesh, with_steps=True)
