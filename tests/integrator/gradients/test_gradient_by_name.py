"""Derivatives by names of numbers: of scenes and experiments."""

import numpy as np
import pytest
from letters import spring

import fvi_cli as fvi
from fvi_cli.scenes.registry import build_problem


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
    together = (
        np.sum(found["mass"] * scene.inertia.mass)
        + np.sum(found["stiffness"] * scene.potential.stiffness)
        + np.sum(found["damping.0.coefficient"] * scene.damping[0].matrix)
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
        "parameters": {"w": 4.0},
        "ground_acceleration": "3*exp(-t)*sin(w*t)",
        "final_time": 3.0,
    },
    "method": {"rk": "gauss", "degree": 8},
    "ladder": {"steps": [16]},
    "quantities": {"drift": "x2 - x1", "felt": "ax2 + ground_acceleration"},
}


def test_quantities_of_an_experiment():
    (experiment,) = fvi.load(FRAME).experiments
    changed = {**FRAME, "output": {"times": [1.3]}}
    (outcome,) = fvi.run(changed)
    stored = outcome.finished[0].trajectory.observed.quantities
    for name in ("drift", "felt"):
        of = fvi.quantity_at(name, 1.3)
        found = fvi.gradient(experiment, "gauss8", 16, of, ["w", "forcing.w"])
        assert found.value == pytest.approx(float(stored[name][0]), rel=1e-9)
        # by differences of the problem, and by its formulas
        assert float(found["w"]) == pytest.approx(float(found["forcing.w"]), rel=1e-9)


def test_a_parameter_of_an_experiment_wherever_it_stands():
    """In the masses, in the potential and in the quantity; the control: in the potential alone."""
    problem = {
        "kind": "lagrangian",
        "coordinates": ["x"],
        "parameters": {"m": 1.3},
        "lagrangian": "m*vx**2/2 + 2*m*cos(x) - x**4",
        "initial": {"position": [1.0]},
        "final_time": 4.0,
    }
    config = {"name": "a", "problem": problem, "method": "gauss4", "ladder": {"steps": [60]}}
    (experiment,) = fvi.load(config).experiments
    quantity = fvi.quantity_at("m*vx", 3.0)
    found = fvi.gradient(experiment, "gauss4", 60, quantity, ["m", "potential.m"])

    def value(m: float) -> float:
        changed = build_problem({**problem, "parameters": {"m": m}})
        return fvi.gradient(changed, "gauss4", 60, quantity, []).value

    slope = (value(1.3 + 1e-4) - value(1.3 - 1e-4)) / 2e-4
    assert float(found["m"]) == pytest.approx(slope, rel=1e-6)
    assert abs(float(found["potential.m"]) - slope) > 0.1
