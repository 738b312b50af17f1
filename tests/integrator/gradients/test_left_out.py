"""Gradients by all numbers of a scene, of which one or another has no derivative."""

import os
import random
from dataclasses import replace

import numpy as np
import pytest
from letters import spring, swing
from spread import SEED

import fvi_cli as fvi

STEPS = 60


def drawn(place: int) -> fvi.Scene:
    """Riemann-Liouville damping above order 1, beside another term in some scenes."""
    chance = random.Random(f"{os.environ[SEED]} left out {place}")
    terms = [(chance.uniform(1.1, 1.9), chance.uniform(0.1, 0.6))]
    if place % 2:
        terms.insert(0, (chance.uniform(0.1, 0.9), chance.uniform(0.1, 0.6)))
    make = (spring, swing)[place % 3 == 0]
    return make(
        *terms,
        T=chance.uniform(1.0, 4.0),
        v=chance.choice([-1.0, 1.0]) * chance.uniform(0.3, 2.0),
        derivative="riemann-liouville",
    )


@pytest.mark.few(2)
@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("text", ["", "vx**2 + x"])
def test_what_has_no_derivative_is_left_out_of_all(place, text):
    scene = drawn(place)
    end = scene.final_time
    quantity = fvi.quantity_at(text, end) if text else fvi.position_at(end)
    found = fvi.gradient(scene, "gauss4", STEPS, quantity)
    assert list(found.left_out) == ["initial_position"]
    assert "not integrable" in found.left_out["initial_position"]
    assert {"mass", "damping.0.order", "initial_velocity"} <= set(found.derivatives)
    # the same as by name
    for name, derivative in found.derivatives.items():
        alone = fvi.gradient(scene, "gauss4", STEPS, quantity, [name])
        assert not alone.left_out
        assert np.allclose(alone[name], derivative, rtol=1e-12, atol=0)
    # and what the program computes for other velocities
    h = 1e-4
    values = [
        fvi.gradient(
            replace(scene, initial_velocity=scene.initial_velocity + s * h),
            "gauss4",
            STEPS,
            quantity,
            ["mass"],
        ).value
        for s in (1, -1)
    ]
    assert found["initial_velocity"][0] == pytest.approx((values[0] - values[1]) / 2 / h, rel=1e-5)


def test_nothing_is_left_out_where_all_exist():
    """The control: Caputo, and Riemann-Liouville below order 1."""
    for order, derivative in ((1.5, "caputo"), (0.5, "riemann-liouville")):
        scene = spring((order, 0.3), T=2.0, x=0.5, v=1.0, derivative=derivative)
        found = fvi.gradient(scene, "gauss4", STEPS, fvi.position_at(2.0))
        assert not found.left_out
        assert found["initial_position"].shape == (1,)
