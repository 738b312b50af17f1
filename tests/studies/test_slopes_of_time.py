"""Slopes of time belong to the steps: rows that are set-up for the most part are left out."""

import dataclasses
import math
import os
import random

import pytest
from cost_tables import GAUSS, row, table
from spread import SEED

from fvi_cli.reports.kinds.cost import cost_report
from fvi_cli.reports.writers import rendered
from fvi_cli.studies.cost import CostCase, CostRow
from fvi_cli.studies.cost_curves import CostCurve, cost_curves

COUNTS = [16 * 2**k for k in range(9)]


def measured(chance: random.Random, fixed: float, exponent: float, named: float) -> list[CostRow]:
    """Rows of t = fixed + (N/256)^p that scatter; of what is fixed a part is named set-up."""
    rows = []
    for n in COUNTS:
        scatter = chance.uniform(0.93, 1.07)
        seconds = scatter * (fixed + (n / 256) ** exponent)
        one = row(n, n**-4.0, seconds)
        setup = scatter * named * fixed
        rows.append(
            dataclasses.replace(one, setup_seconds=setup, stepping_seconds_min=seconds - setup)
        )
    return rows


def curve(rows: list[CostRow]) -> CostCurve:
    return CostCurve(key="one", methods=(GAUSS,), points=tuple(rows))


@pytest.mark.parametrize("place", range(12))
def test_slopes_of_time_are_those_of_the_steps(place):
    chance = random.Random(f"{os.environ[SEED]} slopes {place}")
    exponent = chance.choice([1.0, 1.1, 2.0])
    # the largest run takes 16**exponent
    share = 10 ** chance.uniform(-3, 1.5)
    rows = measured(chance, share * 16**exponent, exponent, chance.choice([0.0, 0.5, 1.0]))
    found = curve(rows)
    if share > 1.2:
        assert math.isnan(found.time_exponent)
        assert math.isnan(found.cost_of_a_digit)
        assert found.has_hidden_slopes
        # the control: the same rows without what is fixed
        plain = curve(measured(chance, 1e-9, exponent, 0.0))
        assert plain.time_exponent == pytest.approx(exponent, abs=0.1)
    elif share < 0.03:
        assert found.time_exponent == pytest.approx(exponent, abs=0.15 * exponent + 0.1)
    # no slope is less than what half a share leaves of it
    if not math.isnan(found.time_exponent):
        assert 0.6 * exponent < found.time_exponent < exponent + 0.1
        digit = math.log10(found.cost_of_a_digit)
        assert digit == pytest.approx(found.time_exponent / 4)


def test_what_was_fitted_before():
    """The control: the four finest rows without regard to what is fixed have no slope."""
    chance = random.Random(1)
    rows = measured(chance, 300.0, 1.0, 1.0)
    assert math.isnan(curve(rows).time_exponent)
    last = rows[-4:]
    naive = math.log(last[-1].seconds / last[0].seconds) / math.log(8)
    assert naive < 0.1


def test_why_there_is_no_slope_is_printed():
    chance = random.Random(2)
    hidden = CostCase(method=GAUSS, rows=tuple(measured(chance, 300.0, 1.0, 0.3)))
    report = cost_report("one", [table(hidden)])
    text = rendered(report)["one-cost.md"]
    assert "no time exponent and no factor for a digit, since set-up" in text
    open_ = CostCase(method=GAUSS, rows=tuple(measured(chance, 0.01, 1.0, 0.3)))
    assert "no time exponent" not in rendered(cost_report("one", [table(open_)]))["one-cost.md"]
    (curve_,) = cost_curves(table(open_))
    assert curve_.time_exponent == pytest.approx(1.0, abs=0.1)
