"""Accuracy and time beside other packages, on problems that all of them can take.

pycaputo takes systems of Caputo equations of orders up to 1, so that one fractional damper of order
gamma below 1 gives the system D^gamma x = w, D^(1 - gamma) w = v, v' = -mu w - V'(x). Its history
is a sum over all steps before. SciPy's DOP853 knows no memory: it takes the problem of order 1.
"""

from __future__ import annotations

import importlib
import importlib.util
import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import fvi_cli as fvi
from benchmarks.measuring import number, table

Array = NDArray[np.float64]
Solver = Callable[["PeerProblem", int], Array]
STEPS = (64, 256, 1024)
MASS, START = 1.0, 1.0


@dataclass(frozen=True, kw_only=True)
class PeerProblem:
    """x'' + mu D^gamma x + V'(x) = 0, x(0) = 1, x'(0) = 0 on [0, T].

    Parameters
    ----------
    name
        The problem in words.
    order, coefficient
        gamma and mu.
    force
        V'(x).
    slope
        V''(x).
    scene
        The same for the package.
    """

    name: str
    order: float
    coefficient: float
    force: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    scene: fvi.Scene


@dataclass(frozen=True, kw_only=True)
class PeerRow:
    """One run: largest error of the position on its grid, and the least seconds of three runs."""

    problem: str
    method: str
    n_steps: int
    error: float
    seconds: float


def peer_problems() -> list[PeerProblem]:
    """A linear oscillator and a pendulum with a springpot, and the oscillator with a dashpot."""

    def made(name: str, order: float, make: Callable[..., fvi.Scene], **more: float) -> PeerProblem:
        scene = make(
            damping=[fvi.FractionalDamping(order=order, coefficient=0.4)],
            initial_position=START,
            final_time=10.0,
            **more,
        )
        is_linear = "stiffness" in more
        return PeerProblem(
            name=name,
            order=order,
            coefficient=0.4,
            force=(lambda x: 4.0 * x) if is_linear else np.sin,
            slope=(lambda x: np.full_like(x, 4.0)) if is_linear else np.cos,
            scene=scene,
        )

    return [
        made("oscillator, order 1/2", 0.5, fvi.linear_oscillator, stiffness=4.0),
        made("pendulum, order 1/2", 0.5, fvi.pendulum),
        made("oscillator, order 1", 1.0, fvi.linear_oscillator, stiffness=4.0),
    ]


def _of_package(name: str) -> Solver:
    return lambda problem, n_steps: np.asarray(
        fvi.integrate(problem.scene, name, n_steps).position[:, 0]
    )


def _pycaputo(scheme: str) -> Solver:
    def solve(problem: PeerProblem, n_steps: int) -> Array:
        methods = importlib.import_module("pycaputo.fode.caputo")
        derivative = importlib.import_module("pycaputo.derivatives").CaputoDerivative
        controller = importlib.import_module("pycaputo.controller").make_fixed_controller
        stepping = importlib.import_module("pycaputo.stepping")
        h = problem.scene.final_time / n_steps

        def rate(t: float, y: Array) -> Array:
            return np.array([y[1], y[2], -problem.coefficient * y[1] - problem.force(y[:1])[0]])

        def jacobian(t: float, y: Array) -> Array:
            last = [-problem.slope(y[:1])[0], -problem.coefficient, 0.0]
            return np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], last])

        more = {"corrector_iterations": 1} if scheme == "PECE" else {"source_jac": jacobian}
        stepper = getattr(methods, scheme)(
            ds=tuple(map(derivative, (problem.order, 1.0 - problem.order, 1.0))),
            # round-off may end it a step early: one more is asked for and not used
            control=controller(h, tstart=0.0, nsteps=n_steps + 1),
            source=rate,
            y0=(np.array([START, 0.0, 0.0]),),
            **more,
        )
        events = itertools.islice(stepping.evolve(stepper, dtinit=h), n_steps + 1)
        return np.array([event.y[0] for event in events])

    return solve


def _dop853(problem: PeerProblem, n_steps: int) -> Array:
    from scipy.integrate import solve_ivp

    def rate(t: float, y: Array) -> Array:
        return np.array([y[1], -problem.coefficient * y[1] - problem.force(y[:1])[0]])

    end = problem.scene.final_time
    points = np.linspace(0.0, end, n_steps + 1)
    step = end / n_steps
    # the step is fixed: the tolerance is met whatever it is
    found = solve_ivp(
        rate,
        (0.0, end),
        [START, 0.0],
        "DOP853",
        points,
        first_step=step,
        max_step=step,
        rtol=1.0,
        atol=1.0,
    )
    return np.asarray(found.y[0])


def solvers(problem: PeerProblem) -> dict[str, Solver]:
    """Methods of this package, and those of others that are installed and take the problem."""
    names = ["gauss2", "gauss3", "bdf2", "gruenwald-letnikov", "product-integration"]
    found = {f"fvi {name}": _of_package(name) for name in names}
    if problem.order == 1.0:
        return {**found, "SciPy DOP853": _dop853}
    if importlib.util.find_spec("pycaputo"):
        found["pycaputo PECE"] = _pycaputo("PECE")
        found["pycaputo trapezoidal"] = _pycaputo("Trapezoidal")
    return found


def run_peers(steps: Sequence[int] = STEPS) -> list[PeerRow]:
    """Every method on every problem it takes."""
    rows = []
    for problem in peer_problems():
        reference = fvi.solve(problem.scene, tolerance=1e-12)
        for (name, solve), n_steps in itertools.product(solvers(problem).items(), steps):
            exact = reference(np.linspace(0.0, problem.scene.final_time, n_steps + 1))[:, 0]
            least = float("inf")
            for _ in range(3):
                began = time.process_time()
                position = solve(problem, n_steps)
                least = min(least, time.process_time() - began)
            error = float(np.abs(position - exact).max())
            rows.append(
                PeerRow(
                    problem=problem.name, method=name, n_steps=n_steps, error=error, seconds=least
                )
            )
    return rows


def peers_table(rows: Sequence[PeerRow]) -> str:
    """Markdown: errors and times of every method on every problem."""
    remark = (
        "x'' + 0.4 D^gamma x + V'(x) = 0, x(0) = 1, x'(0) = 0 on [0, 10], with V' = 4x or sin x: "
        "largest error of the position on the grid against a run to 1e-12, and processor seconds, "
        "the least of three runs. Packages that are not installed are left out."
    )
    return table(
        remark,
        ["problem", "method", "N", "error", "seconds"],
        (
            [
                row.problem,
                row.method,
                str(row.n_steps),
                number(row.error, ".1e"),
                number(row.seconds, ".2g"),
            ]
            for row in rows
        ),
    )
