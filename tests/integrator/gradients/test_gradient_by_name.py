"""Derivatives by names of numbers: of scenes, experiments and functions that make scenes."""

from typing import Any

import numpy as np
import pytest
from letters import spring, swing

import fvi_cli as fvi
from fvi_cli.effects.scene import Scene
from fvi_cli.scenes.registry import build_problem


def pendulum(omega: float = 1.2, x: float = 2.0) -> Scene:
    return swing((0.6, 0.3), T=6.0, omega=omega, x=x, v=0.4, forcing="0.3*sin(2*t)")


def test_numbers_of_a_scene_by_name():
    scene = spring(
        (0.6, [[0.4, -0.1], [-0.1, 0.2]]),
        T=3.0,
        m=[[2.0, 0.3], [0.3, 1.0]],
        k=[[3.0, -1.0], [-1.0, 2.0]],
        x=[1.0, 0.0],
    )
    found = fvi.gradient(scene, "gauss4-none", 12, fvi.position_at(2.5, 1))
    assert set(found.derivatives) == {
        "mass",
        "stiffness",
        "damping.0.order",
        "damping.0.coefficient",
        "initial_position",
        "initial_velocity",
    }
    for whole in ("mass", "stiffness", "damping.0.coefficient"):
        assert found[whole].shape == (2, 2)
        np.testing.assert_allclose(found[whole], found[whole].T)
    # a common factor of all forces changes nothing, and the motion is linear in the initial data
    entries = fvi.gradient(
        lambda factor: spring(
            (0.6, factor * scene.damping[0].coefficient),
            T=3.0,
            m=factor * scene.inertia.mass,
            k=factor * scene.potential.stiffness,
            x=[1.0, 0.0],
        ),
        "gauss4-none",
        12,
        fvi.position_at(2.5, 1),
        {"factor": 1.0},
    )
    # up to the round-off of differences of the numbers
    assert abs(entries["factor"]) < 1e-10
    together = (
        np.sum(found["mass"] * scene.inertia.mass)
        + np.sum(found["stiffness"] * scene.potential.stiffness)
        + np.sum(found["damping.0.coefficient"] * scene.damping[0].coefficient)
    )
    assert abs(together) < 1e-12 * np.abs(found["mass"]).sum()
    assert found["initial_position"] @ [1.0, 0.0] == pytest.approx(found.value, rel=1e-12)


FRAME = {
    "name": "shaken",
    "problem": {
        "kind": "frame",
        "storeys": 2,
        "stiffness": [30.0, 20.0],
        "dampers": [{"order": 0.5, "coefficient": 0.8}],
        "ground_acceleration": "3*exp(-t)*sin(4*t)",
        "final_time": 3.0,
    },
    "method": {"rk": "gauss", "degree": 8},
    "ladder": {"steps": [16]},
    "quantities": {"drift": "x2 - x1", "felt": "ax2 + ground_acceleration", "heat": "work_1"},
}


def test_quantities_of_an_experiment():
    (experiment,) = fvi.load(FRAME).experiments
    changed = {**FRAME, "output": {"times": [1.3]}}
    (outcome,) = fvi.run(changed)
    stored = outcome.finished[0].trajectory.observed.quantities
    names = ["damping.0.order", "stiffness"]
    for name in ("drift", "felt"):
        found = fvi.gradient(experiment, "gauss8", 16, fvi.quantity_at(name, 1.3), names)
        assert found.value == pytest.approx(float(stored[name][0]), rel=1e-9)

        def of(order: float, name: str = name) -> Any:
            dampers = [{"order": order, "coefficient": 0.8}]
            return build_problem({**FRAME["problem"], "dampers": dampers})

        text = FRAME["quantities"][name]
        again = fvi.gradient(of, "gauss8", 16, fvi.quantity_at(text, 1.3), {"order": 0.5})
        assert again["order"] == pytest.approx(float(found["damping.0.order"]), rel=1e-9)
    with pytest.raises(ValueError, match="work_1 adds up"):
        fvi.gradient(experiment, "gauss8", 16, fvi.quantity_at("heat", 1.3), names)
    bouncing = {**FRAME, "impacts": {"wall": {"when": "x1 + 0.05"}}}
    (experiment,) = fvi.load(bouncing).experiments
    with pytest.raises(ValueError, match="impacts: a motion that bounces has no derivatives"):
        fvi.gradient(experiment, "gauss8", 16, fvi.quantity_at("drift", 1.3), names)


def test_parameters_in_expressions():
    """Energies have the numbers of the scene in them, also where these stand for themselves."""

    # the argument x is the angle at the start, the x in an expression that of the time
    energy = "vx**2/2 + omega**2*(1 - cos(x))"
    given = {"omega": 1.2, "x": 2.0}
    found = fvi.gradient(pendulum, "gauss8", 24, fvi.quantity_at(energy, 2.5), given)
    named = fvi.gradient(
        pendulum(), "gauss8", 24, fvi.quantity_at(energy, 2.5), ["potential.omega"]
    )
    assert found["omega"] == pytest.approx(float(named["potential.omega"]), rel=1e-9)
    sides = [
        fvi.integrate(
            pendulum(1.2 + h),
            "gauss8",
            24,
            quantities={"e": energy},
            output=[2.5],
            parameters={"omega": 1.2 + h},
        ).observed.quantities["e"][0]
        for h in (1e-4, -1e-4)
    ]
    assert found["omega"] == pytest.approx((sides[0] - sides[1]) / 2e-4, rel=1e-6)
