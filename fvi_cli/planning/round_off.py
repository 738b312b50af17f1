"""Round-off of runs: the measured floors of the methods."""

from __future__ import annotations

import csv
import functools
import itertools
import math
from pathlib import Path
from typing import Final

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.mathematics.arrays import Array

EPSILON: Final = float(np.finfo(float).eps)

TABLE: Final = Path(__file__).with_name("round_off.csv")
"""Table of floors, measured by ``python -m benchmarks floors``."""

SAFETY: Final = 10.0
"""Safety factor, since scenes differ from the measured one."""


def relative_round_off(scene: Scene | None, method: AnyMethod, n_steps: int) -> float:
    r"""Round-off of a run relative to the largest position.

    It is the larger of :math:`100 \epsilon \sqrt{N}` and :data:`SAFETY` times the measured floor of
    the method for the highest order of damping; the floor is large near order 2.
    """
    usual = 100 * EPSILON * math.sqrt(n_steps)
    order = max((term.order for term in scene.active_damping), default=0.0) if scene else 0.0
    if not isinstance(method, Method) or order == 0.0:
        return usual
    return max(usual, SAFETY * measured_floor(method, order, n_steps))


def measured_floor(method: Method, order: float, n_steps: int) -> float:
    """The floor of a method: its logarithm is interpolated in the order and in log N.

    Below the least N of the table it is proportional to N; above the largest N, and above the
    largest order, it is extrapolated from the last two. The nearest degree of the table is used.
    """
    rows = _rows_of(method)
    if not rows:
        return 0.0
    size, floors = math.log(n_steps), []
    for pairs in rows.values():
        sizes, values = (np.array(column) for column in zip(*pairs, strict=True))
        less = math.exp(min(size - sizes[0], 0.0))
        floors.append(less * _along(max(size, sizes[0]), sizes, values))
    orders = np.array(list(rows))
    return _along(max(order, orders[0]), orders, np.array(floors))


def _along(at: float, places: Array, values: Array) -> float:
    """Value at a place; logarithms are linear between increasing places and beyond the last."""
    if places.size == 1:
        return float(values[0])
    k = int(np.clip(np.searchsorted(places, at), 1, places.size - 1))
    part = (at - places[k - 1]) / (places[k] - places[k - 1])
    return float(values[k - 1] * (values[k] / values[k - 1]) ** part)


def _rows_of(method: Method) -> dict[float, tuple[tuple[float, float], ...]]:
    """Pairs (log N, floor) by increasing order, for the nearest method of the table."""
    of_kind = {key: rows for key, rows in _table().items() if key[0] == method.cq}
    if not of_kind:
        return {}
    nearest = min(of_kind, key=lambda key: (abs(key[2] - method.degree), key[1] != method.sampling))
    return of_kind[nearest]


@functools.lru_cache(maxsize=1)
def _table() -> dict[tuple[str, str, int], dict[float, tuple[tuple[float, float], ...]]]:
    found: dict[tuple[str, str, int], dict[float, list[tuple[float, float]]]] = {}
    with TABLE.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["status"] != "ok":
                continue
            error = float(row["error"]) if row["is_round_off"] == "True" else 0.0
            key = (row["cq"], row["sampling"], int(row["degree"]))
            of_order = found.setdefault(key, {}).setdefault(float(row["order"]), [])
            of_order.append((math.log(2) * int(row["exponent"]), max(float(row["units"]), error)))
    return {
        key: {order: _increasing(pairs) for order, pairs in sorted(rows.items())}
        for key, rows in found.items()
    }


def _increasing(pairs: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """The pairs with N increasing and floors that do not fall: one measurement is only a sample."""
    sizes, floors = zip(*sorted(pairs), strict=True)
    rising = itertools.accumulate((max(one, EPSILON) for one in floors), max)
    return tuple(zip(sizes, rising, strict=True))
