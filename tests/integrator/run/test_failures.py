"""Runs that end before their time: steps that have no solution, and numbers that are not finite."""

import re

import numpy as np
import pytest
from letters import spring

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.scenes.lagrangian import lagrangian_scene


@pytest.mark.parametrize(
    "method", [Method(cq="bdf6", degree=1, sampling="nodes"), Baseline(name="explicit-euler")]
)
def test_an_unstable_run_ends_where_its_numbers_cease_to_be_finite(method):
    scene = spring((0.5, 0.1), T=400.0, k=1e9, x=1.0)
    if isinstance(method, Method):
        scene = spring((1.5, 0.3), T=400.0, k=4.0, x=1.0)
    found = integrate(scene, method, 2000)
    assert found.status == "failed"
    assert np.isfinite(found.position).all()
    # an energy is a square
    assert np.abs(found.position).max() > 1e145
    failed = float(re.search(r"t = ([\d.]+)", found.message)[1])
    assert found.time[-1] < failed < found.time[-1] + 0.201


@pytest.mark.parametrize("size", [1e-150, 1.0, 1e150])
def test_large_and_tiny_motions_are_finite(size):
    scene = spring((0.5, 0.3), T=40.0, x=size, v=3 * size)
    assert integrate(scene, Method(cq="gauss", degree=2), 256).status == "ok"


class TestFailures:
    """They name step and time, the same by every route."""

    METHOD = Method(cq="gauss", degree=2)
    SCENE = lagrangian_scene(
        final_time=4.0, coordinates=("x",), lagrangian="vx**2/2 + cos(x)", initial_velocity=[0.45]
    )

    def test_a_step_behind_blocks_is_named(self):
        """The force ends at x = 2, which is in the third chunk of steps."""
        scene = lagrangian_scene(
            final_time=4.0,
            coordinates=("x",),
            lagrangian="vx**2/2 + sqrt(2 - x)/1000",
            initial_velocity=[0.9],
        )
        found = integrate(scene, self.METHOD, 20_000)
        time, h = found.time[-1], 4.0 / 20_000
        assert time == pytest.approx(2.22, abs=0.02)
        assert f"step {round(time / h)}, t = {time:.6g}: " in found.message
