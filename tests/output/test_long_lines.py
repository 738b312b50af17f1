"""Lines of many points: all of their form is drawn, in files of bounded size."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fvi_cli.plotting.curves import FEW_POINTS, MOST_POINTS, Curve, Panel
from fvi_cli.plotting.drawn import save_figure
from fvi_cli.plotting.panels import plane


def spiral(periods: float, points: int) -> Curve:
    """An orbit that shrinks, with so many points."""
    t = np.linspace(0.0, periods, points)
    size = np.exp(-t / periods)
    return Curve(x=size * np.cos(2 * np.pi * t), y=size * np.sin(2 * np.pi * t))


def distance(curve: Curve) -> float:
    """How far the points of a curve lie from the line that is drawn of it."""
    every = curve.stride()
    kept = np.arange(0, curve.x.size, every)
    inside = np.arange(kept[-1] + 1)
    line = [np.interp(inside, kept, values[kept]) for values in (curve.x, curve.y)]
    return float(np.hypot(line[0] - curve.x[inside], line[1] - curve.y[inside]).max())


@settings(deadline=None, max_examples=30)
@given(st.floats(0.5, 5000.0), st.integers(3, 60_000))
def test_no_point_lies_visibly_beside_the_line(periods, points):
    curve = spiral(periods, points)
    assert distance(curve) < 0.01
    assert curve.stride() <= max(1, points // FEW_POINTS)


def test_even_thinning_alone_would_draw_polygons():
    curve = spiral(2000.0, 120_000)
    coarse = Curve(x=curve.x[::59], y=curve.y[::59])
    # about one point a period
    assert np.hypot(np.diff(coarse.x), np.diff(coarse.y)).max() > 0.1
    assert curve.stride() == 1
    smooth = Curve(x=curve.x[:600], y=np.linspace(0, 1, 600) ** 2)
    assert smooth.stride() == 1
    assert Curve(x=np.linspace(0, 1, 120_000), y=np.linspace(0, 1, 120_000) ** 2).stride() == 59


def test_gaps_stay_gaps_and_what_is_constant_is_thinned():
    t = np.linspace(0.0, 3.0, 90_000)
    gap = np.where((t > 1) & (t < 2), np.nan, np.sin(t))
    assert 1 < Curve(x=t, y=gap).stride() <= 90_000 // FEW_POINTS
    assert Curve(x=t, y=np.full(t.size, np.nan)).stride() == 90_000 // FEW_POINTS


@pytest.mark.parametrize("kind", ["pdf", "svg", "png"])
def test_files_of_long_lines_are_bounded(kind, tmp_path):
    sizes = []
    for points in (MOST_POINTS, 20 * MOST_POINTS):
        panel = Panel(curves=[spiral(points / 40, points)], x="x", y="p")
        figure = plane([panel])
        assert figure.axes[0].lines[0].get_rasterized() == (points > MOST_POINTS)
        (path,) = save_figure(figure, tmp_path, f"n{points}", forms=[kind])
        sizes.append(path.stat().st_size)
    assert max(sizes) < 1_500_000
