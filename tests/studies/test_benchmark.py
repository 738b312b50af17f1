"""The benchmark measures, counts and says what it measured; no time is asserted."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from fvi_cli.studies.benchmark import (
    BenchmarkTable,
    measure_case,
    run_benchmark,
    standard_cases,
)


def test_every_case_is_measured_at_a_small_size() -> None:
    rows = []
    for case in standard_cases(8):
        row = measure_case(case, repeats=1, memory=case.name.endswith("Gauss2"))
        rows.append(row)
        assert row.n_steps == 2**case.exponent
        assert row.stepping_seconds > 0 < row.yardstick_seconds
        assert math.isnan(row.error) == (case.scene == "pendulum")
        assert not row.error > 1e-3
        if case.order != 1:
            assert row.history_operations > 0
        assert math.isfinite(row.doubles_per_step) == case.name.endswith("Gauss2")
        assert row.speed_up > 0
    text = BenchmarkTable(rows=tuple(rows)).to_markdown().splitlines()
    assert len(text) == len(rows) + 4
    assert len({line.count("|") for line in text[2:]}) == 1
    assert "2^8" in text[4]


def test_a_figure_that_is_not_met_is_said() -> None:
    case = standard_cases(6)[0]
    row = measure_case(replace(case, largest_error=0.0), repeats=1, memory=False)
    assert not row.is_met
    assert not replace(row, largest_error=1.0, largest_multiple=0.0).is_met
    assert replace(row, largest_error=1.0, largest_multiple=math.inf).is_met


def test_growth_is_that_of_the_times() -> None:
    case = replace(standard_cases(15)[0], exponent=15)
    row = measure_case(case, repeats=1, memory=False)
    assert math.isfinite(row.growth_exponent)
    assert math.isnan(row.speed_up)


def test_child_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    all_cases = standard_cases(6)
    monkeypatch.setattr("fvi_cli.studies.benchmark.standard_cases", lambda exponent: all_cases[:1])
    table = run_benchmark(exponent=6, repeats=1, memory=False)
    assert [row.name for row in table.rows] == [all_cases[0].name]
    assert table.rows[0].n_steps == 64


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"exponent": 30}, "exponent: 30"),
        ({"repeats": 0}, "repeats: 0"),
    ],
)
def test_refusals(arguments: dict[str, int], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        run_benchmark(**arguments)
