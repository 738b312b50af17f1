"""What the paper prints (arXiv 2403.18362), and its algorithm written out, against the package.

The paper prints data, intervals, step sizes and orders, and no errors.
"""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from spread import spread

import fvi_cli as fvi
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.bdf import convolution_weights
from fvi_cli.mathematics.lagrange import lobatto_basis
from fvi_cli.studies.experiment import Experiment

# sections "Numerical experiment": mu, alpha, x'(0) (from x = 0), T, and h = T/2^i for these i
PRINTED = {
    "damped-oscillator": (0.2, 1 / 2, 1.2, 16.0, range(4, 12)),
    "bagley-torvik-1-2": (1.0, 1 / 4, 0.0, 1.0, range(1, 9)),
    "bagley-torvik-3-2": (1.0, 3 / 4, 0.0, 1.0, range(1, 9)),
}
# Tables 1 and 2: the orders by BDF1, BDF2, BDF3
TABLES = {
    1: dict(zip(PRINTED, [(1.0, 2.0, 2.0), (1.0, 2.0, 2.0), (1.0, 1.8, 1.8)], strict=True)),
    2: dict.fromkeys(PRINTED, (1.0, 2.0, 2.0)),
}
RESULTS = Path(__file__).parents[2] / "results" / "tables"


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
    alone = {
        "damped-oscillator": ("damped-oscillator-comparison",),
        "bagley-torvik-3-2": ("bagley-torvik-3-2-long", "corrected-bdf3"),
    }
    found = [one for file in (name, *alone.get(name, ())) for one in fvi.load(file).experiments]
    together = [
        e for file in ("table-1", "table-2", "full-order") for e in fvi.load(file).experiments
    ]
    return found + [one for one in together if one.name.endswith(name)]


@pytest.mark.parametrize("name", PRINTED)
def test_the_data_are_those_of_the_text(name):
    mu, alpha, velocity, end, _ = PRINTED[name]
    found = experiments(name)
    assert len(found) >= 4
    for experiment in found:
        problem = experiment.problem
        scene = problem.scene
        (term,) = scene.damping
        assert (term.order, scene.final_time) == (2 * alpha, end)
        assert term.matrix == pytest.approx(mu)
        assert (scene.initial_position, scene.initial_velocity) == (0.0, velocity)
        t = np.linspace(0.0, end, 33)[1:]
        force = np.zeros(32) if scene.forcing is None else scene.forcing(t)[..., 0]
        assert force == pytest.approx(forcing(alpha, t), rel=1e-14)
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
        # and in the file of the problem, where both degrees are together
        (alone,) = fvi.load(name).experiments
        others = tuple(alone.claim(method) for method in experiment.methods)
        assert claims == others == TABLES[number][name]


def literal_galerkin(name: str, n_steps: int, method: Method, more: float = 0.0) -> np.ndarray:
    """One dense system per step in positions x_k^0..x_k^s and the momentum, from x = 0.

    `more` damping makes the control.
    """
    mu, alpha, p, end, _ = PRINTED[name]
    h, degree = end / n_steps, method.degree
    order = 2 * alpha
    w = (mu + more) * h ** (-order) * convolution_weights(method.bdf_order, order, n_steps + 1)
    nodes, weights = np.polynomial.legendre.leggauss(degree)
    c, b = (nodes + 1) / 2, weights / 2
    basis = lobatto_basis(degree)
    value, slope = basis.values(c), basis.derivatives(c)
    matrix = (slope * b) @ slope.T / h - h * (value * b) @ value.T
    # what the damping sees of a step, and where it acts: at its beginning, or at the Gauss points
    seen, acts = np.eye(degree + 1)[:, :1], np.eye(degree + 1)[:, :1]
    if method.sampling == "points":
        seen, acts = value, value * b
        # with the sample of the step itself
        matrix = matrix - h * w[0] * acts @ seen.T
    x = np.zeros(n_steps + 1)
    samples = np.zeros((n_steps, seen.shape[1]))
    for j in range(n_steps):
        load = h * (value * b) @ forcing(alpha, (j + c) * h)
        past = w[1 : j + 1] @ samples[:j][::-1]
        if method.sampling == "nodes":
            past = past + w[0] * x[j]
        # D L_d + load - kick = -p in row 0, 0 inside, and the next momentum in the last one
        known = load - h * acts @ past + matrix[:, 0] * x[j]
        right = -known[:-1]
        right[0] -= p
        inner = np.linalg.solve(matrix[:-1, 1:], right)
        x[j + 1] = inner[-1]
        p = matrix[-1, 1:] @ inner + known[-1]
        samples[j] = seen.T @ np.concatenate([[x[j]], inner])
    return x


@spread(degree=[1, 2, 3, 4], bdf=[1, 2, 3], sampling=["nodes", "points"], name=list(PRINTED))
def test_any_degree_is_the_algorithm_of_the_paper(degree, bdf, sampling, name):
    method = Method(cq=f"bdf{bdf}", sampling=sampling, degree=degree)
    ours = integrate(experiments(name)[0].problem.scene, method, 64).position[:, 0]
    assert np.abs(ours - literal_galerkin(name, 64, method)).max() <= 1e-12
    assert np.abs(ours - literal_galerkin(name, 64, method, 2e-4)).max() > 1e-8


@pytest.mark.few(3)
@pytest.mark.parametrize("bdf", [1, 2, 3])
@pytest.mark.parametrize("name", PRINTED)
@pytest.mark.parametrize("number", TABLES)
def test_errors_of_the_tables_are_those_of_the_algorithm(number, name, bdf):
    _, alpha, _, end, exponents = PRINTED[name]
    method = Method(cq=f"bdf{bdf}", sampling="nodes", degree=number)
    with (RESULTS / f"table-{number}.csv").open(encoding="utf-8", newline="") as file:
        printed = {
            int(row["n_steps"]): float(row["error"])
            for row in csv.DictReader(file)
            if (row["experiment"], row["cq"]) == (f"table-{number}-{name}", method.cq)
        }
    assert list(printed) == [2**i for i in exponents]
    for n_steps, error in printed.items():
        exact = solution(alpha, np.linspace(0.0, end, n_steps + 1))
        written_out = np.abs(literal_galerkin(name, n_steps, method) - exact).max()
        assert error == pytest.approx(written_out, rel=1e-4)
