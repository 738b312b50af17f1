"""Tables of costs whose numbers are known."""

from __future__ import annotations

import math

from fvi_cli.integrator.method import Method
from fvi_cli.studies.cost import CostCase, CostRow, CostTable

GAUSS = Method(cq="gauss", degree=2, start="series")
COUNTS = (10, 20, 40, 80, 160)


def row(n_steps: int, error: float, seconds: float, status: str = "ok") -> CostRow:
    return CostRow(
        n_steps=n_steps,
        step_size=1 / n_steps,
        error=error,
        floor=1e-15,
        setup_seconds=seconds / 4,
        stepping_seconds_min=3 * seconds / 4,
        stepping_seconds_median=seconds,
        storage_seconds=math.nan,
        spread=0.01,
        repeats=5,
        peak_memory_bytes=8 * n_steps,
        history_operations=n_steps * n_steps,
        newton_iterations=0,
        status=status,  # type: ignore[arg-type]
    )


def table(*cases: CostCase, name: str = "one") -> CostTable:
    return CostTable(
        experiment=name,
        equation="x'' + x = 0",
        reference="closed form",
        gamma="0.5",
        norm="max",
        final_time=1.0,
        cases=cases,
    )
