"""Curves of cost: how long a method takes to an accuracy, what a digit costs, who is cheapest."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from fvi_cli.integrator.method import AnyMethod, Baseline
from fvi_cli.studies.cost import CostCase, CostRow, CostTable
from fvi_cli.studies.order import fit_slope, pairwise_order

T = TypeVar("T")

ACCURACIES = tuple(10.0**-k for k in range(2, 13, 2))
"""The accuracies of a summary: 1e-2, 1e-4, ... 1e-12."""

FINEST_ROWS = 4
"""Exponents of time are fitted to this many rows, the finest above the floor."""

MOST_FIXED = 0.5
"""Rows in which more than this share of the time is no steps' are in no fit of times."""

LEAST_DECREASE = 1.2
"""Errors that fall less than this from row to row do not lead anywhere."""


@dataclass(frozen=True, kw_only=True)
class CostCurve:
    """The runs of one method that reached something, as points of error and time.

    ``dop853`` chooses its own steps: its runs of all tolerances are one curve.
    """

    key: str  # case of the method, or its name where tolerances make the curve
    methods: tuple[AnyMethod, ...]
    points: tuple[CostRow, ...]
    """In the order of N, or of falling errors where tolerances make the curve."""

    @property
    def is_by_tolerance(self) -> bool:
        """Whether a tolerance, not N, leads along the curve."""
        method = self.methods[0]
        return isinstance(method, Baseline) and method.tolerance is not None

    @property
    def is_exact_by_chance(self) -> bool:
        """Whether there is nothing but round-off from the coarsest of three runs or more on.

        That says something of the solution. Such a method is not rated among the others.
        """
        return len(self.points) > 2 and all(p.status == "floor" for p in self.points)

    def seconds_to(self, accuracy: float) -> float:
        """Least set-up plus stepping time to an error of at most `accuracy`; nan: not reached.

        Between two neighbouring runs it is interpolated, both logarithmic; where even the coarsest
        run is better, it is that run's time.
        """
        reached = [point.seconds for point in self.points if point.error <= accuracy]
        for first, second in itertools.pairwise(self.points):
            if 0 < second.error <= accuracy < first.error:
                share = math.log(first.error / accuracy) / math.log(first.error / second.error)
                reached.append(first.seconds * (second.seconds / first.seconds) ** share)
        return min(reached, default=math.nan)

    def extrapolated_seconds(self, accuracy: float) -> float:
        """Time to an accuracy that no run reached, along the finest rows; nan where that is vain.

        A guess, and for methods with a sum over the past a low one: their time exponent still
        grows towards 2.
        """
        last = self._stepping()
        if not last or accuracy >= min(point.error for point in self.points):
            return math.nan
        if any(b.error > a.error / LEAST_DECREASE for a, b in itertools.pairwise(last)):
            return math.nan
        cost = self.cost_of_a_digit
        # time that does not rise yet cannot be continued
        if not cost > 1:
            return math.nan
        decades = math.log10(last[-1].error / accuracy)
        return float(last[-1].seconds * cost**decades)

    def _finest(self) -> tuple[CostRow, ...]:
        """The finest rows above the floor; none where there are less than three.

        Where tolerances make the curve, only those that no other beats.
        """
        points: Sequence[CostRow] = self.points
        if self.is_by_tolerance:
            points = unbeaten(points, lambda point: (point.error, point.seconds))
        above = [point for point in points if point.status == "ok" and point.error > 0]
        return tuple(above[-FINEST_ROWS:]) if len(above) > 2 else ()

    @property
    def fixed_seconds(self) -> float:
        """What a run without steps would take: a of the nearest a + b N + c N^2.

        None of the three is negative, and every run counts by its relative distance. Nan where
        tolerances make the curve.
        """
        if self.is_by_tolerance:
            return math.nan
        counts = np.array([float(point.n_steps) for point in self.points])
        seconds = np.array([point.seconds for point in self.points])
        powers = (counts / counts.max())[:, None] ** np.arange(3)
        from scipy.optimize import nnls

        return float(nnls(powers / seconds[:, None], np.ones(seconds.size))[0][0])

    def _stepping(self) -> tuple[CostRow, ...]:
        """Of the finest rows those whose steps take most of the time; none of less than three."""
        fixed = 0.0 if self.is_by_tolerance else self.fixed_seconds
        kept = [
            point
            for point in self._finest()
            if max(point.setup_seconds, fixed) <= MOST_FIXED * point.seconds
        ]
        return tuple(kept) if len(kept) > 2 else ()

    @property
    def has_hidden_slopes(self) -> bool:
        """Whether there are rows enough for slopes of time, but for what is no steps' in them."""
        return bool(self._finest()) and not self._stepping()

    @property
    def order(self) -> float:
        """Order between the two finest rows above the floor; nan with less than three.

        The last of the orders in an order table; a fit would mix in coarse steps.
        """
        last = self._finest()[-2:]
        if self.is_by_tolerance or not last:
            return math.nan
        coarse, fine = last
        return pairwise_order(coarse.error, fine.error, coarse.n_steps, fine.n_steps)

    @property
    def time_exponent(self) -> float:
        """Slope of log time against log N over the finest rows whose steps take most of the time.

        Nan with less than three.
        """
        if self.is_by_tolerance:
            return math.nan
        last = self._stepping()
        return -fit_slope([p.n_steps for p in last], [p.seconds for p in last])[0]

    @property
    def cost_of_a_digit(self) -> float:
        """Factor in time for a tenth of the error, over the same rows; nan with less."""
        last = self._stepping()
        if not last:
            return math.nan
        errors = np.log10([point.error for point in last])
        if np.ptp(errors) == 0:
            return math.nan
        slope = np.polyfit(-errors, np.log10([point.seconds for point in last]), 1)[0]
        return float(10.0**slope)


def cost_curves(table: CostTable) -> list[CostCurve]:
    """One curve per method, dop853 in one; methods without a usable run are left out."""
    grouped: dict[str, list[CostCase]] = {}
    for case in table.cases:
        method = case.method
        key = method.case
        if isinstance(method, Baseline) and method.tolerance is not None:
            key = method.name
        grouped.setdefault(key, []).append(case)
    curves = []
    for key, cases in grouped.items():
        points = [row for case in cases for row in case.rows if row.is_usable]
        if len(cases) > 1:
            points.sort(key=lambda point: -point.error)
        if points:
            methods = tuple(case.method for case in cases)
            curves.append(CostCurve(key=key, methods=methods, points=tuple(points)))
    return curves


@dataclass(frozen=True, kw_only=True)
class Band:
    """Errors from `coarse` (excluded) down to `fine` at which one method is cheapest."""

    coarse: float
    fine: float
    curve: CostCurve
    least_seconds: float
    most_seconds: float


SAMPLES_PER_DECADE = 40
DECADES = 13
"""Who is cheapest is asked for errors from 1 down to 1e-13; what is below is round-off."""

TIE = 1.1
"""Times that differ by less than this factor are taken for equal."""


def cheapest_bands(curves: Sequence[CostCurve]) -> list[Band]:
    """Who is cheapest from an error of 1 down to 1e-13; gaps that no method reaches.

    A method stays in its band until another one is quicker by a tenth: less is within what times
    scatter. Methods that are exact by chance are not asked.
    """
    rated = [curve for curve in curves if not curve.is_exact_by_chance]
    count = SAMPLES_PER_DECADE * DECADES
    errors = [10.0 ** (-k / SAMPLES_PER_DECADE) for k in range(count + 1)]
    bands: list[Band] = []
    for coarse, fine in itertools.pairwise(errors):
        times = [curve.seconds_to(fine) for curve in rated]
        least = min((time for time in times if not math.isnan(time)), default=None)
        if least is None:
            continue
        curve, seconds, start = rated[times.index(least)], least, coarse
        before: tuple[float, ...] = ()
        if bands and bands[-1].fine == coarse:
            last = bands[-1]
            stays = last.curve.seconds_to(fine)
            if stays <= TIE * least:
                curve, seconds = last.curve, stays
            if curve is last.curve:
                start, before = bands.pop().coarse, (last.least_seconds, last.most_seconds)
        bands.append(
            Band(
                coarse=start,
                fine=fine,
                curve=curve,
                least_seconds=min((seconds, *before)),
                most_seconds=max((seconds, *before)),
            )
        )
    return bands


def cheapest_at(bands: Sequence[Band], error: float) -> CostCurve | None:
    """The method of the band that holds an error; None where no method reaches it."""
    return next((band.curve for band in bands if band.coarse > error >= band.fine), None)


def unbeaten(runs: Iterable[T], of: Callable[[T], tuple[float, float]]) -> list[T]:
    """The runs that no other is as accurate as for less, the cheapest first.

    `of` gives the error and the cost of a run.
    """
    found: list[T] = []
    for run in sorted(runs, key=lambda one: of(one)[::-1]):
        if not found or of(run)[0] < of(found[-1])[0]:
            found.append(run)
    return found


def pareto_front(curves: Sequence[CostCurve]) -> list[tuple[CostCurve, CostRow]]:
    """The runs that no other run beats in both error and time, the quickest first."""
    rated = [curve for curve in curves if not curve.is_exact_by_chance]
    everything = [(curve, point) for curve in rated for point in curve.points]
    return unbeaten(everything, lambda one: (one[1].error, one[1].seconds))
