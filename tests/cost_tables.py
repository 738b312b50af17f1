"""Tables of costs whose numbers are known."""

import csv
import math
from pathlib import Path

import fvi_cli as fvi
from fvi_cli.integrator.method import Method
from fvi_cli.studies.cost import CostCase, CostRow, CostTable, ToleranceRow
from fvi_cli.studies.order import damping_orders

GAUSS = Method(cq="gauss", degree=2, start="graded")
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
        status=status,
    )


def table(*cases: CostCase, name: str = "one") -> CostTable:
    return CostTable(
        experiment=name,
        equation="x'' + x = 0",
        reference="closed form",
        gamma="0.5",
        derivative="caputo",
        norm="max",
        final_time=1.0,
        cases=cases,
    )


COUNTED = ("n_steps", "repeats", "peak_memory_bytes", "history_operations", "newton_iterations")
MEASURED = (
    *("step_size", "error", "setup_seconds", "stepping_seconds_min", "stepping_seconds_median"),
    *("storage_seconds", "spread"),
)


def _lines(name: str) -> list[dict[str, str]]:
    path = Path(__file__).parents[1] / f"results/tables/{name}.csv"
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def committed_tables(name: str) -> list[CostTable]:
    """What the committed CSV files hold; floors and messages, which they do not, are left empty."""
    lines = _lines(f"{name}-cost")
    by_tolerance: dict[str, list[ToleranceRow]] = {}
    for line in _lines(f"{name}-cost-tolerances"):
        numbers = {key: float(line[key]) for key in ("tolerance", "error", "estimate", "seconds")}
        numbers |= {key: int(line[key]) for key in ("n_steps", "degree", "rounds")}
        found = ToleranceRow(outcome=line["outcome"], **numbers)
        by_tolerance.setdefault(line["experiment"], []).append(found)
    tables = []
    for experiment in fvi.load(name).experiments:
        cases: dict[str, list[CostRow]] = {method.case: [] for method in experiment.methods}
        for line in lines:
            if line["experiment"] == experiment.name:
                numbers = {key: int(line[key]) for key in COUNTED} | {
                    key: float(line[key]) for key in MEASURED
                }
                cases[line["case"]].append(CostRow(**numbers, floor=0.0, status=line["status"]))
        tables.append(
            CostTable(
                experiment=experiment.name,
                equation=experiment.problem.equation,
                reference=experiment.problem.exact_source,
                gamma=damping_orders(experiment),
                derivative=experiment.problem.scene.derivative,
                norm=experiment.norm,
                final_time=experiment.problem.final_time,
                cases=tuple(
                    CostCase(method=method, rows=tuple(cases[method.case]))
                    for method in experiment.methods
                ),
                by_tolerance=tuple(by_tolerance[experiment.name]),
                units=experiment.units,
            )
        )
    return tables
