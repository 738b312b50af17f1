"""A random scene of each of ten kinds in every run of the tests, 400 by a named command."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.pulse_scenes import PULSE_KINDS
from benchmarks.tolerances import (
    ToleranceRow,
    read_rows,
    run_index,
    run_tolerances,
    tolerance_table,
    write_rows,
)

INDICES = (1,)


@pytest.fixture(scope="module")
def rows() -> list[ToleranceRow]:
    return [row for index in INDICES for row in run_index(index)]


def test_nothing_is_met_and_wrong(rows):
    assert not [row for row in rows if row.is_wrong]
    # most of them are judged by their references
    judged = [row for row in rows if row.outcome == "met" and row.is_judged]
    assert len(judged) >= 0.7 * len(rows)


def test_narrow_pulses_and_singular_starts_are_not_met_and_wrong():
    rows = run_index(5, kinds=PULSE_KINDS)
    assert [row.kind for row in rows if row.is_judged] == [
        "pulses at rest",
        "pulses in motion",
        "pulses on a slope",
        "Riemann-Liouville",
    ]
    assert [row.outcome for row in rows] == 4 * ["met"]
    assert not [row for row in rows if row.is_wrong]


@pytest.mark.slow
@pytest.mark.parametrize("index", range(100, 110))
def test_more_pulses(index):
    rows = run_index(index, kinds=PULSE_KINDS)
    assert not [row for row in rows if row.is_wrong]


def test_smooth_scenes_are_not_refused(rows):
    smooth = [row for row in rows if row.kind not in ("kinks and walls", "near the separatrix")]
    assert [row for row in smooth if row.outcome != "met"] == []


def test_estimates_are_not_below_a_third_of_the_error(rows):
    known = [row for row in rows if row.error > 10 * row.reference_error]
    assert known
    assert min(row.estimate / row.error for row in known) >= 1 / 3
    assert float(np.median([row.estimate / row.error for row in known])) <= 10


def test_the_table_tells_of_what_is_wrong():
    """The control: a row whose error is above the tolerance is counted."""
    row = ToleranceRow(
        kind="linear",
        outcome="met",
        reason="",
        tolerance=1e-6,
        estimate=5e-7,
        error=2e-7,
        reference_error=1e-12,
        rounds=1,
        n_steps=20,
        seconds=0.02,
        by_hand=0.01,
        once=0.008,
    )
    wrong = replace(row, error=2e-6)
    refused = replace(row, outcome="refused", reason="out of reach")
    blind = replace(row, reference_error=1e-6, error=math.inf, outcome="unreliable")
    assert (row.is_wrong, wrong.is_wrong, blind.is_judged) == (False, True, False)
    text = tolerance_table([row, wrong, refused, blind])
    (line,) = (line for line in text.splitlines() if line.startswith("| all |"))
    assert "| 4 | 2 | 1 | 1 | 1 of 2 judged | 2 |" in line
    assert line.endswith("| 2, 2 | 2.5, 2.5 |")
    assert "refused, out of reach" in text


def test_what_is_kept_is_read_again(rows, tmp_path):
    write_rows(tmp_path / "kept" / "tolerances.csv", rows)
    assert str(read_rows(tmp_path / "kept" / "tolerances.csv")) == str(list(rows))
    (only,) = (tmp_path / "kept").iterdir()
    # enough is there: nothing is computed
    assert str(run_tolerances(1, kept=only)) == str(list(rows[:10]))
