"""Runs as polynomials: values between the points of the mesh."""

import numpy as np
import pytest
from letters import spring, swing
from oracles.linear_response import match_scene

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import graded_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.steps import RunSteps

SCENE = spring((0.5, 0.7), T=8.0, k=2.0, x=1.0, v=0.5)
STEPS = {
    "equal": 64,
    "graded": graded_mesh(8.0, 64, 3.0),
    "adaptive": AdaptiveSteps(tolerance=1e-8),
}


def steps_of(name: str, m: int = 4, scene=SCENE) -> RunSteps:
    found = integrate(scene, Method(cq="gauss", degree=m), STEPS[name], with_steps=True)
    return found.steps


def exact(times: np.ndarray) -> np.ndarray:
    found = match_scene(SCENE)
    return found.position(times)


@pytest.mark.parametrize("name", sorted(STEPS))
def test_the_closed_form_between_the_points(name):
    steps = steps_of(name, m=8)
    times = np.random.default_rng(2).uniform(0.0, 8.0, 300)
    tolerance = 1e-4 if name == "equal" else 1e-6
    assert np.abs(steps(times) - exact(times)).max() < tolerance
    d = 1e-5
    inner = np.clip(times, 2 * d, 8 - 2 * d)
    slope = (exact(inner + d) - exact(inner - d)) / (2 * d)
    assert np.abs(steps.velocity_at(inner) - slope).max() < 100 * tolerance
    # a control: another motion is told apart
    assert np.abs(steps(times) - 1.001 * exact(times)).max() > 1e-4


@pytest.mark.parametrize("cq", ["gauss", "lobatto-iiic"])
def test_it_is_continuous_and_passes_through_the_points(cq):
    for scene in (SCENE, swing(T=8.0, x=1.0, damping=SCENE.damping)):
        found = integrate(scene, Method(cq=cq, degree=3), 100, with_steps=True)
        steps = found.steps
        assert np.abs(steps(steps.time) - steps.position).max() < 1e-13
        before = np.nextafter(steps.time[1:], 0.0)
        assert np.abs(steps(before) - steps.position[1:]).max() < 1e-13
        assert np.abs(steps(steps.stage_time) - steps.stage_position).max() < 1e-12
        # velocities at stages inside a step are the polynomial's own; they jump at its ends
        inside = slice(1, -1) if cq == "lobatto-iiic" else slice(0, 2)
        at = steps.velocity_at(steps.stage_time[:, inside])
        assert np.abs(at - steps.velocity[:, inside]).max() < 1e-11
