"""Stiff motions between the points of a mesh, where momenta keep what stages have forgotten."""

import os
from unittest import mock

import numpy as np
import pytest

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.second_runs import dense_motion
from fvi_cli.scenes.linear_response import match_scene
from fvi_cli.scenes.registry import build_problem

SEED = int(os.environ.get("FVI_TEST_SEED", "1"))


def errors(seed: int) -> tuple[float, float]:
    """Of positions at points, and between them, of a drawn motion."""
    rng = np.random.default_rng([SEED, seed])
    size = 10.0 ** rng.uniform(6, 9)
    damping = [{"order": rng.uniform(0.3, 0.7), "coefficient": size}]
    keys = {"stiffness": size * 10.0 ** rng.uniform(-0.5, 0.5), "damping": damping}
    start = {"position": rng.uniform(0.5, 1.0), "velocity": rng.uniform(-1.0, 1.0)}
    scene = build_problem(
        {"kind": "damped-oscillator", "final_time": 10.0, "initial": start, **keys}
    ).scene
    method = Method(cq="gauss", degree=int(rng.integers(2, 4)), start="graded")
    run = integrate(scene, method, 50, with_steps=True)
    motion, times = dense_motion([scene], method, [run.steps]), np.linspace(0.0, 10.0, 601)[1:]
    exact = match_scene(scene).position
    between = np.abs(motion.position(*motion.located(0, times)) - exact(times)).max()
    return np.abs(run.position - exact(run.time)).max(), between


@pytest.mark.parametrize("seed", range(4))
def test_between_points_a_stiff_motion_holds(seed):
    at_points, between = errors(seed)
    assert at_points < 5e-3
    assert between < 5e-3


def test_velocities_of_momenta_would_spoil_it():
    near = "fvi_cli.integrator.observations.motion.largest_near"
    with mock.patch(near, lambda v, at: np.full((at.size, v.shape[2]), np.inf)):
        assert max(errors(seed)[1] for seed in range(4)) > 0.5
