"""What the paper's text and tables print (arXiv 2403.18362), against what the package computes.

The paper prints data, intervals, step sizes and orders, and no errors. Errors stand here as an
implementation of its recursion, written out, gives them.
"""

import math

import numpy as np
import pytest
from paper_problems import damped_oscillator
from test_routes import literal_galerkin

import fvi_cli as fvi
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.study import execute

# sections "Numerical experiment": mu, alpha, x(0), x'(0), T, and h = T/2^i for these i
PRINTED = {
    "damped-oscillator": (0.2, 1 / 2, 0.0, 1.2, 16.0, range(4, 12)),
    "bagley-torvik-1-2": (1.0, 1 / 4, 0.0, 0.0, 1.0, range(1, 9)),
    "bagley-torvik-3-2": (1.0, 3 / 4, 0.0, 0.0, 1.0, range(1, 9)),
}
# Tables 1 and 2: the orders by BDF1, BDF2, BDF3
TABLES = {
    1: {
        "damped-oscillator": (1.0, 2.0, 2.0),
        "bagley-torvik-1-2": (1.0, 2.0, 2.0),
        "bagley-torvik-3-2": (1.0, 1.8, 1.8),
    },
    2: {
        "damped-oscillator": (1.0, 2.0, 2.0),
        "bagley-torvik-1-2": (1.0, 2.0, 2.0),
        "bagley-torvik-3-2": (1.0, 2.0, 2.0),
    },
}


def forcing(alpha: float, t: np.ndarray) -> np.ndarray:
    if alpha == 1 / 4:
        return t**3 + 6 * t + 3.2 / math.gamma(1 / 2) * t**2 * np.sqrt(t)
    if alpha == 3 / 4:
        return 15 / 4 * np.sqrt(t) + 15 / 8 * math.sqrt(math.pi) * t + t**2 * np.sqrt(t)
    return np.zeros_like(t)


def solution(alpha: float, t: np.ndarray) -> np.ndarray:
    if alpha == 1 / 2:
        # x'' + 0.2 x' + x = 0 by its characteristic roots
        root = -0.1 + 1j * math.sqrt(0.99)
        return 1.2 * (np.exp(root * t)).imag / root.imag
    return t**3 if alpha == 1 / 4 else t ** (5 / 2)


def experiments(name: str) -> list[Experiment]:
    """All that are the paper's problem of this name."""
    of_their_own = list(fvi.load(name).experiments)
    if name == "damped-oscillator":
        of_their_own += fvi.load("damped-oscillator-comparison").experiments
    if name == "bagley-torvik-3-2":
        for other in ("bagley-torvik-3-2-long", "corrected-bdf3"):
            of_their_own += fvi.load(other).experiments
    together = ("table-1", "table-2", "full-order")
    listed = [one for config in together for one in fvi.load(config).experiments]
    return of_their_own + [one for one in listed if one.name.endswith(name)]


@pytest.mark.parametrize("name", PRINTED)
def test_the_data_are_those_of_the_text(name):
    mu, alpha, position, velocity, end, _ = PRINTED[name]
    found = experiments(name)
    assert len(found) >= 4
    for experiment in found:
        problem = experiment.problem
        scene = problem.scene
        (term,) = scene.damping
        assert (term.order, scene.final_time) == (2 * alpha, end)
        assert term.coefficient == pytest.approx(mu)
        assert scene.initial_position == pytest.approx(position, abs=0)
        assert scene.initial_velocity == pytest.approx(velocity, abs=0)
        t = np.linspace(0.0, end, 33)[1:]
        force = np.zeros(32) if scene.forcing is None else scene.forcing(t)[..., 0]
        assert force == pytest.approx(forcing(alpha, t), rel=1e-14)
        assert problem.exact is not None
        assert problem.exact(t)[:, 0] == pytest.approx(solution(alpha, t), rel=1e-12)


@pytest.mark.parametrize("number", TABLES)
def test_steps_and_stated_orders_are_those_of_the_tables(number):
    for experiment in fvi.load(f"table-{number}").experiments:
        name = experiment.name.removeprefix(f"table-{number}-")
        end, exponents = PRINTED[name][-2:]
        assert [run.step_size for run in experiment.runs()][: len(exponents)] == [
            end / 2**i for i in exponents
        ]
        assert {method.degree for method in experiment.methods} == {number}
        claims = tuple(experiment.claim(method) for method in experiment.methods)
        assert claims == TABLES[number][name]
        # and in the file of the problem, where both degrees are together
        (alone,) = fvi.load(name).experiments
        assert claims == tuple(alone.claim(method) for method in experiment.methods)


def test_bdf1_at_the_step_size_of_the_figures():
    """h = 0.125: error 2.190e-2; the energy begins with 1.2^2 / 2 = 0.72."""
    (experiment,) = fvi.load("damped-oscillator-comparison").experiments
    run = next(run for run in experiment.runs() if run.method.case.startswith("bdf1"))
    assert run.step_size == 0.125
    ours = execute(run)
    method = fvi.Method(cq="bdf1", sampling="nodes", degree=1)
    theirs = literal_galerkin(1.0, 0.2, 1.0, 1.2, np.zeros_like, 16.0, 128, method)
    error = np.abs(theirs - solution(1 / 2, np.linspace(0, 16, 129))).max()
    assert error == pytest.approx(2.190e-2, rel=3e-4)
    assert ours.error == pytest.approx(error, rel=1e-10)
    assert ours.trajectory.energy[0] == pytest.approx(0.72, rel=1e-15)
    assert damped_oscillator().scene.initial_velocity == pytest.approx(1.2)
