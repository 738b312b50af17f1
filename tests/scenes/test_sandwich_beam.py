"""Adaptive steps of a sandwich beam of few and of many finite elements."""

import pytest
from oracles.sandwich_beam import sandwich_beam

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.method import Method


def pushed(elements: int) -> Scene:
    force = ["0"] * (4 * elements)
    force[-4] = "exp(-((t-0.002)/0.0004)**2)"
    return sandwich_beam(elements, final_time=0.01, forcing=force)


def test_adaptive_steps_follow_the_motion_and_not_the_finest_modes():
    method, steps = Method(cq="gauss", degree=4, start="graded"), AdaptiveSteps(tolerance=1e-7)
    coarse, fine = (integrate(pushed(elements), method, steps) for elements in (6, 48))
    # the highest frequency is 64 times as high
    assert fine.n_steps == pytest.approx(coarse.n_steps, rel=0.15)
    finer = integrate(pushed(48), Method(cq="gauss", degree=5, start="graded"), 400)
    assert fine.position[-1] == pytest.approx(finer.position[-1], abs=2e-10)
