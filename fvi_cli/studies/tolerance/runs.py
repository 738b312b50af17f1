"""Runs to compare with each other: adaptive, on the same mesh, on the samples of a record."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import Mesh, Stretch
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.integrator.method import ForcingQuadrature, Method
from fvi_cli.integrator.run.on_mesh import engine_for, integrate_scenes
from fvi_cli.integrator.trajectory import Trajectory

MOST_STEPS = 200_000
MOST_KINKED_STEPS = 20_000
"""Most steps of a run with kinks: each is expensive, and some motions have endlessly many kinks."""
EQUAL = 1e-9
"""Samples whose distances differ by less than this, relative, are equidistant."""
HALVINGS = 24
"""Steps towards t = 0 within the first sample, each half as long as the next."""


def gauss(scene: Scene, degree: int) -> Method:
    """The Gauss method of a tolerance; loads other than samples are integrated exactly."""
    sampled = scene.forcing is not None and bool(scene.forcing.samples)
    rule: ForcingQuadrature = "galerkin" if sampled or scene.forcing is None else "exact"
    return Method(cq="gauss", degree=degree, start="none", forcing_quadrature=rule)


class AdaptiveRuns:
    """Runs of one scene by one Gauss method; each run has one local tolerance.

    `points` are further points of the mesh; a run with more than `most_steps` fails.
    """

    def __init__(
        self,
        scene: Scene,
        degree: int,
        *,
        points: tuple[float, ...] = (),
        most_steps: int = MOST_STEPS,
    ) -> None:
        self._scene, self._method = scene, gauss(scene, degree)
        self._points, self._most_steps = points, most_steps
        self._engines: dict[float | None, Engine] = {}

    def run(
        self, local: float, first_step: float | None = None, *, may_miss: float = math.inf
    ) -> Trajectory:
        """A run with a local tolerance, a length, with its polynomials."""
        steps = AdaptiveSteps(
            tolerance=local,
            may_miss=may_miss,
            first_step=first_step,
            most_steps=self._most_steps,
            points=self._points,
        )
        scene, method = self._scene, self._method
        if first_step not in self._engines:
            self._engines[first_step] = engine_for([scene], method, steps)
        engine = self._engines[first_step]
        (found,) = integrate_scenes([scene], method, steps, with_steps=True, engine=engine)
        return found


def run_on(scene: Scene, degree: int, mesh: Mesh) -> Trajectory:
    """A run on a given mesh, with its polynomials."""
    return integrate(scene, gauss(scene, degree), mesh, with_steps=True)


def knots_of(scene: Scene) -> tuple[float, ...]:
    """Times within the run at which the forcing has samples."""
    if scene.forcing is None:
        return ()
    found = {float(t) for one in scene.forcing.samples for t in one.knots}
    return tuple(sorted(t for t in found if 0.0 < t < scene.final_time))


def knot_mesh(scene: Scene, knots: Sequence[float], per_interval: int) -> Mesh:
    """A mesh with all knots and break points among its points.

    Between two of these points there are `per_interval` equal steps. If the motion begins like a
    fractional power of t, the first step is divided further towards t = 0.
    """
    breaks = set(scene.break_points)
    ends = np.array([0.0, *sorted({*knots, *breaks}), scene.final_time])
    # points that differ by round-off alone are one
    is_distinct = np.concatenate([[True], np.diff(ends) > 1e-12 * scene.final_time])
    is_break = np.isin(ends, list(breaks))
    ends = ends[is_distinct | is_break]
    ends[-1] = scene.final_time
    lengths = np.diff(ends)
    stretches: list[Stretch] = []
    first, begin = 0, 0.0
    if start_power(scene, at_start=True) is not None:
        stretches += _towards_zero(float(lengths[0]) / per_interval)
        begin = stretches[-1].end
        if per_interval > 1:
            stretches.append(
                _equal(begin, float(ends[1]), per_interval - 1, is_fresh=False),
            )
        first, begin = 1, float(ends[1])
    for index in range(first + 1, lengths.size + 1):
        at = float(ends[index])
        is_alike = index < lengths.size and (
            abs(lengths[index] - lengths[first]) <= EQUAL * lengths[first] and at not in breaks
        )
        if is_alike:
            continue
        count = (index - first) * per_interval
        fresh = begin == 0.0 or begin in breaks
        stretches.append(_equal(begin, at, count, is_fresh=fresh))
        first, begin = index, at
    return Mesh(stretches=tuple(stretches))


def _equal(begin: float, end: float, count: int, *, is_fresh: bool) -> Stretch:
    return Stretch(
        begin=begin, end=end, n_steps=count, step_size=(end - begin) / count, is_fresh=is_fresh
    )


def _towards_zero(size: float) -> list[Stretch]:
    edges = [0.0, *(size * 0.5**power for power in range(HALVINGS, -1, -1))]
    return [
        Stretch(begin=a, end=b, n_steps=1, step_size=b - a, is_fresh=a == 0.0)
        for a, b in itertools.pairwise(edges)
    ]
