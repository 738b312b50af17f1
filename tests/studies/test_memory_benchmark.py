"""Memory is measured and said; the figures themselves are met on large runs only."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from fvi_cli.studies.memory_benchmark import (
    LONG_RUN,
    MemoryTable,
    measure_memory,
    memory_cases,
    run_memory_benchmark,
)


def test_every_case_is_measured_at_a_small_size() -> None:
    rows = [measure_memory(case) for case in memory_cases(10, 2000)]
    assert [row.n_steps for row in rows] == [1024] * 4 + [2000]
    for row in rows:
        assert row.seconds_per_step > 0 < row.doubles_per_step
        # at least the interpreter, and no more than this process
        assert 1e7 < row.process_bytes < 1e11
    text = MemoryTable(rows=tuple(rows)).to_markdown().splitlines()
    assert len(text) == len(rows) + 4
    assert len({line.count("|") for line in text[2:]}) == 1


def test_the_whole_trajectory_by_exponentials_is_all_there_is() -> None:
    """Time, position, momentum and energy are four doubles; the fixed part is the difference."""
    case = memory_cases(18)[3]
    assert case.name.endswith("exponentials")
    shorter = measure_memory(replace(case, n_steps=2**17))
    longer = measure_memory(case)
    added = longer.doubles_per_step * 2**18 - shorter.doubles_per_step * 2**17
    assert added / 2**17 == pytest.approx(4.0, abs=0.1)
    # control: what the history by FFT adds
    usual = [measure_memory(replace(memory_cases(15)[1], n_steps=2**k)) for k in (14, 15)]
    added = usual[1].doubles_per_step * 2**15 - usual[0].doubles_per_step * 2**14
    assert added / 2**14 > 10


def test_a_figure_that_is_not_met_is_said() -> None:
    row = measure_memory(memory_cases(8, 1000)[-1])
    assert math.isnan(row.extrapolated_bytes)
    assert row.is_met
    assert not replace(row, extrapolated_bytes=1e9).is_met
    assert not replace(row, largest_doubles=0.0).is_met


def test_long_runs_are_extrapolated(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the run and one of a tenth, on a line."""
    measured = measure_memory(memory_cases(8, 1000)[-1])

    def row(index: int, exponent: int, long_steps: int) -> object:
        return replace(measured, n_steps=long_steps, process_bytes=5e7 + 2.0 * long_steps)

    monkeypatch.setattr("fvi_cli.studies.memory_benchmark._row", row)
    rows = run_memory_benchmark(exponent=8, long_steps=10**4).rows
    assert rows[-1].extrapolated_bytes == pytest.approx(5e7 + 2.0 * LONG_RUN)


@pytest.mark.parametrize("arguments", [{"exponent": 30}, {"long_steps": 10}])
def test_refusals(arguments: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="is not allowed"):
        run_memory_benchmark(**arguments)
