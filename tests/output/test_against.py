"""Figures against a swept key: extents of quantities, places at events, designs as curves."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.plotting import left_out

TEXT = """\
name: swept
problem:
  kind: duffing
  damping: [{order: 0.7, coefficient: 0.3}]
  parameters: {a: 0.4}
  forcing: a*cos(1.3*t)
  initial: {position: 0.1}
  final_time: 15.0
  exact: none
sweep:
  problem.stiffness: [3.0, 1.0, 2.0]
MORE
method: gauss2
ladder: {steps: [75, 150]}
quantities: {angle: x}
events: {turn: {when: vx, direction: falling}}
figures:
  - {plot: peak_angle, against: problem.stiffness}
  - {plot: rms_angle, against: problem.stiffness}
  - {plot: turn, against: problem.stiffness, after: 6.25}
  - {section: turn, after: 6.25}
"""
AGAINST = "against-stiffness"


def drawn(tmp_path, more=""):
    (tmp_path / "swept.yaml").write_text(TEXT.replace("MORE\n", more))
    (outcome,) = fvi.run(tmp_path / "swept.yaml")
    return outcome, fvi.figures([outcome])


def finest(outcome):
    return [one for one in outcome.finished if one.run.n_steps == 150]


def curves(figure):
    """Points of all lines of the first panel, with their names."""
    return [(str(line.get_label()), *line.get_data()) for line in figure.axes[0].lines]


def test_extents_stand_against_the_swept_key_in_its_order(tmp_path):
    outcome, figures = drawn(tmp_path)
    for which in ("peak", "rms"):
        ((_, x, y),) = curves(figures[f"swept-{which}-angle-{AGAINST}"])
        assert list(x) == [1.0, 2.0, 3.0]
        expected = {
            one.run.member.values["problem.stiffness"]: getattr(
                one.trajectory.observed.extents["angle"], which
            )
            for one in finest(outcome)
        }
        assert list(y) == [expected[value] for value in x]
        # the control: by the coarser grid they are others
        coarse = next(one for one in outcome.finished if one.run.n_steps == 75)
        assert getattr(coarse.trajectory.observed.extents["angle"], which) not in y


def test_events_are_dots_and_what_is_before_the_time_is_left_out(tmp_path):
    outcome, figures = drawn(tmp_path)
    ((_, x, y),) = curves(figures[f"swept-turn-{AGAINST}"])
    found = set()
    dropped = 0
    for one in finest(outcome):
        turn = one.trajectory.observed.events["turn"]
        late = turn.time >= 6.25
        dropped += np.count_nonzero(~late)
        value = one.run.member.values["problem.stiffness"]
        found |= {(value, position) for position in turn.position[late, 0]}
    assert dropped > 3
    assert set(zip(x, y, strict=True)) == found
    section = figures["swept-section-turn"]
    marks = sum(line.get_xdata().size for line in section.axes[0].lines)
    assert marks == len(found)


def test_a_second_key_makes_curves_and_a_third_one_colours(tmp_path):
    more = "  problem.damping.0.order: [0.4, 0.9]\n"
    _, figures = drawn(tmp_path, more)
    found = curves(figures[f"swept-peak-angle-{AGAINST}"])
    assert [(name, x.size) for name, x, _ in found] == [("0.4", 3), ("0.9", 3)]
    more += "  problem.cubic_stiffness: [0.5, 1.0]\n"
    _, figures = drawn(tmp_path, more)
    figure = figures[f"swept-peak-angle-{AGAINST}"]
    found = curves(figure)
    assert sorted(name for name, _, _ in found) == ["0.4", "0.4", "0.9", "0.9"]
    words = [axes.get_xlabel() + axes.get_title() for axes in figure.axes]
    assert any("cubic stiffness" in one for one in words)
    assert len({line.get_color() for line in figure.axes[0].lines}) == 2


def test_designs_are_curves_with_their_names(tmp_path):
    more = "designs: {free: {}, driven: {problem.parameters.a: 0.8}}\n"
    outcome, figures = drawn(tmp_path, more)
    found = {name: y for name, _, y in curves(figures[f"swept-peak-angle-{AGAINST}"])}
    assert list(found) == ["free", "driven"]
    for name, peaks in found.items():
        own = {
            one.run.member.values["problem.stiffness"]: one.trajectory.observed.extents["angle"]
            for one in finest(outcome)
            if one.run.member.name == name
        }
        assert list(peaks) == [own[value].peak for value in (1.0, 2.0, 3.0)]
    assert np.all(found["driven"] > found["free"])


def test_a_figure_without_events_is_said(tmp_path):
    text = TEXT.replace("MORE\n", "").replace("after: 6.25", "after: 14.99")
    (tmp_path / "swept.yaml").write_text(text)
    (outcome,) = fvi.run(tmp_path / "swept.yaml")
    said = left_out([(outcome.experiment, outcome.finished)])
    assert [line for line in said if "did not happen after t = 14.99" in line] == said[:2]
    assert f"swept-turn-{AGAINST}" not in fvi.figures([outcome])


@pytest.fixture(autouse=True)
def _closed():
    yield
    plt.close("all")
