"""Stiff motions between the points of a mesh, where momenta keep what stages have forgotten."""

import os
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.second_runs import dense_motion
from fvi_cli.scenes.linear_response import match_scene
from fvi_cli.scenes.registry import build_problem

SEED = int(os.environ.get("FVI_TEST_SEED", "1"))


def errors(
    seed: int, start: str = "graded", exponents: tuple[float, float] = (6, 9), most_stages: int = 3
) -> tuple[float, float, float]:
    """Of positions at points, and between them, of a drawn motion; by its own polynomials too."""
    rng = np.random.default_rng([SEED, seed])
    size = 10.0 ** rng.uniform(*exponents)
    damping = [{"order": rng.uniform(0.3, 0.7), "coefficient": size}]
    keys = {"stiffness": size * 10.0 ** rng.uniform(-0.5, 0.5), "damping": damping}
    initial = {"position": rng.uniform(0.5, 1.0), "velocity": rng.uniform(-1.0, 1.0)}
    scene = build_problem(
        {"kind": "damped-oscillator", "final_time": 10.0, "initial": initial, **keys}
    ).scene
    method = Method(cq="gauss", degree=int(rng.integers(2, most_stages + 1)), start=start)
    run = integrate(scene, method, 50, with_steps=True)
    motion, times = dense_motion([scene], method, [run.steps]), np.linspace(0.0, 10.0, 601)[1:]
    exact = match_scene(scene).position
    plain = replace(motion, shapes=motion.steps)
    between, own = (
        np.abs(one.position(*one.located(0, times)) - exact(times)).max() for one in (motion, plain)
    )
    return np.abs(run.position - exact(run.time)).max(), between, own


@pytest.mark.parametrize("seed", range(4))
def test_between_points_a_stiff_motion_holds(seed):
    at_points, between, _ = errors(seed)
    assert at_points < 0.05
    assert between < 12 * at_points


def worsening(seed: int) -> float:
    """Error between points of a stiff motion with a plain start over that of its polynomials."""
    _, between, own = errors(seed, "none", (2, 5), 6)
    return between / own


@pytest.mark.parametrize("seed", range(8))
def test_it_is_hardly_worse_than_its_own_polynomials(seed):
    assert worsening(seed) < 8


def test_velocities_of_momenta_would_spoil_it():
    near = "fvi_cli.integrator.observations.motion.are_nearer"
    with mock.patch(near, lambda momenta, _: np.full(momenta.shape[1:], True)):
        found = [errors(seed) for seed in range(4)]
        assert max(between / at_points for at_points, between, _ in found) > 100
        assert max(worsening(seed) for seed in range(8)) > 16
