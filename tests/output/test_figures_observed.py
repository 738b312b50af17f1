"""Figures of quantities and sections draw what was observed."""

from __future__ import annotations

import numpy as np
import pytest

import fvi_cli as fvi

CONFIG = {
    "name": "seen",
    "problem": {
        "kind": "duffing",
        "damping": [{"order": 0.5, "coefficient": 0.2}],
        "forcing": "cos(t)",
        "initial": {"position": 1.0},
        "final_time": 40.0,
        "exact": "none",
    },
    "method": {"rk": "gauss", "degree": [3, 4]},
    "ladder": {"steps": [200]},
    "quantities": {"force": "dx", "a": "ax"},
    "events": {"period": {"when": "sin(t)", "direction": "rising"}},
    "figures": ["quantities", "section", "error"],
}


@pytest.fixture(scope="module")
def outcome() -> fvi.Outcome:
    return fvi.run(CONFIG)[0]


def test_quantities_over_time_with_their_peaks(outcome: fvi.Outcome) -> None:
    figures = fvi.figures(outcome)
    assert set(figures) == {"seen-quantities", "seen-section"}
    panels = figures["seen-quantities"].axes
    assert [axes.get_ylabel() for axes in panels] == ["force", "a"]
    observed = outcome.finished[-1].trajectory.observed
    assert observed is not None
    for axes, name in zip(panels, ("force", "a"), strict=True):
        drawn = axes.lines[1].get_ydata()
        assert np.array_equal(drawn, observed.quantities[name])
        (peak_time,), (height,) = axes.lines[-1].get_data()
        assert abs(height) == observed.extents[name].peak
        assert peak_time == observed.extents[name].peak_time


def test_a_section_has_a_point_for_every_event(outcome: fvi.Outcome) -> None:
    (axes,) = fvi.figures(outcome)["seen-section"].axes
    observed = outcome.finished[0].trajectory.observed
    assert observed is not None
    assert axes.lines[0].get_xdata().size == observed.events["period"].time.size == 6
    assert axes.get_xlabel() == "position x"


def test_round_off_does_not_fill_a_panel() -> None:
    chain = {"kind": "chain", "masses": 2, "initial": {"position": [1.0, 0.0]}, "final_time": 20.0}
    config = {**CONFIG, "problem": {**chain, "exact": "none"}, "method": {"rk": "gauss"}}
    config |= {"events": {"turn": {"when": "vx1"}}, "figures": ["section"], "quantities": {}}
    (figure,) = fvi.figures(fvi.run(config)).values()
    low, high = figure.axes[0].get_ylim()
    assert high - low > 1e-3
