"""Curves of cost: the time of a method for an accuracy and for a digit, the cheapest method."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.studies.cost import CostRow, CostTable
from fvi_cli.studies.order import fit_slope, pairwise_order

T = TypeVar("T")

ACCURACIES = tuple(10.0**-k for k in range(2, 13, 2))
"""The accuracies of a summary: 1e-2, 1e-4, ... 1e-12."""

FINEST_ROWS = 4
"""Exponents of time are fitted to this many rows, the finest above the floor."""

MOST_FIXED = 0.5
"""Fits of times omit rows that spend more than this share of their time on other than steps."""

LEAST_DECREASE = 1.2
"""No time is extrapolated where errors fall by less than this factor from row to row."""


@dataclass(frozen=True, kw_only=True)
class CostCurve:
    """The usable runs of one method in the order of N, as points of error and time."""

    key: str  # name of the method in files
    method: AnyMethod
    points: tuple[CostRow, ...]

    @property
    def is_exact_by_chance(self) -> bool:
        """Whether there are three runs or more and the errors of all are round-off.

        The reason is then the solution, not the method, which is not rated among the others.
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
        """Time to an accuracy that no run reached, along the finest rows; nan if they give none.

        A guess, and for methods with a sum over the past a low one: their time exponent still
        grows towards 2.
        """
        last = self._stepping()
        if not last or accuracy >= min(point.error for point in self.points):
            return math.nan
        if any(b.error > a.error / LEAST_DECREASE for a, b in itertools.pairwise(last)):
            return math.nan
        cost = self.cost_of_a_digit
        # a time that does not rise yet cannot be extrapolated
        if not cost > 1:
            return math.nan
        decades = math.log10(last[-1].error / accuracy)
        return float(last[-1].seconds * cost**decades)

    def _finest(self) -> tuple[CostRow, ...]:
        """The finest rows above the floor; none where there are less than three."""
        above = [point for point in self.points if point.status == "ok" and point.error > 0]
        return tuple(above[-FINEST_ROWS:]) if len(above) > 2 else ()

    @property
    def fixed_seconds(self) -> float:
        """Time of a run without steps: the constant a of the fit a + b N + c N^2.

        The fit minimises relative distances with a, b and c >= 0.
        """
        counts = np.array([float(point.n_steps) for point in self.points])
        seconds = np.array([point.seconds for point in self.points])
        powers = (counts / counts.max())[:, None] ** np.arange(3)
        from scipy.optimize import nnls

        return float(nnls(powers / seconds[:, None], np.ones(seconds.size))[0][0])

    def _stepping(self) -> tuple[CostRow, ...]:
        """The finest rows whose steps take most of the time; none if these are less than three."""
        fixed = self.fixed_seconds
        kept = [
            point
            for point in self._finest()
            if max(point.setup_seconds, fixed) <= MOST_FIXED * point.seconds
        ]
        return tuple(kept) if len(kept) > 2 else ()

    @property
    def has_hidden_slopes(self) -> bool:
        """Whether there are no slopes of time only because set-up takes too much of the rows."""
        return bool(self._finest()) and not self._stepping()

    @property
    def order(self) -> float:
        """Order between the two finest rows above the floor; nan with less than three.

        The last of the orders in an order table; a fit would mix in coarse steps.
        """
        last = self._finest()[-2:]
        if not last:
            return math.nan
        coarse, fine = last
        return pairwise_order(coarse.error, fine.error, coarse.n_steps, fine.n_steps)

    @property
    def time_exponent(self) -> float:
        """Slope of log time against log N over the finest rows whose steps take most of the time.

        Nan with less than three.
        """
        last = self._stepping()
        return -fit_slope([p.n_steps for p in last], [p.seconds for p in last])[0]

    @property
    def cost_of_a_digit(self) -> float:
        """Factor in time for a tenth of the error, over the same rows; nan with less than three."""
        last = self._stepping()
        if not last:
            return math.nan
        errors = np.log10([point.error for point in last])
        if np.ptp(errors) == 0:
            return math.nan
        slope = np.polyfit(-errors, np.log10([point.seconds for point in last]), 1)[0]
        return float(10.0**slope)


def cost_curves(table: CostTable) -> list[CostCurve]:
    """One curve per method; methods without a usable run are left out."""
    found = [
        CostCurve(
            key=case.method.case,
            method=case.method,
            points=tuple(row for row in case.rows if row.is_usable),
        )
        for case in table.cases
    ]
    return [curve for curve in found if curve.points]


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
"""The cheapest method is found for errors from 1 down to 1e-13; smaller ones are round-off."""

TIE = 1.1
"""Times that differ by less than this factor count as equal."""


def cheapest_bands(curves: Sequence[CostCurve]) -> list[Band]:
    """The cheapest methods from an error of 1 down to 1e-13; no band where no method gets there.

    A band ends where another method is quicker by a tenth: smaller differences are scatter.
    Methods that are exact by chance are left out.
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
    """The runs for which no cheaper run is as accurate, the cheapest first.

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
