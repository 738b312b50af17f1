"""Relaxation laws under ``damping``: what they build."""

import numpy as np
import pytest

from fvi_cli.effects.scene import Scene
from fvi_cli.scenes.registry import build_scene

ZENER = {"law": "zener", "order": 0.5, "time": 0.2, "relaxed": 2.0, "unrelaxed": 5.0}
MAXWELL = {"law": "maxwell", "order": 0.5, "time": 0.2, "modulus": 5.0}
PRONY = {"law": "prony", "moduli": [1.0, 0.5], "times": [0.1, 1.0]}


def scene_of(law: dict[str, object], **keys: object) -> Scene:
    return build_scene({"kind": "damped-oscillator", "damping": [law], "final_time": 2.0, **keys})


@pytest.mark.parametrize(
    ("term", "modulus", "stiffness"),
    [
        (ZENER, 3.0 / (1 + 1 / 0.4**0.5), 3.0),
        (MAXWELL, 5.0 / (1 + 1 / 0.4**0.5), 1.0),
        (PRONY, 2 / 12 + 0.5 * 2 / 3, 1.0),
    ],
)
def test_every_law_has_its_modulus_and_adds_its_stiffness(term, modulus, stiffness):
    scene = scene_of(term)
    (law,) = scene.laws
    assert law.symbol(2.0) == pytest.approx(modulus)
    # the stiffness of the kind is 1
    assert scene.potential.stiffness[0, 0] == stiffness


def test_nonlinear_scenes_take_the_relaxed_modulus_into_their_potential():
    pendulum = scene_of(ZENER, kind="pendulum")
    force = pendulum.potential.gradient(np.array([0.7]))
    np.testing.assert_allclose(force, np.sin(0.7) + 1.4, rtol=1e-14)
    general = scene_of(
        {**ZENER, "acts_on": ["y - x"]},
        kind="lagrangian",
        coordinates=["x", "y"],
        lagrangian="(1 + x**2)*vx**2/2 + vy**2/2 - x**2/2",
    )
    force = general.lagrangian.forces(np.array([0.5, 0.1]), np.zeros(2), 0.0)[1]
    np.testing.assert_allclose(force, [-0.5 - 0.8, 0.8], rtol=1e-14)
