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

import fvi_cli as fvi
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.region import StabilityMap
from fvi_cli.plotting.regions import region_figure
from fvi_cli.plotting.stability import stability_figures
from fvi_cli.studies.stability_study import StabilityTable

MANY = (
    "[{bdf: [5, 6], sampling: nodes, degree: 1}, "
    "{bdf: [5, 6], sampling: points, degree: [1, 3], start: none}]"
)


@functools.cache
def growth(method: str = MANY) -> tuple[StabilityTable, Axes]:
    """A study of an equation on which some methods grow, and its panel; not to be changed."""
    text = configuration(
        "kind: bagley-torvik, damping: [{order: 1.5, coefficient: 1.0}], final_time: 1.0",
        method=method,
        steps="2, 4",
    )
    (table,) = fvi.stability(yaml.safe_load(text))
    (figure,) = stability_figures("one", [table]).values()
    return table, figure.axes[1]


def test_growth_is_drawn_where_a_mode_grows():
    table, axes = growth()
    rows = [row for row in table.rows if row.prediction.growth_per_step > 0]
    assert 0 < len(rows) < len(table.rows)
    wanted = {(row.run.step_size, row.prediction.growth_per_step) for row in rows}
    assert {tuple(point) for line in axes.lines for point in line.get_xydata()} == wanted


def test_figures_of_one_table_have_the_name_of_the_study_and_others_their_own():
    table, _ = growth()
    names = ["several", "tables"]
    renamed = [
        dataclasses.replace(table, experiment=dataclasses.replace(table.experiment, name=name))
        for name in names
    ]
    assert list(stability_figures("study", renamed[:1])) == ["study-stability"]
    assert list(stability_figures("study", renamed)) == [f"{name}-stability" for name in names]


def test_lines_of_growth_are_told_apart_and_none_is_near_black():
    _, axes = growth()
    colours = [np.array(to_rgb(line.get_color())) for line in axes.lines]
    assert len(colours) == 4
    assert min(colour.max() for colour in colours) > 0.4
    apart = [np.abs(a - b).max() for k, a in enumerate(colours) for b in colours[:k]]
    assert min(apart) > 0.1


def has_colour(level: np.ndarray, colour: str) -> bool:
    """Whether the picture of a plane has a colour inside of its panel."""
    axis = np.logspace(-3, 3, level.shape[0])
    # three in a row, as narrow as such panels are
    maps = [
        StabilityMap(
            method=Method(cq="gauss", degree=stages, start="graded"),
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
