"""How fast the engine is: stepping times as multiples of one fast Fourier transform.

The yardstick is one ``scipy.fft.rfft`` of length 2N, measured right before the case in the same
process.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.measuring import (
    in_own_process,
    least_seconds,
    number,
    peak_doubles,
    table,
    yardstick_seconds,
    yes_or_no,
)
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.loop import CHUNK
from fvi_cli.integrator.tables import step_tables
from fvi_cli.scenes.data import linear_oscillator, pendulum


@dataclass(frozen=True, kw_only=True)
class SteppingCase:
    """What is measured, and what it should come to.

    Parameters
    ----------
    name
        Scene and method in words.
    scene
        ``quartic`` (linear, x = t^4 on [0, 1]) or ``pendulum``.
    order
        Order of the damping.
    method
        The method.
    exponent
        N is 2 to this power.
    largest_multiple, largest_error
        Figures to meet; infinite where there is none.
    """

    name: str
    scene: str
    order: float
    method: Method
    exponent: int
    largest_multiple: float = math.inf
    largest_error: float = math.inf


@dataclass(frozen=True, kw_only=True)
class SteppingRow:
    """One measured case.

    Parameters
    ----------
    name, n_steps
        What was measured.
    yardstick_seconds
        One transform of length 2N.
    stepping_seconds, weights_seconds
        Steps, and what is ready before the first of them (least of the repeats).
    error
        Largest error on the grid; nan where no exact solution is known.
    growth_exponent
        log of the ratio of stepping times over that of N, from 2^14 steps on; nan below.
    doubles_per_step
        Traced peak memory of set-up and steps, in doubles per step.
    history_operations
        Multiply-adds spent on the memory.
    largest_multiple, largest_error
        Figures to meet.
    """

    name: str
    n_steps: int
    yardstick_seconds: float
    stepping_seconds: float
    weights_seconds: float
    error: float
    growth_exponent: float
    doubles_per_step: float
    history_operations: int
    largest_multiple: float
    largest_error: float

    @property
    def multiple(self) -> float:
        """Stepping time over the yardstick."""
        return self.stepping_seconds / self.yardstick_seconds

    @property
    def weights_multiple(self) -> float:
        """Set-up over the yardstick."""
        return self.weights_seconds / self.yardstick_seconds

    @property
    def is_met(self) -> bool:
        """Whether the figures hold."""
        within = math.isnan(self.error) or self.error <= self.largest_error
        return within and self.multiple <= self.largest_multiple


def stepping_table(rows: Sequence[SteppingRow]) -> str:
    """The table, times as multiples of the yardstick."""
    return table(
        "Times are multiples of one `scipy.fft.rfft` of length 2N on the same core.",
        (
            "case",
            "N",
            "stepping",
            "at most",
            "set-up",
            "error",
            "at most",
            "growth",
            "doubles per step",
            "operations per step",
            "met",
        ),
        [
            (
                row.name,
                f"2^{int(math.log2(row.n_steps))}",
                number(row.multiple, ".1f"),
                number(row.largest_multiple, "g"),
                number(row.weights_multiple, ".1f"),
                number(row.error, ".1e"),
                number(row.largest_error, ".0e"),
                number(row.growth_exponent, ".2f"),
                number(row.doubles_per_step, ".1f"),
                f"{row.history_operations / row.n_steps:.0f}",
                yes_or_no(row.is_met),
            )
            for row in rows
        ],
    )


def stepping_cases(exponent: int = 20) -> tuple[SteppingCase, ...]:
    """The engine's figures; `exponent` is that of the linear cases."""
    nodes = Method(cq="bdf2", sampling="nodes", degree=1)
    points = Method(cq="bdf4", degree=2)
    gauss2, gauss3, gauss4 = (Method(cq="gauss", degree=m) for m in (2, 3, 4))
    linear = (
        ("nodes, BDF2, degree 1", nodes, 25.0, 1e-11),
        ("points, BDF4, degree 2", points, 55.0, 1e-11),
        ("Gauss2", gauss2, 20.0, 1e-12),
        ("Gauss3", gauss3, 30.0, 1e-12),
        ("Gauss4", gauss4, 40.0, 1e-12),
    )
    cases = [
        SteppingCase(
            name=f"linear, gamma = {order:g}, {name}",
            scene="quartic",
            order=order,
            method=method,
            exponent=exponent,
            largest_multiple=8.0 if order == 1 else multiple,
            largest_error=error,
        )
        for order in (1.5, 1.0)
        for name, method, multiple, error in linear
    ]
    for power, multiple in ((min(17, exponent), 250.0), (min(10, exponent), math.inf)):
        cases.append(
            SteppingCase(
                name="pendulum, gamma = 0.5, Gauss2",
                scene="pendulum",
                order=0.5,
                method=gauss2,
                exponent=power,
                largest_multiple=multiple,
            )
        )
    return tuple(cases)


def run_stepping(exponent: int) -> list[SteppingRow]:
    """Measure the cases, each in a process of its own; the least time of three runs counts."""
    return [in_own_process(measure_stepping, case, 3) for case in stepping_cases(exponent)]


def measure_stepping(case: SteppingCase, repeats: int) -> SteppingRow:
    """Measure one case in this process."""
    scene, n_steps = _scene(case), 2**case.exponent
    yardstick = yardstick_seconds(n_steps)
    runs = [integrate(scene, case.method, n_steps) for _ in range(repeats)]
    stepping = _steps_alone(case, scene, n_steps, [one.stepping_seconds for one in runs])
    error = float("nan")
    if case.scene == "quartic":
        error = float(np.abs(runs[0].position[:, 0] - runs[0].time ** 4).max())
    growth = float("nan")
    if case.exponent > 14:
        shorter = [integrate(scene, case.method, 2**14) for _ in range(repeats)]
        before = _steps_alone(case, scene, 2**14, [one.stepping_seconds for one in shorter])
        growth = math.log2(stepping / before) / (case.exponent - 14)
    operations = runs[0].history_operations
    weights = min(one.setup_seconds for one in runs)
    del runs
    return SteppingRow(
        name=case.name,
        n_steps=n_steps,
        yardstick_seconds=yardstick,
        stepping_seconds=stepping,
        weights_seconds=weights,
        error=error,
        growth_exponent=growth,
        doubles_per_step=peak_doubles(lambda: integrate(scene, case.method, n_steps), n_steps),
        history_operations=operations,
        largest_multiple=case.largest_multiple,
        largest_error=case.largest_error,
    )


def _steps_alone(case: SteppingCase, scene: Scene, n_steps: int, seconds: Sequence[float]) -> float:
    """Least time of the steps without what the formula of the force takes.

    Methods with equal steps only evaluate the force beforehand, which counts as set-up.
    """
    if scene.forcing is None or not case.method.is_runge_kutta:
        return min(seconds)
    loads = StepLoads(scene, case.method, step_tables(case.method))
    h = scene.final_time / n_steps
    count = min(CHUNK, n_steps)

    def evaluate() -> None:
        for first in range(0, n_steps, count):
            loads.of_steps(first * h, h, count, is_fresh=first == 0)

    return min(seconds) - least_seconds(evaluate, len(seconds))


def _scene(case: SteppingCase) -> Scene:
    if case.scene == "quartic":
        return quartic_scene(case.order)
    damping = [FractionalDamping(order=case.order, coefficient=0.3 * np.eye(1))]
    return pendulum(final_time=20.0, damping=damping, initial_position=1.0)


def quartic_scene(order: float) -> Scene:
    """The linear oscillator on [0, 1] whose forcing makes x = t^4."""
    damping = [FractionalDamping(order=order, coefficient=np.eye(1))]
    factor = math.gamma(5.0) / math.gamma(5.0 - order)
    force = f"12*t**2 + {factor!r}*t**{4.0 - order!r} + t**4"
    return linear_oscillator(final_time=1.0, damping=damping, forcing=Forcing.from_text(force))
