"""Curves of cost: times to accuracies, orders, who is cheapest, on curves that are known."""

import dataclasses
import math

import pytest
from cost_tables import COUNTS, GAUSS, row, table
from hypothesis import given
from hypothesis import strategies as st

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.studies.cost import CostCase, CostRow
from fvi_cli.studies.cost_curves import (
    CostCurve,
    cheapest_at,
    cheapest_bands,
    cost_curves,
    pareto_front,
)


def curve(key: str, rows: list[CostRow], method: AnyMethod = GAUSS) -> CostCurve:
    return CostCurve(key=key, method=method, points=tuple(rows))


def power_law(key: str, order: float, exponent: float, scale: float = 1e-4) -> CostCurve:
    return curve(key, [row(n, n**-order, scale * n**exponent) for n in COUNTS])


@pytest.mark.parametrize(("order", "exponent"), [(1, 1.2), (2, 2), (6, 1)])
def test_power_laws_are_found_again(order, exponent):
    law = power_law("law", order, exponent)
    assert law.order == pytest.approx(order)
    assert law.time_exponent == pytest.approx(exponent)
    assert law.cost_of_a_digit == pytest.approx(10 ** (exponent / order))
    between = 55.0
    accuracy = between**-order
    assert law.seconds_to(accuracy) == pytest.approx(1e-4 * between**exponent)
    beyond = 1000.0
    assert math.isnan(law.seconds_to(beyond**-order))
    assert law.extrapolated_seconds(beyond**-order) == pytest.approx(1e-4 * beyond**exponent)
    # what was reached is not extrapolated
    assert math.isnan(law.extrapolated_seconds(accuracy))


def test_the_coarsest_run_is_enough_for_less():
    law = power_law("law", 2, 1)
    assert law.seconds_to(0.5) == pytest.approx(1e-3)


def test_a_quicker_run_that_is_good_enough_counts():
    # the third run is no better but slower than the fourth
    rows = [row(10, 1e-2, 1.0), row(20, 1e-4, 5.0), row(40, 1e-6, 2.0)]
    assert curve("odd", rows).seconds_to(1e-4) == pytest.approx(2.0)


def test_no_error_at_all_is_reached_by_its_own_run_only():
    exact = curve("exact", [row(10, 1e-2, 1.0), row(20, 0.0, 2.0, "floor")])
    assert exact.seconds_to(1e-4) == 2.0
    assert exact.seconds_to(1e-1) == 1.0


def test_rows_at_the_floor_have_no_order():
    rows = [row(n, max(n**-4.0, 1e-8), 1e-4 * n) for n in COUNTS]
    spoiled = curve("spoiled", rows).order
    marked = [dataclasses.replace(r, status="floor") if r.error == 1e-8 else r for r in rows]
    assert spoiled < 3.5
    assert curve("marked", marked).order == pytest.approx(4.0)


def test_what_stalls_is_not_continued():
    stalled = curve("stalled", [row(n, 1e-3 + n**-2.0, 1e-4 * n) for n in (100, 200, 400, 800)])
    assert math.isnan(stalled.extrapolated_seconds(1e-6))
    two = curve("two", [row(10, 1e-2, 1.0), row(20, 1e-3, 2.0)])
    assert math.isnan(two.extrapolated_seconds(1e-6))
    assert math.isnan(two.order)


def test_the_bands_change_where_the_curves_cross():
    # the coarsest run of the second takes 9e-4 sqrt(10), the first needs 1e-4 / e
    first = curve("first", [row(n, 1 / n, 1e-4 * n) for n in COUNTS])
    second = curve("second", [row(n, n**-2.0, 9e-4 * n**0.5) for n in COUNTS])
    crossing = 1e-4 / (9e-4 * math.sqrt(10))
    bands = cheapest_bands([first, second])
    assert [band.curve.key for band in bands] == ["first", "second"]
    # a tenth later, for less is a tie
    assert bands[0].fine == bands[1].coarse == pytest.approx(crossing / 1.1, rel=0.06)
    assert bands[0].coarse == 1.0
    assert bands[0].least_seconds == pytest.approx(1e-3, rel=0.06)
    assert bands[1].most_seconds == pytest.approx(9e-4 * 160**0.5, rel=0.06)
    assert cheapest_at(bands, 2 * crossing) is first
    assert cheapest_at(bands, crossing / 2) is second
    # a tie stays with the one before, here as in the bands
    assert cheapest_at(bands, bands[0].fine) is first
    assert second.seconds_to(bands[0].fine) < first.seconds_to(bands[0].fine)


def test_nobody_is_cheapest_where_nobody_comes():
    law = power_law("law", 2, 1)
    bands = cheapest_bands([law])
    assert cheapest_at(bands, 1.1 * 160**-2.0) is law
    assert cheapest_at(bands, 0.9 * 160**-2.0) is None
    assert bands[-1].fine >= 160**-2.0 > bands[-1].fine / 1.1
    assert cheapest_bands([]) == []


def test_the_order_is_that_of_the_two_finest_rows_above_the_floor():
    errors = (1e-1, 1e-1 / 2**3, 1e-1 / 2**8, 1e-1 / 2**12, 1e-15)
    rows = [row(n, e, 1e-4 * n) for n, e in zip(COUNTS, errors, strict=True)]
    rows[-1] = dataclasses.replace(rows[-1], status="floor")
    assert curve("late", rows).order == pytest.approx(4.0)


pairs = st.tuples(st.floats(1e-12, 1.0), st.floats(1e-4, 10.0))


@given(st.lists(st.lists(pairs, min_size=1, max_size=6), min_size=1, max_size=4))
def test_the_front_holds_what_nobody_beats(values):
    curves = [
        curve(f"c{k}", [row(n + 1, e, s) for n, (e, s) in enumerate(one)])
        for k, one in enumerate(values)
    ]
    front = {(p.error, p.seconds) for _, p in pareto_front(curves)}
    everything = {(p.error, p.seconds) for c in curves for p in c.points}
    best = {
        (e, s)
        for e, s in everything
        if not any((a <= e and b <= s and (a, b) != (e, s)) for a, b in everything)
    }
    assert front == best


def test_what_is_exact_by_chance_is_not_rated():
    lucky = curve("lucky", [row(n, 1e-16, 1e-5 * n, "floor") for n in COUNTS])
    other = power_law("other", 2, 1)
    assert lucky.is_exact_by_chance
    assert not other.is_exact_by_chance
    # one of two runs at the floor may be due to its accuracy
    assert not curve("short", [row(10, 1e-16, 1.0, "floor")]).is_exact_by_chance
    assert cheapest_at(cheapest_bands([lucky, other]), 1e-3) is other
    assert {found.key for found, _ in pareto_front([lucky, other])} == {"other"}


def test_runs_that_failed_are_on_no_curve():
    rows = (row(10, math.inf, 1.0, "diverged"), row(20, 1e-3, 2.0))
    (found,) = cost_curves(table(CostCase(method=GAUSS, rows=rows)))
    assert len(found.points) == 1
    assert cost_curves(table(CostCase(method=GAUSS, rows=rows[:1]))) == []
