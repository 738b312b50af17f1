"""Many oscillators are measured and said; the figures themselves are met on large runs only."""

from __future__ import annotations

from dataclasses import replace

import pytest

from fvi_cli.studies.many_benchmark import (
    ManyRow,
    ManyTable,
    many_cases,
    measure_many,
    run_many_benchmark,
)


def test_every_case_at_a_small_size() -> None:
    rows = [measure_many(case, 12, 256) for case in many_cases()]
    for row in rows:
        assert row.alone_seconds > 0 < row.together_seconds
        assert row.difference <= 1e-12
    members, series, uncoupled, dampers, one_damper = rows
    # counted: components of a batch cost what they cost alone; in a chain the damped ones count
    assert members.history_operations == series.history_operations == 12 * one(members)
    assert uncoupled.history_operations == dampers.history_operations == 12 * one(members)
    assert one_damper.history_operations < 6 * one(members)
    text = ManyTable(rows=tuple(rows)).to_markdown().splitlines()
    assert len(text) == len(rows) + 4
    assert len({line.count("|") for line in text[2:]}) == 1


def one(members: ManyRow) -> int:
    return members.history_operations // members.count


def test_a_figure_that_is_missed_is_said() -> None:
    row = measure_many(many_cases()[0], 8, 64)
    assert replace(row, largest_each=1e9).is_met
    missed = replace(row, largest_each=1e-9)
    assert not missed.is_met
    assert ManyTable(rows=(missed,)).to_markdown().rstrip().endswith("no |")


def test_in_child_processes() -> None:
    with pytest.raises(ValueError, match="exponent: 30 is not allowed"):
        run_many_benchmark(30)
    table = run_many_benchmark(5)
    assert [row.count for row in table.rows] == [8] * len(many_cases())
    assert [row.n_steps for row in table.rows] == [32] * len(many_cases())
