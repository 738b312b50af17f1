"""Accuracy and time beside other packages, on problems that all of them can take.

pycaputo takes systems of Caputo equations of orders up to 1, so that one fractional damper of order
gamma below 1 gives the system D^gamma x = w, D^(1 - gamma) w = v, v' = -mu w - V'(x). Its history
is a sum over all steps before. SciPy's DOP853 knows no memory: it takes the problem of order 1.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import fvi_cli as fvi
from benchmarks.measuring import least_seconds, number, table

Array = NDArray[np.float64]
Solver = Callable[["PeerProblem", int], Array]
STEPS = (64, 256, 1024)
MU, END = 0.4, 10.0


class PeerProblem(NamedTuple):
    """x'' + 0.4 D^gamma x + V'(x) = 0, x(0) = 1, x'(0) = 0 on [0, 10]."""

    name: str
    order: float  # gamma
    force: Callable[[Array], Array]  # V'(x)
    slope: Callable[[Array], Array]  # V''(x)
    make: Callable[..., fvi.Scene]

    @property
    def scene(self) -> fvi.Scene:
        """The same for the package."""
        damping = [fvi.FractionalDamping(order=self.order, coefficient=MU)]
        return self.make(damping=damping, initial_position=1.0, final_time=END)


class PeerRow(NamedTuple):
    """One run: largest error of the position on its grid, and the least seconds of three runs."""

    problem: str
    method: str
    n_steps: int
    error: float
    seconds: float


_oscillator = functools.partial(fvi.linear_oscillator, stiffness=4.0)
_spring = (lambda x: 4.0 * x), (lambda x: np.full_like(x, 4.0))
PROBLEMS = (
    PeerProblem("oscillator, order 1/2", 0.5, *_spring, _oscillator),
    PeerProblem("pendulum, order 1/2", 0.5, np.sin, np.cos, fvi.pendulum),
    PeerProblem("oscillator, order 1", 1.0, *_spring, _oscillator),
)


def _of_package(name: str, problem: PeerProblem, n_steps: int) -> Array:
    return np.asarray(fvi.integrate(problem.scene, name, n_steps).position[:, 0])


def _pycaputo(scheme: str, problem: PeerProblem, n_steps: int) -> Array:
    methods = importlib.import_module("pycaputo.fode.caputo")
    derivative = importlib.import_module("pycaputo.derivatives").CaputoDerivative
    controller = importlib.import_module("pycaputo.controller").make_fixed_controller
    stepping = importlib.import_module("pycaputo.stepping")
    h = END / n_steps

    def rate(t: float, y: Array) -> Array:
        return np.array([y[1], y[2], -MU * y[1] - problem.force(y[:1])[0]])

    def jacobian(t: float, y: Array) -> Array:
        last = [-problem.slope(y[:1])[0], -MU, 0.0]
        return np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], last])

    more = {"corrector_iterations": 1} if scheme == "PECE" else {"source_jac": jacobian}
    stepper = getattr(methods, scheme)(
        ds=tuple(map(derivative, (problem.order, 1.0 - problem.order, 1.0))),
        # round-off may end it a step early: one more is asked for and not used
        control=controller(h, tstart=0.0, nsteps=n_steps + 1),
        source=rate,
        y0=(np.array([1.0, 0.0, 0.0]),),
        **more,
    )
    events = itertools.islice(stepping.evolve(stepper, dtinit=h), n_steps + 1)
    return np.array([event.y[0] for event in events])


def _dop853(problem: PeerProblem, n_steps: int) -> Array:
    def rate(t: float, y: Array) -> Array:
        return np.array([y[1], -MU * y[1] - problem.force(y[:1])[0]])

    points, step = np.linspace(0.0, END, n_steps + 1), END / n_steps
    # the step is fixed: the tolerance is met whatever it is
    found = solve_ivp(
        rate,
        (0.0, END),
        [1.0, 0.0],
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
    found: dict[str, Solver] = {
        f"fvi {name}": functools.partial(_of_package, name) for name in names
    }
    if problem.order == 1.0:
        return {**found, "SciPy DOP853": _dop853}
    if importlib.util.find_spec("pycaputo"):
        found["pycaputo PECE"] = functools.partial(_pycaputo, "PECE")
        found["pycaputo trapezoidal"] = functools.partial(_pycaputo, "Trapezoidal")
    return found


def run_peers(steps: Sequence[int] = STEPS) -> list[PeerRow]:
    """Every method on every problem it takes."""
    rows = []
    for problem in PROBLEMS:
        reference = fvi.solve(problem.scene, tolerance=1e-12)
        for (name, solver), n_steps in itertools.product(solvers(problem).items(), steps):
            solve = functools.partial(solver, problem, n_steps)
            exact = reference(np.linspace(0.0, END, n_steps + 1))[:, 0]
            error = float(np.abs(solve() - exact).max())
            rows.append(PeerRow(problem.name, name, n_steps, error, least_seconds(solve, 3)))
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
            [*row[:2], str(row.n_steps), number(row.error, ".1e"), number(row.seconds, ".2g")]
            for row in rows
        ),
    )
