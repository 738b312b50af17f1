"""What rounding leaves of every method: the table that floors of errors are read from."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from benchmarks.measuring import number, table
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method, Sampling
from fvi_cli.planning import round_off
from fvi_cli.scenes.data import linear_oscillator
from fvi_cli.scenes.linear_response import linear_response

FINAL_TIME, VELOCITY = 5.0, 0.5
SECOND = 0.7366
"""The other unit of time: no power of two, so that every number is rounded otherwise."""
MOST_POINTS = 256
"""So many points of a run are compared."""

ORDERS = (0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.02, 1.1, 1.3, 1.5, 1.7, 1.9, 1.98)
EXPONENTS = (12, 16, 20)
BACKWARD: tuple[tuple[int, Sampling, int], ...] = (
    (1, "nodes", 1),
    (2, "nodes", 1),
    (2, "points", 1),
    (3, "points", 2),
    (4, "points", 2),
    (5, "points", 3),
    (6, "points", 3),
)
METHODS = (
    *(Method(cq="gauss", degree=m, start="graded") for m in range(1, 6)),
    *(Method(cq="radau-iia", degree=m, start="graded") for m in (2, 3)),
    *(Method(cq="lobatto-iiic", degree=m, start="graded") for m in (1, 2, 3)),
    *(Method(cq=f"bdf{p}", sampling=where, degree=s) for p, where, s in BACKWARD),
)


@dataclass(frozen=True, kw_only=True)
class FloorRow:
    """What was measured of one method, order and number of steps.

    Parameters
    ----------
    cq, sampling, degree
        The method.
    order
        gamma.
    exponent
        N is 2 to this power.
    status
        That of the run.
    units
        Largest difference of the run and of the same run in another unit of time, relative to the
        largest position: one discrete motion, every number in it rounded otherwise.
    error
        Largest error, relative in the same way.
    is_round_off
        Whether no more than rounding is in that error: the method has order six or more.
    """

    cq: str
    sampling: str
    degree: int
    order: float
    exponent: int
    status: str
    units: float
    error: float
    is_round_off: bool

    @property
    def method(self) -> str:
        """The method in words."""
        if self.cq.startswith("bdf"):
            return f"{self.cq}, {self.sampling}, degree {self.degree}"
        return f"{self.cq} {self.degree}"

    @property
    def case(self) -> tuple[str, str, int, float, int]:
        """What was measured."""
        return self.cq, self.sampling, self.degree, self.order, self.exponent

    @property
    def floor(self) -> float:
        """What rounding leaves; nan where the motion blows up."""
        if self.status != "ok":
            return math.nan
        return max(self.units, self.error) if self.is_round_off else self.units


def oscillator(order: float, second: float = 1.0) -> Scene:
    """The oscillator x'' + D^gamma x + x = 0 on [0, 5], in a unit of time."""
    return linear_oscillator(
        final_time=FINAL_TIME * second,
        stiffness=second**-2,
        damping=[FractionalDamping(order=order, coefficient=second ** (order - 2) * np.eye(1))],
        initial_position=1.0,
        initial_velocity=VELOCITY / second,
    )


def measure_floor(method: Method, order: float, exponent: int) -> FloorRow:
    """Run twice, and compare the two and the first with the exact motion."""
    n_steps = 2**exponent
    one, other = (
        integrate(
            oscillator(order, second), method, n_steps, every=max(1, n_steps // MOST_POINTS)
        ).position[:, 0]
        for second in (1.0, SECOND)
    )
    times = np.linspace(0.0, FINAL_TIME, min(n_steps, MOST_POINTS) + 1)
    exact = linear_response(
        mass=1.0, stiffness=1.0, damping=((order, 1.0),), position=1.0, velocity=VELOCITY
    )(times)
    is_whole = one.size == other.size == times.size
    size = float(np.abs(exact).max())
    error = float(np.abs(one - exact).max()) / size if is_whole else math.inf
    return FloorRow(
        cq=method.cq,
        sampling=method.sampling,
        degree=method.degree,
        order=order,
        exponent=exponent,
        # an error of ten times the whole motion is no approximation of it
        status="ok" if error < 10.0 else "diverged",
        units=float(np.abs(one - other).max()) / size if is_whole else math.inf,
        error=error,
        is_round_off=method.is_runge_kutta and method.classical_order >= 6,
    )


def run_floors(
    most: int | None = None,
    path: Path = round_off.TABLE,
    methods: Sequence[Method] = METHODS,
    exponents: Sequence[int] = EXPONENTS,
) -> list[FloorRow]:
    """Measure at most so many rows that are not there yet; those of `path` are kept."""
    rows = read_rows(path)
    known = {row.case for row in rows}
    # so that a part of the table is of use: the highest orders of all methods come first
    cases = [
        (method, order, exponent)
        for exponent in exponents
        for order in reversed(ORDERS)
        for method in methods
        if (method.cq, method.sampling, method.degree, order, exponent) not in known
    ]
    for method, order, exponent in cases[:most]:
        rows.append(measure_floor(method, order, exponent))
        _write_rows(path, sorted(rows, key=_place))
    return sorted(rows, key=_place)


def _place(row: FloorRow) -> tuple[int, int, float]:
    """By number of steps, method and order."""
    cases = [(method.cq, method.degree) for method in METHODS]
    return row.exponent, cases.index((row.cq, row.degree)), row.order


def read_rows(path: Path) -> list[FloorRow]:
    """The rows that were measured before."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [
            FloorRow(
                cq=row["cq"],
                sampling=row["sampling"],
                degree=int(row["degree"]),
                order=float(row["order"]),
                exponent=int(row["exponent"]),
                status=row["status"],
                units=float(row["units"]),
                error=float(row["error"]),
                is_round_off=row["is_round_off"] == "True",
            )
            for row in csv.DictReader(file)
        ]


def _write_rows(path: Path, rows: Iterable[FloorRow]) -> None:
    part = path.with_suffix(".part")
    with part.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [f.name for f in fields(FloorRow)], lineterminator="\n")
        writer.writeheader()
        for row in rows:
            short = {"units": f"{row.units:.2e}", "error": f"{row.error:.2e}"}
            writer.writerow({**asdict(row), **short})
    part.replace(path)


def floor_table(rows: Sequence[FloorRow]) -> str:
    """A table for every number of steps, methods by orders."""
    made = [
        "The largest difference between a run of x'' + D^gamma x + x = 0, x(0) = 1, x'(0) = 1/2 "
        f"on [0, {FINAL_TIME:g}] and the same run in another unit of time, relative to the largest "
        "position; of methods of order six and more the error against the exact solution where "
        "that is larger. A dash: the motion blows up. `fvi_cli/planning/round_off.csv` has both "
        "numbers. An error below ten times these (at least 100 eps sqrt(N)) of the motion is "
        f"called `floor`. Measured: {len(rows)} of "
        f"{len(METHODS) * len(ORDERS) * len(EXPONENTS)} cases, the highest orders first.",
        "",
    ]
    for exponent in sorted({row.exponent for row in rows}):
        chosen = {(r.method, r.order): r.floor for r in rows if r.exponent == exponent}
        names = dict.fromkeys(name for name, _ in chosen)
        orders = sorted({order for _, order in chosen})
        body = [
            (name, *(number(chosen.get((name, order), math.nan), ".0e") for order in orders))
            for name in names
        ]
        made += [f"## N = 2^{exponent}", ""]
        made.append(table("", ("method", *(f"{order:g}" for order in orders)), body).lstrip("\n"))
    return "\n".join(made)
