"""How fast the engine is: stepping times as multiples of one fast Fourier transform.

The yardstick is one ``scipy.fft.rfft`` of length 2N, measured right before the case in the same
child process. The child keeps freed memory (its allocator's thresholds are raised), so that a
transform does not pay for fresh pages every other time, and computes on one core.
"""

from __future__ import annotations

import gc
import json
import math
import os
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import FviError
from fvi_cli.integrator.engine import run
from fvi_cli.integrator.integrate import prepare
from fvi_cli.integrator.memory import build_memory
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.scenes.named import linear_oscillator, pendulum

Array = NDArray[np.float64]

CHILD_ENVIRONMENT = {
    "MALLOC_MMAP_THRESHOLD_": "1073741824",
    "MALLOC_TRIM_THRESHOLD_": "4294967296",
    "MALLOC_TOP_PAD_": "268435456",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}
YARDSTICK_REPEATS = 9
QUICK_SECONDS = 0.05
"""Cases that take less are repeated as often as the yardstick."""


class BenchmarkError(FviError):
    """The child process of the benchmark ended without an answer."""


@dataclass(frozen=True, kw_only=True)
class BenchmarkCase:
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
class BenchmarkRow:
    """One measured case.

    Parameters
    ----------
    name, n_steps
        What was measured.
    yardstick_seconds
        One transform of length 2N.
    stepping_seconds, weights_seconds
        Steps (least of the repeats), and weights of the memory.
    direct_seconds
        The same steps one after the other with every sum written out; nan where that takes long.
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
    direct_seconds: float
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
        """Time for the weights over the yardstick."""
        return self.weights_seconds / self.yardstick_seconds

    @property
    def speed_up(self) -> float:
        """How many times quicker than one step after the other."""
        return self.direct_seconds / self.stepping_seconds

    @property
    def is_met(self) -> bool:
        """Whether the figures hold."""
        within = math.isnan(self.error) or self.error <= self.largest_error
        return within and self.multiple <= self.largest_multiple


@dataclass(frozen=True, kw_only=True)
class BenchmarkTable:
    """The measured rows."""

    rows: tuple[BenchmarkRow, ...]

    def to_markdown(self) -> str:
        """The table, times as multiples of the yardstick."""
        head = (
            "case",
            "N",
            "stepping",
            "at most",
            "weights",
            "error",
            "at most",
            "growth",
            "direct / blocks",
            "doubles per step",
            "operations per step",
            "met",
        )
        lines = [
            "Times are multiples of one `scipy.fft.rfft` of length 2N on the same core.",
            "",
            "| " + " | ".join(head) + " |",
            "|" + " --- |" * len(head),
        ]
        for row in self.rows:
            cells = (
                row.name,
                f"2^{int(math.log2(row.n_steps))}",
                _number(row.multiple, ".1f"),
                _number(row.largest_multiple, "g"),
                _number(row.weights_multiple, ".1f"),
                _number(row.error, ".1e"),
                _number(row.largest_error, ".0e"),
                _number(row.growth_exponent, ".2f"),
                _number(row.speed_up, ".1f"),
                _number(row.doubles_per_step, ".1f"),
                f"{row.history_operations / row.n_steps:.0f}",
                "yes" if row.is_met else "no",
            )
            lines.append("| " + " | ".join(cells) + " |")
        return "\n".join(lines) + "\n"


def _number(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "-"


def standard_cases(exponent: int = 20) -> tuple[BenchmarkCase, ...]:
    """The engine's figures; `exponent` is that of the linear cases."""
    nodes = Method(cq="bdf2", sampling="nodes", degree=1)
    points = Method(cq="bdf4", degree=2)
    gauss2, gauss3 = Method(cq="gauss", degree=2), Method(cq="gauss", degree=3)
    linear = (
        ("nodes, BDF2, degree 1", nodes, 25.0, 1e-11),
        ("points, BDF4, degree 2", points, 55.0, 1e-11),
        ("Gauss2", gauss2, 45.0, 1e-12),
        ("Gauss3", gauss3, 65.0, 1e-12),
    )
    cases = [
        BenchmarkCase(
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
            BenchmarkCase(
                name="pendulum, gamma = 0.5, Gauss2",
                scene="pendulum",
                order=0.5,
                method=gauss2,
                exponent=power,
                largest_multiple=multiple,
            )
        )
    return tuple(cases)


def run_benchmark(*, exponent: int = 20, repeats: int = 3, memory: bool = True) -> BenchmarkTable:
    """Measure the standard cases, each in a child process of its own.

    Parameters
    ----------
    exponent
        The linear cases take 2 to this power steps.
    repeats
        Runs per case; the least time counts.
    memory
        Whether to trace the peak memory in one more run.

    Raises
    ------
    ValueError
        For exponents outside 4 to 24, or less than one repeat.
    BenchmarkError
        If a child process fails.
    """
    if not 4 <= exponent <= 24:
        raise ValueError(f"exponent: {exponent} is not allowed; it must be 4 to 24")
    if repeats < 1:
        raise ValueError(f"repeats: {repeats} is not allowed; it must be at least 1")
    rows = [
        _in_child_process(index, exponent, repeats, memory=memory)
        for index in range(len(standard_cases(exponent)))
    ]
    return BenchmarkTable(rows=tuple(rows))


def _in_child_process(index: int, exponent: int, repeats: int, *, memory: bool) -> BenchmarkRow:
    numbers = (index, exponent, repeats, int(memory))
    return row_from_values(answer_of_child("fvi_cli.studies.benchmark", numbers))


def answer_of_child(module: str, numbers: Sequence[int]) -> Mapping[str, str | float | int]:
    """What `module`, run with these numbers in a process of its own, prints as JSON.

    Raises
    ------
    BenchmarkError
        If the process fails.
    """
    finished = subprocess.run(  # noqa: S603 - this interpreter, a module of ours, numbers
        [sys.executable, "-W", "ignore", "-m", module, *map(str, numbers)],
        env={**os.environ, **CHILD_ENVIRONMENT},
        capture_output=True,
        text=True,
        check=False,
    )
    if finished.returncode != 0:
        raise BenchmarkError(f"benchmark: the child process failed\n{finished.stderr.strip()}")
    answer: Mapping[str, str | float | int] = json.loads(finished.stdout)
    return answer


def row_from_values(values: Mapping[str, str | float | int]) -> BenchmarkRow:
    """A row from what the child process printed."""
    numbers = {key: float(value) for key, value in values.items() if key not in _NOT_FLOAT}
    return BenchmarkRow(
        name=str(values["name"]),
        n_steps=int(values["n_steps"]),
        history_operations=int(values["history_operations"]),
        **numbers,
    )


_NOT_FLOAT = ("name", "n_steps", "history_operations")


def measure_case(case: BenchmarkCase, *, repeats: int, memory: bool) -> BenchmarkRow:
    """Measure one case in this process."""
    scene, n_steps = _scene(case), 2**case.exponent
    problem = prepare(scene, case.method, n_steps).problem
    weights = _least_seconds(
        lambda: build_memory(
            scene, case.method, step_tables(case.method), n_steps, scene.active_damping
        ),
        1,
    )
    yardstick = yardstick_seconds(n_steps)
    stepping = _least_seconds(partial(run, problem, "fft"), repeats)
    stepped = run(problem, "fft")
    error = float("nan")
    if case.scene == "quartic":
        grid = np.arange(n_steps + 1) / n_steps
        error = float(np.abs(stepped.position[:, 0] - grid**4).max())
    growth = float("nan")
    if case.exponent > 14:
        shorter = prepare(scene, case.method, 2**14).problem
        before = _least_seconds(partial(run, shorter, "fft"), repeats)
        growth = math.log2(stepping / before) / (case.exponent - 14)
    direct = float("nan")
    if case.exponent <= 12:
        direct = _least_seconds(partial(run, problem, "direct"), repeats)
    operations = stepped.operations
    del problem, stepped
    return BenchmarkRow(
        name=case.name,
        n_steps=n_steps,
        yardstick_seconds=yardstick,
        stepping_seconds=stepping,
        weights_seconds=weights,
        direct_seconds=direct,
        error=error,
        growth_exponent=growth,
        doubles_per_step=_doubles_of_steps(scene, case.method, n_steps) if memory else float("nan"),
        history_operations=operations,
        largest_multiple=case.largest_multiple,
        largest_error=case.largest_error,
    )


def yardstick_seconds(n_steps: int) -> float:
    """Least time of one real transform of length 2N."""
    from scipy.fft import rfft

    values = np.random.default_rng(0).normal(size=2 * n_steps)
    return _least_seconds(lambda: rfft(values), YARDSTICK_REPEATS)


def _scene(case: BenchmarkCase) -> Scene:
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


def _least_seconds(action: Callable[[], object], repeats: int) -> float:
    least, count = math.inf, 0
    while count < repeats or (least < QUICK_SECONDS and count < YARDSTICK_REPEATS):
        gc.collect()
        began = time.perf_counter()
        action()
        least = min(least, time.perf_counter() - began)
        count += 1
    return least


def _doubles_of_steps(scene: Scene, method: Method, n_steps: int) -> float:
    return peak_doubles(lambda: run(prepare(scene, method, n_steps).problem, "fft"), n_steps)


def peak_doubles(action: Callable[[], object], n_steps: int) -> float:
    """Traced peak memory of `action` in doubles per step."""
    gc.collect()
    tracemalloc.start()
    try:
        action()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return peak / 8 / n_steps


def _child(arguments: Sequence[str]) -> None:
    index, exponent, repeats, memory = map(int, arguments)
    case = standard_cases(exponent)[index]
    row = measure_case(case, repeats=repeats, memory=bool(memory))
    sys.stdout.write(json.dumps(asdict(row)))


if __name__ == "__main__":
    _child(sys.argv[1:])
