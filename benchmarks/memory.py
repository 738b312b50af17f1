"""How much memory runs take, those that keep every point and those that keep a few."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import NamedTuple

from benchmarks.measuring import in_own_process, number, peak_doubles, table
from benchmarks.stepping import quartic_scene
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.structures import linear_oscillator

LONG_RUN = 10**8
"""The number of steps to which a long run is extrapolated."""
KEPT = (Method(cq="bdf4", degree=2), 20.0), (Method(cq="gauss", degree=2), 8.0)
"""Methods of runs that keep every point, and most doubles a step."""
LARGEST_BYTES = 300e6
"""Of the process, for a run of 10^8 steps that keeps a few points."""


class MemoryRow(NamedTuple):
    """Memory of one run: of order 1.5 with every point, or of order 0.5 with every k-th one."""

    method: Method
    n_steps: int
    every: int
    seconds_per_step: float
    doubles_per_step: float  # traced peak of set-up and steps
    process_bytes: float  # largest resident memory, interpreter and libraries included


def measure_memory(method: Method, n_steps: int, every: int = 1) -> MemoryRow:
    """Measure one run in this process."""
    # not there on every system, and only this benchmark asks for it
    import resource

    scene = quartic_scene(1.5)
    if every > 1:
        damping = [FractionalDamping(order=0.5, coefficient=0.1)]
        end = 0.1 * n_steps
        scene = linear_oscillator(final_time=end, damping=damping, initial_position=1.0)

    def action() -> object:
        return integrate(scene, method, n_steps, every=every)

    began = time.perf_counter()
    action()
    seconds = time.perf_counter() - began
    resident = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    doubles = peak_doubles(action, n_steps)
    return MemoryRow(method, n_steps, every, seconds / n_steps, doubles, resident)


def run_memory(exponent: int = 20) -> list[MemoryRow]:
    """Every case in a process of its own: 2^(exponent + 2) steps; two runs that keep few points."""
    long = max(1000, 10**7 * 2**exponent // 2**20)
    gauss2 = KEPT[1][0]
    cases = [(method, 2 ** (exponent + 2), 1) for method, _ in KEPT]
    cases += [(gauss2, n, max(2, long // 1000)) for n in (long // 10, long)]
    return [in_own_process(measure_memory, *case) for case in cases]


def memory_table(rows: Sequence[MemoryRow]) -> str:
    """The table; the last two rows give the line to 10^8 steps."""
    shorter, longer = rows[-2:]
    slope = (longer.process_bytes - shorter.process_bytes) / (longer.n_steps - shorter.n_steps)
    far = longer.process_bytes + max(slope, 0.0) * (LONG_RUN - longer.n_steps)
    most = {**dict(KEPT)}
    head = "method, N, points kept, microseconds per step, doubles per step, at most, process (MB)"
    return table(
        "Doubles are the traced peak of set-up and steps, with the finished trajectory (time, "
        f"position, momentum, energy). At 10^8 steps a process takes {far / 1e6:.0f} MB, at most "
        f"{LARGEST_BYTES / 1e6:.0f}.",
        head.split(", "),
        [
            (
                row.method.family,
                str(row.n_steps),
                "all" if row.every == 1 else f"every {row.every}th",
                f"{1e6 * row.seconds_per_step:.2f}",
                number(row.doubles_per_step),
                number(most[row.method] if row.every == 1 else math.inf, ".0f"),
                f"{row.process_bytes / 1e6:.0f}",
            )
            for row in rows
        ],
    )
