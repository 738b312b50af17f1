"""A random scene of each kind in every run of the tests, 900 by a named command."""

import numpy as np
import pytest

from benchmarks.tolerances import GROUPS, ToleranceRow, run_index


@pytest.fixture(scope="module")
def rows() -> list[ToleranceRow]:
    return run_index(1, GROUPS["tolerances"])


def test_nothing_is_met_and_wrong(rows):
    assert not [row for row in rows if row.is_wrong]
    # most of them are judged by their references
    assert sum(row.is_judged for row in rows) >= 0.7 * len(rows)


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["pulses", "narrower pulses"])
def test_pulses_are_not_met_and_wrong(name):
    rows = run_index(5, GROUPS[name])
    assert all(row.is_judged and not row.is_wrong for row in rows)


def test_smooth_scenes_are_not_refused(rows):
    smooth = [row for row in rows if row.kind not in ("kinks and walls", "near the separatrix")]
    assert [row for row in smooth if row.reason] == []


def test_estimates_are_not_below_a_third_of_the_error(rows):
    known = [row for row in rows if row.error > 10 * row.reference_error]
    assert known
    assert min(row.estimate / row.error for row in known) >= 1 / 3
    assert float(np.median([row.estimate / row.error for row in known])) <= 10
