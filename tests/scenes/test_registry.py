"""Problems from plain mappings."""

import numpy as np
import pytest

from fvi_cli.scenes.registry import build_problem


def test_a_pendulum_has_no_exact_solution():
    problem = build_problem({"kind": "pendulum", "final_time": 1.0, "omega": 2.0})
    assert problem.exact is None
    assert problem.exact_source == "unknown"
    assert problem.scene.potential.gradient(np.array([[0.5]]))[0, 0] == pytest.approx(
        4 * np.sin(0.5)
    )


def test_matrices_numbers_and_vectors_are_brought_to_one_size():
    problem = build_problem(
        {
            "kind": "damped-oscillator",
            "mass": 2.0,
            "stiffness": [[2.0, -1.0], [-1.0, 2.0]],
            "damping": [{"order": 0.5, "coefficient": 0.1}],
            "forcing": ["t", "0"],
            "initial": {"position": [1.0, 0.0], "velocity": 0.0},
            "final_time": 1.0,
        }
    )
    scene = problem.scene
    assert scene.dimension == 2
    assert scene.inertia.mass.tolist() == [[2.0, 0.0], [0.0, 2.0]]
    assert scene.damping[0].coefficient.tolist() == [[0.1, 0.0], [0.0, 0.1]]
    assert scene.initial_velocity.tolist() == [0.0, 0.0]


def test_a_force_that_is_zero_is_no_effect():
    for forcing in (0, "0", "3 - 3"):
        problem = build_problem({"kind": "bagley-torvik", "final_time": 1.0, "forcing": forcing})
        assert problem.scene.forcing is None


def derivative(function: str, **changes: object) -> dict[str, object]:
    return {
        "kind": "fractional-derivative",
        "function": function,
        "order": 0.5,
        "final_time": 1.0,
        **changes,
    }


def test_a_derivative_is_taken_term_by_term():
    problem = build_problem(derivative("t**2"))
    t = np.array([0.0, 0.3, 1.0])
    # Gamma(3)/Gamma(5/2) t^(3/2)
    assert problem.exact(t)[:, 0] == pytest.approx(1.5045055561273502 * t**1.5, abs=1e-15)
    assert problem.function(t)[:, 0] == pytest.approx(t**2)
