"""How much memory runs take, those that keep every point and those that keep a few."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from benchmarks.measuring import in_own_process, number, peak_doubles, table
from benchmarks.stepping import quartic_scene
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.structures import linear_oscillator

KEPT = (Method(cq="bdf4", degree=2), 20.0), (Method(cq="gauss", degree=2), 8.0)
"""Methods of runs that keep every point, and most doubles a step."""


class MemoryRow(NamedTuple):
    """Memory of one run: of order 1.5 with every point, or of order 0.5 with every k-th one."""

    method: Method
    n_steps: int
    every: int
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

    action()
    resident = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    doubles = peak_doubles(action, n_steps)
    return MemoryRow(method, n_steps, every, doubles, resident)


def run_memory() -> list[MemoryRow]:
    """Every case in a process of its own: all points, and two runs that keep few points."""
    cases = [(method, 2**22, 1) for method, _ in KEPT]
    cases += [(KEPT[1][0], n_steps, 10**4) for n_steps in (10**6, 10**7)]
    return [in_own_process(measure_memory, *case) for case in cases]


def memory_table(rows: Sequence[MemoryRow]) -> str:
    """The table."""
    most = dict(KEPT)
    head = "method, N, points kept, doubles per step, at most, process (MB)"
    return table(
        "Doubles are the traced peak of set-up and steps, with the finished trajectory (time, "
        "position, momentum, energy).",
        head.split(", "),
        [
            (
                row.method.family,
                str(row.n_steps),
                "all" if row.every == 1 else f"every {row.every}th",
                number(row.doubles_per_step),
                number(most[row.method] if row.every == 1 else math.inf, ".0f"),
                f"{row.process_bytes / 1e6:.0f}",
            )
            for row in rows
        ],
    )
