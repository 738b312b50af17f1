"""Random scenes with tolerances, true errors of their runs, and the best choice by hand."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import nearest_fitting
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.planning.plan_seconds import machine_speed
from fvi_cli.scenes.lagrangian import double_pendulum
from fvi_cli.scenes.linear_response import match_scene
from fvi_cli.scenes.named import linear_oscillator, pendulum
from fvi_cli.scenes.nonlinear import duffing, kepler
from fvi_cli.studies.accuracy import reach_tolerance
from fvi_cli.studies.accuracy_results import Reached
from fvi_cli.studies.accuracy_settings import USUAL_CANDIDATES
from fvi_cli.studies.cost import forget
from fvi_cli.studies.experiment import Norm
from fvi_cli.studies.norms import error_norm

REFERENCE = Method(cq="gauss", degree=4, start="graded")
FINEST = 2**15
REPEATS = 5


@dataclass(frozen=True, kw_only=True)
class Task:
    """A scene with what is asked of it."""

    name: str
    scene: Scene
    tolerance: float
    norm: Norm


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What became of a task: times in seconds, of the search and of the best choice by hand."""

    task: Task
    reached: Reached
    true_error: float
    reference_error: float
    seconds: float
    best: str
    best_seconds: float

    @property
    def is_kept(self) -> bool:
        """Whether the true error lies below the tolerance."""
        return self.true_error <= self.task.tolerance

    @property
    def ratio(self) -> float:
        """Time of the search, all runs paid, over that of the best run."""
        return self.seconds / self.best_seconds

    def line(self) -> str:
        """The finding in a line of a table."""
        task, reached = self.task, self.reached
        chosen = f"{reached.method.case} {reached.n_steps}"
        return (
            f"{task.name:34s} {task.norm:5s} {task.tolerance:8.1e} {reached.verdict:8s}"
            f"{chosen:22s} {len(reached.attempts):2d} {reached.estimate:9.1e} "
            f"{self.true_error:9.1e} {1e3 * self.seconds:8.1f} {self.best:22s} "
            f"{1e3 * self.best_seconds:8.1f} {self.ratio:6.2f}"
        )


HEADING = (
    f"{'scene':34s} {'norm':5s} {'tol':>8s} {'verdict':8s}{'chosen':22s} "
    f"{'n':>2s} {'estimate':>9s} {'true':>9s} {'ms':>8s} {'best by hand':22s} {'ms':>8s} "
    f"{'ratio':>6s}"
)


def linear_tasks(count: int, seed: int) -> list[Task]:
    """Oscillators with one or two damping terms, free, driven or pushed, whose motion is known."""
    rng = np.random.default_rng(seed)
    return [_linear(rng, index) for index in range(count)]


def nonlinear_tasks(count: int, seed: int) -> list[Task]:
    """Pendulums, Duffing oscillators, planets, double pendulums."""
    rng = np.random.default_rng(seed)
    return [_nonlinear(rng, index) for index in range(count)]


def _asked(rng: np.random.Generator) -> tuple[float, Norm]:
    norms: tuple[Norm, ...] = ("max", "max", "max", "final", "l2")
    return float(10 ** rng.uniform(-11, -3)), norms[rng.integers(len(norms))]


def _log(rng: np.random.Generator, least: float, most: float) -> float:
    return float(np.exp(rng.uniform(np.log(least), np.log(most))))


def _linear(rng: np.random.Generator, index: int) -> Task:
    tolerance, norm = _asked(rng)
    gammas = rng.uniform(0.1, 1.9, 1 + (index % 4 == 3)).round(3)
    terms = [FractionalDamping(order=g, coefficient=[[_log(rng, 0.03, 6)]]) for g in gammas]
    final_time = round(rng.uniform(2, 30), 2)
    kind = ("free", "driven", "free", "pushed", "moved")[index % 5]
    forcing: Forcing | None = None
    if kind == "driven":
        amplitude, power = rng.uniform(0.2, 3), rng.integers(0, 3)
        forcing = Forcing.from_text(f"{amplitude:.3f} + {rng.uniform(-1, 1):.3f}*t**{power + 1}")
    if kind == "pushed":
        final_time = float(rng.integers(2, 20))
        values = [Expression.parse(text, variables=("t",)) for text in ("8", "0")]
        forcing = Forcing(
            pieces=(
                ForcingPiece(components=(values[0],), until=1.0),
                ForcingPiece(components=(values[1],)),
            )
        )
    at_rest = kind in ("driven", "pushed")
    stiffness = _log(rng, 0.1, 60)
    scene = linear_oscillator(
        final_time=final_time,
        mass=_log(rng, 0.5, 2),
        stiffness=stiffness,
        damping=terms,
        forcing=forcing,
        initial_position=0.0 if at_rest else rng.uniform(-2, 2),
        initial_velocity=rng.uniform(-2, 2) if kind == "moved" else 0.0,
    )
    orders = "+".join(f"{g:.2f}" for g in gammas)
    return Task(
        name=f"{kind} g={orders} k={stiffness:.2g} T={final_time:g}",
        scene=scene,
        tolerance=tolerance,
        norm=norm,
    )


def _nonlinear(rng: np.random.Generator, index: int) -> Task:
    tolerance, norm = _asked(rng)
    gamma = round(rng.uniform(0.1, 1.9), 3)
    strength = _log(rng, 0.03, 2)
    final_time = round(rng.uniform(2, 15), 2)
    common = {"final_time": final_time}
    kind = ("pendulum", "duffing", "pendulum", "duffing", "kepler", "double")[index % 6]
    one = [FractionalDamping(order=gamma, coefficient=[[strength]])]
    if kind == "pendulum":
        scene = pendulum(
            omega=_log(rng, 0.5, 4),
            damping=one,
            initial_position=rng.uniform(-2.5, 2.5),
            initial_velocity=rng.choice([0.0, rng.uniform(-1, 1)]),
            **common,
        )
    elif kind == "duffing":
        forcing = Forcing.from_text(f"0.5*cos({rng.uniform(0.5, 3):.3f}*t)")
        scene = duffing(
            stiffness=_log(rng, 0.3, 5),
            cubic_stiffness=_log(rng, 0.1, 3),
            damping=one,
            initial_position=rng.uniform(-2, 2),
            forcing=forcing if index % 4 == 1 else None,
            **common,
        )
    elif kind == "kepler":
        both = [FractionalDamping(order=gamma, coefficient=0.02 * strength * np.eye(2))]
        scene = kepler(
            damping=both,
            initial_position=[1.0, 0.0],
            initial_velocity=[0.0, float(rng.uniform(0.8, 1.2))],
            **common,
        )
    else:
        final_time = round(rng.uniform(1, 3), 2)
        scene = double_pendulum(
            final_time=final_time,
            joints=((gamma, 0.3 * strength),),
            initial_position=rng.uniform(-1, 1, 2),
            initial_velocity=np.zeros(2),
        )
    return Task(
        name=f"{kind} g={gamma:.2f} T={final_time:g}", scene=scene, tolerance=tolerance, norm=norm
    )


Truth = Callable[[Trajectory], float]


def truth_of(task: Task, largest: int) -> tuple[Truth, float]:
    """Error of a run against an independent reference, and the reference's own error.

    Closed forms, or characteristic roots and branch-cut integrals, where the scene is linear;
    otherwise a run on at least 8 times as many steps as any other, with what it differs by from
    one on half as many.
    """
    solution = match_scene(task.scene)
    if solution is not None:
        known = solution

        def against_solution(run: Trajectory) -> float:
            return error_norm(run.position, known.position(run.time), run.step_size, task.norm)

        return against_solution, 0.0
    n_steps = max(2048, 8 * largest)
    finer = [integrate(task.scene, REFERENCE, n).position for n in (n_steps, n_steps // 2)]
    own = error_norm(finer[0][::2], finer[1], task.scene.final_time / n_steps * 2, task.norm)

    def against_run(run: Trajectory) -> float:
        every = n_steps // run.n_steps
        return error_norm(run.position, finer[0][::every], run.step_size, task.norm)

    return against_run, own


def timed(action: Callable[[], object]) -> float:
    """Least time of some cold starts, of the processor: others compute as well.

    The speed of the machine, which predictions need, is measured once per process, not here.
    """
    least = math.inf
    for _ in range(REPEATS):
        forget()
        machine_speed()
        gc.collect()
        began = time.process_time()
        action()
        least = min(least, time.process_time() - began)
    return least


def best_by_hand(task: Task, truth: Truth, largest: int) -> tuple[str, float]:
    """The quickest single run of any candidate on base * 2^k steps that keeps the tolerance."""
    base = nearest_fitting(task.scene, 1)[1]
    best, seconds = "none", math.inf
    for method in USUAL_CANDIDATES:
        n_steps = base
        while n_steps <= largest:
            run = integrate(task.scene, method, n_steps)
            if run.status == "ok" and truth(run) <= task.tolerance:
                own = timed(lambda: integrate(task.scene, method, n_steps))  # noqa: B023
                if own < seconds:
                    best, seconds = f"{method.case} {n_steps}", own
                break
            n_steps *= 2
    return best, seconds


def search(task: Task, methods: tuple[AnyMethod, ...] = USUAL_CANDIDATES) -> Reached:
    """What is measured."""
    return reach_tolerance(task.scene, methods, task.tolerance, task.norm)


def examine(task: Task, *, with_cost: bool) -> Finding:
    """Search, compare with the truth and with the best choice by hand."""
    reached = search(task)
    truth, own = truth_of(task, reached.n_steps)
    error = math.nan
    if reached.verdict == "ok" and reached.trajectory is not None:
        error = truth(reached.trajectory)
    seconds, best, best_seconds = math.nan, "", math.nan
    if with_cost and reached.verdict == "ok":
        seconds = timed(lambda: search(task))
        best, best_seconds = best_by_hand(task, truth, 4 * reached.n_steps)
    return Finding(
        task=task,
        reached=reached,
        true_error=error,
        reference_error=own,
        seconds=seconds,
        best=best,
        best_seconds=best_seconds,
    )
