"""How fast the engine is: stepping times as multiples of one fast Fourier transform.

The yardstick is one ``scipy.fft.rfft`` of length 2N, measured right before the case in the same
process.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.measuring import in_own_process, number, table, yardstick_seconds
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.data import pendulum
from fvi_cli.scenes.structures import linear_oscillator

LINEAR = (
    (Method(cq="bdf2", sampling="nodes", degree=1), 25.0, 1e-11),
    (Method(cq="bdf4", degree=2), 55.0, 1e-11),
    (Method(cq="gauss", degree=2), 20.0, 1e-12),
    (Method(cq="gauss", degree=3), 30.0, 1e-12),
    (Method(cq="gauss", degree=4), 40.0, 1e-12),
)
"""Methods, largest multiples of the yardstick and largest errors for x = t^4 on [0, 1]."""


class SteppingCase(NamedTuple):
    """A pendulum, or the linear scene with x = t^4, by 2^exponent steps; figures to meet."""

    is_linear: bool
    order: float
    method: Method
    exponent: int
    largest_multiple: float = math.inf
    largest_error: float = math.inf


class SteppingRow(NamedTuple):
    """What was measured; times are multiples of the yardstick, errors nan for the pendulum."""

    case: SteppingCase
    stepping: float
    error: float

    @property
    def is_met(self) -> bool:
        """Whether the figures hold."""
        is_accurate = math.isnan(self.error) or self.error <= self.case.largest_error
        return is_accurate and self.stepping <= self.case.largest_multiple


def quartic_scene(order: float) -> Scene:
    """The linear oscillator on [0, 1] whose forcing makes x = t^4."""
    damping = [FractionalDamping(order=order, coefficient=np.eye(1))]
    factor = math.gamma(5.0) / math.gamma(5.0 - order)
    force = f"12*t**2 + {factor!r}*t**{4.0 - order!r} + t**4"
    return linear_oscillator(final_time=1.0, damping=damping, forcing=Forcing.from_text(force))


def stepping_cases(exponent: int = 20) -> list[SteppingCase]:
    """The engine's figures; `exponent` is that of the linear cases."""
    linear = [
        SteppingCase(True, order, method, exponent, 8.0 if order == 1 else most, error)
        for order in (1.5, 1.0)
        for method, most, error in LINEAR
    ]
    gauss2 = Method(cq="gauss", degree=2)
    swings = ((min(17, exponent), 250.0), (min(10, exponent), math.inf))
    return [*linear, *(SteppingCase(False, 0.5, gauss2, power, most) for power, most in swings)]


def measure_stepping(case: SteppingCase, repeats: int) -> SteppingRow:
    """Measure one case in this process; the least time of the repeats counts."""
    n_steps = 2**case.exponent
    scene = quartic_scene(case.order)
    if not case.is_linear:
        damping = [FractionalDamping(order=case.order, coefficient=0.3)]
        scene = pendulum(final_time=20.0, damping=damping, initial_position=1.0)
    yardstick = yardstick_seconds(2 * n_steps)
    runs = [integrate(scene, case.method, n_steps) for _ in range(repeats)]
    seconds = min(one.seconds for one in runs)
    error = math.nan
    if case.is_linear:
        error = float(np.abs(runs[0].position[:, 0] - runs[0].time ** 4).max())
    return SteppingRow(
        case=case,
        stepping=seconds / yardstick,
        error=error,
    )


def run_stepping(exponent: int = 20) -> list[SteppingRow]:
    """Measure the cases, each in a process of its own."""
    return [in_own_process(measure_stepping, case, 3) for case in stepping_cases(exponent)]


def stepping_table(rows: Sequence[SteppingRow]) -> str:
    """The table, times as multiples of the yardstick."""
    head = "case, N, stepping, at most, error, at most, met"
    return table(
        "Times are multiples of one `scipy.fft.rfft` of length 2N on the same core; linear is "
        "x = t^4 on [0, 1].",
        head.split(", "),
        [
            (
                f"{'linear' if case.is_linear else 'pendulum'}, order {case.order:g}, "
                f"{case.method.family}",
                f"2^{case.exponent}",
                number(row.stepping, ".1f"),
                number(case.largest_multiple, "g"),
                number(row.error, ".1e"),
                number(case.largest_error, ".0e"),
                "yes" if row.is_met else "no",
            )
            for row in rows
            for case in [row.case]
        ],
    )
