"""How much memory runs take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from benchmarks.measuring import in_own_process, number, peak_doubles, table
from benchmarks.stepping import quartic_scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method

KEPT = (Method(cq="bdf4", degree=2), 20.0), (Method(cq="gauss", degree=2), 8.0)
"""Methods, and most doubles a step."""


class MemoryRow(NamedTuple):
    """Memory of one run of order 1.5."""

    method: Method
    n_steps: int
    doubles_per_step: float  # traced peak of set-up and steps
    process_bytes: float  # largest resident memory, interpreter and libraries included


def measure_memory(method: Method, n_steps: int) -> MemoryRow:
    """Measure one run in this process."""
    # not there on every system, and only this benchmark asks for it
    import resource

    scene = quartic_scene(1.5)

    def action() -> object:
        return integrate(scene, method, n_steps)

    action()
    resident = 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return MemoryRow(method, n_steps, peak_doubles(action, n_steps), resident)


def run_memory() -> list[MemoryRow]:
    """Every method in a process of its own."""
    return [in_own_process(measure_memory, method, 2**22) for method, _ in KEPT]


def memory_table(rows: Sequence[MemoryRow]) -> str:
    """The table."""
    most = dict(KEPT)
    return table(
        "Doubles are the traced peak of set-up and steps, with the finished trajectory (time, "
        "position, momentum, energy).",
        ["method", "N", "doubles per step", "at most", "process (MB)"],
        [
            (
                row.method.family,
                str(row.n_steps),
                number(row.doubles_per_step),
                number(most[row.method], ".0f"),
                f"{row.process_bytes / 1e6:.0f}",
            )
            for row in rows
        ],
    )
