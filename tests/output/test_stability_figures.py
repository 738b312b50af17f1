"""What figures of stability show of growth, and of narrow bands in the plane."""

import dataclasses
import functools
import io
import random

import numpy as np
import pytest
import yaml
from command_line import configuration
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from matplotlib.lines import Line2D

import fvi_cli as fvi
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.region import StabilityMap
from fvi_cli.plotting.regions import region_figure
from fvi_cli.plotting.stability import stability_figures, step_figure
from fvi_cli.studies import stability_study
from fvi_cli.studies.stability_study import StabilityTable

MANY = (
    "[{bdf: [5, 6], sampling: nodes, degree: 1}, "
    "{bdf: [5, 6], sampling: points, degree: [1, 3], start: none}]"
)


@functools.cache
def observed(method: str) -> StabilityTable:
    """A study of an equation on which some methods grow, without the largest stable steps."""
    text = configuration(
        "kind: bagley-torvik, damping: [{order: 1.5, coefficient: 1.0}], final_time: 1.0",
        method=method,
        steps="2, 4",
        more="allow_unstable: true\n",
    )
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(stability_study, "largest_stable_step", lambda *_, **__: None)
        (table,) = fvi.stability(yaml.safe_load(text))
    return table


@functools.cache
def growth(*, observe: bool, method: str = MANY) -> tuple[StabilityTable, Axes]:
    """That study with or without what was observed, and its panel; not to be changed."""
    table = observed(method)
    if not observe:
        rows = tuple(dataclasses.replace(row, observation=None) for row in table.rows)
        table = dataclasses.replace(table, rows=rows)
    (figure,) = stability_figures("one", [table]).values()
    return table, figure.axes[1]


def named(axes: Axes) -> list[Line2D]:
    return [line for line in axes.lines if not line.get_label().startswith("_")]


@pytest.mark.parametrize("observe", [True, False])
def test_growth_is_predicted_by_lines_and_measured_by_marks(observe):
    table, axes = growth(observe=observe)
    rows = [row for row in table.rows if row.prediction.growth_per_step > 0]
    assert 0 < len(rows) < len(table.rows)
    lines = named(axes)
    assert all(line.get_marker() == "" for line in lines)
    # a line goes through the predictions of its method, and bends between them as well
    for row in rows:
        place = np.array([row.run.step_size, row.prediction.growth_per_step])
        near = [np.abs(line.get_xydata() / place - 1.0).max(axis=1).min() for line in lines]
        assert min(near) < 1e-6
    assert all(line.get_xdata().size > 2 * len(table.experiment.steps) for line in lines)
    # marks of measurements, of predictions only where there is none
    seen = [line.get_xydata() for line in axes.lines if line.get_label() == "_seen"]
    wanted = {
        (row.run.step_size, (row.observation if observe else row.prediction).growth_per_step)
        for row in rows
    }
    assert {tuple(point) for points in seen for point in points} == wanted


@pytest.mark.few(2)
@pytest.mark.parametrize("observe", [True, False])
@pytest.mark.parametrize("steps", [{2}, {4}, {2, 4}])
def test_growth_begins_at_the_last_step_without(steps, observe):
    table, _ = growth(observe=observe)
    limits = {row.run.method.case: 0.1 * row.run.step_size for row in table.rows}
    rows = [
        dataclasses.replace(row, lasting_step=limits[row.run.method.case])
        for row in table.rows
        if row.run.n_steps in steps
    ]
    axes = step_figure(dataclasses.replace(table, rows=tuple(rows))).axes[1]
    growing = {row.run.method.case for row in rows if row.prediction.growth_per_step > 0}
    begins = [line.get_xydata()[0] for line in named(axes)]
    assert {x for x, _ in begins} == {limits[case] for case in growing}
    for line in named(axes):
        assert line.get_ydata()[0] == axes.get_ylim()[0] < line.get_ydata()[1:].min()
        assert (np.diff(line.get_xdata()) > 0).all()
    # the control: what does not grow has no line
    assert len(begins) == len(growing) < len(limits)


def test_figures_of_one_table_have_the_name_of_the_study_and_others_their_own():
    table, _ = growth(observe=False)
    names = ["several", "tables"]
    renamed = [
        dataclasses.replace(table, experiment=dataclasses.replace(table.experiment, name=name))
        for name in names
    ]
    assert list(stability_figures("study", renamed[:1])) == ["study-stability"]
    assert list(stability_figures("study", renamed)) == [f"{name}-stability" for name in names]


def test_lines_of_growth_are_told_apart_and_none_is_near_black():
    _, axes = growth(observe=False)
    colours = [np.array(to_rgb(line.get_color())) for line in named(axes)]
    assert len(colours) == 4
    assert min(colour.max() for colour in colours) > 0.4
    apart = [np.abs(a - b).max() for k, a in enumerate(colours) for b in colours[:k]]
    assert min(apart) > 0.1


def test_a_mark_below_a_hollow_one_is_seen():
    _, axes = growth(observe=True, method="{bdf: 6, sampling: nodes, degree: [1, 2]}")
    marks = [line for line in axes.lines if line.get_label() == "_seen"]
    hollow = [line for line in marks if line.get_markerfacecolor() == "none"]
    full = [line for line in marks if line not in hollow]
    assert hollow
    assert full
    assert min(line.get_zorder() for line in hollow) > max(line.get_zorder() for line in full)


def has_colour(level: np.ndarray, colour: str) -> bool:
    """Whether the picture of a plane has a colour inside of its panel."""
    axis = np.logspace(-3, 3, level.shape[0])
    # three in a row, as narrow as such panels are
    maps = [
        StabilityMap(
            method=Method(cq="gauss", degree=stages),
            order=0.5,
            stiffness=axis,
            damping=axis,
            level=level,
        )
        for stages in (1, 2, 3)
    ]
    figure, buffer = region_figure(maps), io.BytesIO()
    figure.savefig(buffer, format="png", dpi=2 * figure.dpi)
    buffer.seek(0)
    image = imread(buffer)[::-1, :, :3]
    (left, low), (right, high) = 2 * figure.axes[0].get_window_extent().get_points()
    panel = image[round(low) : round(high), round(left) : round(right)]
    return bool((np.abs(panel - to_rgb(colour)) < 1e-3).all(axis=2).any())


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(4))
def test_a_band_of_one_column_has_its_own_colour_in_the_picture(seed):
    grows = "#E3E3E3"
    level = np.zeros((121, 121), dtype=int)
    assert not has_colour(level, grows)
    draw = random.Random(seed)
    start = draw.randrange(10, 110)
    band = (slice(draw.randrange(40, 80)), slice(start, start + 1))
    level[band if seed % 2 else band[::-1]] = 2
    assert has_colour(level, grows)
