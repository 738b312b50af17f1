"""The three problems of the paper and their ladders (arXiv 2403.18362, numerical examples)."""

import numpy as np

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import build_problem

LADDER_UNIT = tuple(2**j for j in range(1, 9))
LADDER_OSCILLATOR = tuple(2**j for j in range(4, 12))


def damped_oscillator() -> Problem:
    return _problem(
        kind="damped-oscillator",
        damping=[{"order": 1.0, "coefficient": 0.2}],
        initial={"position": 0.0, "velocity": 1.2},
        final_time=16.0,
        exact="1.2*exp(-t/10)*sin(sqrt(0.99)*t)/sqrt(0.99)",
    )


def bagley_torvik_quarter() -> Problem:
    """alpha = 1/4 in the paper: order 1/2 in the equation."""
    return _problem(
        kind="bagley-torvik",
        damping=[{"order": 0.5, "coefficient": 1.0}],
        forcing="6*t + 6/gamma(3.5)*t**2.5 + t**3",
        final_time=1.0,
        exact="t**3",
    )


def bagley_torvik_three_quarters() -> Problem:
    """alpha = 3/4 in the paper: order 3/2 in the equation."""
    return _problem(
        kind="bagley-torvik",
        damping=[{"order": 1.5, "coefficient": 1.0}],
        forcing="15/4*sqrt(t) + 15/8*sqrt(pi)*t + t**2.5",
        final_time=1.0,
        exact="t**2.5",
    )


def _problem(**specification: object) -> Problem:
    return build_problem(specification)


def errors(problem: Problem, method: Method, ladder: tuple[int, ...]) -> np.ndarray:
    """Maximum-norm errors over the grid."""
    assert problem.exact is not None
    result = []
    for n_steps in ladder:
        trajectory = integrate(problem.scene, method, n_steps)
        assert trajectory.status == "ok"
        result.append(np.abs(trajectory.position - problem.exact(trajectory.time)).max())
    return np.array(result)


def slope(ladder: tuple[int, ...], values: np.ndarray) -> float:
    return float(-np.polyfit(np.log(ladder), np.log(values), 1)[0])


def last_order(values: np.ndarray) -> float:
    return float(np.log2(values[-2] / values[-1]))
