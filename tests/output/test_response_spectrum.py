"""The figure of response spectra: what it draws, and when it is not drawn."""

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.plotting import left_out

SWEEP = {
    "name": "spectra",
    "problem": {
        "kind": "structure",
        "mass": 2.0,
        "stiffness": 8.0,
        "damping": [{"order": 0.5, "coefficient": 0.1}],
        "ground_acceleration": "sin(t)",
        "final_time": 12.0,
        "exact": "none",
    },
    "sweep": {
        "problem.stiffness": [2.0, 8.0, 20000.0],
        "problem.damping.0.coefficient": [0.1, 0.4],
    },
    "method": {"rk": "gauss", "degree": 2, "start": "graded"},
    "ladder": {"steps": [600]},
    "figures": ["spectrum"],
}


def test_it_draws_largest_displacements_over_periods():
    outcomes = fvi.run(fvi.load(SWEEP))
    figures = fvi.figures(outcomes)
    assert set(figures) == {"spectra-spectrum"}
    upper, lower = figures["spectra-spectrum"].axes
    assert [line.get_label() for line in upper.lines] == [
        "0.1",
        "0.4",
    ]
    (legend,) = figures["spectra-spectrum"].legends
    assert legend.get_title().get_text() == "coefficient of the damping"
    (outcome,) = outcomes
    for line, other in zip(upper.lines, lower.lines, strict=True):
        period, largest = np.array(line.get_xdata()), np.array(line.get_ydata())
        assert period == pytest.approx(2 * np.pi * np.sqrt(2.0 / np.array([20000.0, 8.0, 2.0])))
        # a stiff oscillator goes with the ground
        assert np.array(other.get_ydata())[0] == pytest.approx(1.0, rel=2e-2)
        assert other.get_ydata() == pytest.approx((2 * np.pi / period) ** 2 * largest)
    softest = {"problem.stiffness": 2.0, "problem.damping.0.coefficient": 0.1}
    soft = [
        one
        for one in outcome.finished
        if one.run.member is not None and one.run.member.values == softest
    ]
    assert upper.lines[0].get_ydata()[-1] == np.abs(soft[0].trajectory.position).max()


def test_of_one_oscillator_or_of_many_coordinates_there_is_none():
    alone = {key: value for key, value in SWEEP.items() if key != "sweep"}
    (outcome,) = fvi.run(fvi.load(alone))
    (line,) = left_out([(outcome.experiment, outcome.finished)])
    assert "it is drawn of a sweep over stiffness or mass" in line


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sweep": {"problem.damping.0.coefficient": [0.1, 0.4]}}, "write sweep: {problem.stiff"),
        ({"sweep": {"problem.stiffness": [8.0, -2.0]}}, "needs a positive stiffness"),
        (
            {
                "sweep": {"problem.mass": [1.0, 2.0]},
                "problem": {"kind": "duffing", "final_time": 1.0, "exact": "none"},
            },
            "must be a linear oscillator",
        ),
        ({"figures": ["balance"]}, "leave out sweep for one scene"),
    ],
)
def test_what_a_sweep_lacks_for_a_figure_is_said_and_nothing_is_drawn(changes, words):
    config = {**SWEEP, "ladder": {"steps": [20]}, **changes}
    (outcome,) = fvi.run(fvi.load(config))
    (line,) = left_out([(outcome.experiment, outcome.finished)])
    assert words in line
    assert fvi.figures(outcome) == {}


@pytest.mark.few(3)
@pytest.mark.parametrize("method", ["gauss3", {"baseline": "explicit-euler"}])
@pytest.mark.parametrize("is_stored", [True, False])
def test_a_figure_of_what_was_not_stored_says_what_to_write(method, is_stored):
    problem = {
        "kind": "kepler",
        "initial": {"position": [1.0, 0.0], "velocity": [0.0, 1.1]},
        "final_time": 1.0,
        "exact": "none",
    }
    config = {"name": "planet", "problem": problem, "method": method, "ladder": {"steps": [40]}}
    config |= {"store": {"diagnostics": ["energy-balance"]}} if is_stored else {}
    (outcome,) = fvi.run(config)
    if is_stored and method == "gauss3":
        assert outcome.plot("balance").axes
    else:
        needed = r"store: \{diagnostics: \[energy-balance\]\} and a method .* such as gauss3"
        with pytest.raises(fvi.RequestError, match=needed):
            outcome.plot("balance")
