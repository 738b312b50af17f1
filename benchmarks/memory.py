"""How much memory runs take, those that keep every point and those that keep a few."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.measuring import in_own_process, number, peak_doubles, table, yes_or_no
from benchmarks.stepping import quartic_scene
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.data import linear_oscillator

LONG_RUN = 10**8
"""The number of steps to which a long run is extrapolated."""


@dataclass(frozen=True, kw_only=True)
class MemoryCase:
    """A run whose memory is measured.

    Parameters
    ----------
    name
        Scene and method in words.
    method
        The method.
    n_steps
        N.
    every
        Which points are kept; more than one: a free oscillator that makes ten steps in a unit of
        time. One: the linear scene with x = t^4 on [0, 1].
    largest_doubles
        Traced peak in doubles per step to stay below.
    largest_bytes
        Peak of the whole process to stay below, extrapolated to `LONG_RUN` steps.
    """

    name: str
    method: Method
    n_steps: int
    every: int = 1
    largest_doubles: float = math.inf
    largest_bytes: float = math.inf


@dataclass(frozen=True, kw_only=True)
class MemoryRow:
    """What was measured.

    Parameters
    ----------
    name, n_steps, every
        The case.
    seconds_per_step
        Set-up and steps, over N.
    doubles_per_step
        Traced peak in doubles per step.
    process_bytes
        Largest resident memory of the process, interpreter and libraries included.
    extrapolated_bytes
        The same for `LONG_RUN` steps, on the line through this run and one of a tenth; nan for
        runs that keep every point.
    largest_doubles, largest_bytes
        Figures to meet.
    """

    name: str
    n_steps: int
    every: int
    seconds_per_step: float
    doubles_per_step: float
    process_bytes: float
    extrapolated_bytes: float
    largest_doubles: float
    largest_bytes: float

    @property
    def is_met(self) -> bool:
        """Whether the figures hold."""
        within = (
            math.isnan(self.extrapolated_bytes) or self.extrapolated_bytes <= self.largest_bytes
        )
        return within and self.doubles_per_step <= self.largest_doubles


def memory_table(rows: Sequence[MemoryRow]) -> str:
    """The table."""
    return table(
        "Doubles are the traced peak of set-up and steps; with the finished "
        "trajectory (time, position, momentum, energy) as well.",
        (
            "case",
            "N",
            "points kept",
            "microseconds per step",
            "doubles per step",
            "at most",
            "process, MB",
            "at 10^8 steps, MB",
            "at most",
            "met",
        ),
        [
            (
                row.name,
                str(row.n_steps),
                "all" if row.every == 1 else f"every {row.every}th",
                f"{1e6 * row.seconds_per_step:.2f}",
                f"{row.doubles_per_step:.3g}",
                number(row.largest_doubles, ".0f"),
                f"{row.process_bytes / 1e6:.0f}",
                number(row.extrapolated_bytes / 1e6, ".0f"),
                number(row.largest_bytes / 1e6, ".0f"),
                yes_or_no(row.is_met),
            )
            for row in rows
        ],
    )


def memory_cases(exponent: int = 22, long_steps: int = 10**7) -> tuple[MemoryCase, ...]:
    """The figures on memory; whole trajectories of 2 to the power of `exponent` steps."""
    gauss2, gauss3 = Method(cq="gauss", degree=2), Method(cq="gauss", degree=3)
    whole = (
        ("points, BDF4, degree 2", Method(cq="bdf4", degree=2), 20.0),
        ("Gauss2", gauss2, 8.0),
        ("Gauss3", gauss3, 8.0),
    )
    cases = [
        MemoryCase(
            name=f"linear, gamma = 1.5, {name}",
            method=method,
            n_steps=2**exponent,
            largest_doubles=most,
        )
        for name, method, most in whole
    ]
    cases.append(
        MemoryCase(
            name="free oscillator, gamma = 0.5, Gauss2",
            method=gauss2,
            n_steps=long_steps,
            every=max(2, long_steps // 1000),
            largest_bytes=300e6,
        )
    )
    return tuple(cases)


def run_memory(exponent: int) -> list[MemoryRow]:
    """Measure every case in a process of its own.

    With the usual 2^20: 2^22 steps that are kept, and ten millions of which a few are.
    """
    cases = memory_cases(exponent + 2, max(1000, 10**7 * 2**exponent // 2**20))
    return [_extrapolated(case) for case in cases]


def _extrapolated(case: MemoryCase) -> MemoryRow:
    row = in_own_process(measure_memory, case)
    if case.every == 1:
        return row
    shorter = in_own_process(measure_memory, replace(case, n_steps=case.n_steps // 10))
    slope = (row.process_bytes - shorter.process_bytes) / (row.n_steps - shorter.n_steps)
    far = row.process_bytes + max(slope, 0.0) * (LONG_RUN - row.n_steps)
    return replace(row, extrapolated_bytes=far)


def measure_memory(case: MemoryCase) -> MemoryRow:
    """Measure one case in this process."""
    # not there on every system, and only this benchmark asks for it
    import resource

    scene, method, n_steps = _scene(case), case.method, case.n_steps

    def action() -> object:
        return integrate(scene, method, n_steps, every=case.every)

    began = time.perf_counter()
    action()
    seconds = time.perf_counter() - began
    resident = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return MemoryRow(
        name=case.name,
        n_steps=n_steps,
        every=case.every,
        seconds_per_step=seconds / n_steps,
        doubles_per_step=peak_doubles(action, n_steps),
        process_bytes=resident,
        extrapolated_bytes=math.nan,
        largest_doubles=case.largest_doubles,
        largest_bytes=case.largest_bytes,
    )


def _scene(case: MemoryCase) -> Scene:
    if case.every == 1:
        return quartic_scene(1.5)
    damping = [FractionalDamping(order=0.5, coefficient=0.1 * np.eye(1))]
    return linear_oscillator(final_time=0.1 * case.n_steps, damping=damping, initial_position=1.0)
