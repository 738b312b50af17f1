"""What is seen of lines: of many points, of several that coincide, of peaks and zeros."""

import io
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.lines import Line2D
from spread import spread

from fvi_cli.plotting.curves import FEW_POINTS, MOST_POINTS, Curve, Panel
from fvi_cli.plotting.fits import residual_limits
from fvi_cli.plotting.looks import Look
from fvi_cli.plotting.panels import ladders, over_time, plane
from fvi_cli.plotting.save import save_figure
from fvi_cli.plotting.style import LINE_STYLES


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


@pytest.mark.few(1)
@pytest.mark.parametrize("kind", ["pdf", "svg", "png"])
def test_files_of_long_lines_are_bounded(kind, tmp_path):
    sizes = []
    for points in (MOST_POINTS, 5 * MOST_POINTS):
        panel = Panel(curves=[spiral(points / 40, points)], x="x", y="p")
        figure = plane([panel])
        assert figure.axes[0].lines[0].get_rasterized() == (points > MOST_POINTS)
        (path,) = save_figure(figure, tmp_path, f"n{points}", forms=[kind])
        sizes.append(path.stat().st_size)
    assert max(sizes) < 1_500_000


def ladder_of(curves: list[Curve]) -> tuple[Figure, dict[str, list[Line2D]]]:
    """A ladder of curves, and its lines by their names."""
    figure = ladders([Panel(curves=curves, y="error")])
    lines: dict[str, list[Line2D]] = {}
    for line in figure.axes[0].lines:
        lines.setdefault(line.get_label(), []).append(line)
    return figure, lines


def marks_of(lines: dict[str, list[Line2D]], name: str) -> list[Line2D]:
    """The marks of a curve of a ladder, which lie above all its lines."""
    found = lines.get(f"_mark of {name}", [])
    named = [one for label, own in lines.items() if label[0] != "_" for one in own]
    assert all(mark.get_zorder() > max(one.get_zorder() for one in named) for mark in found)
    return found


@spread(few=1, count=[2, 3, 5], points=[5, 8, 11])
def test_marks_that_lie_upon_each_other_take_turns(count, points):
    def marks(apart: float) -> list[list[int]]:
        x = np.geomspace(1e-3, 1.0, points)
        curves = [Curve(x=x, y=x**2 * apart**k, label=f"c{k}") for k in range(count)]
        _, lines = ladder_of(curves)
        # lines are as the legend has them, whatever lies upon them
        assert [lines[f"c{k}"][0].is_dashed() for k in range(count)] == [
            k > 0 for k in range(count)
        ]
        own = [
            np.concatenate([m.get_xdata() for m in marks_of(lines, f"c{k}")]) for k in range(count)
        ]
        return [sorted(np.searchsorted(x, at).tolist()) for at in own]

    shown = marks(1.0)
    # every point has one mark, every curve its share of them
    assert sorted(point for own in shown for point in own) == list(range(points))
    sizes = [len(own) for own in shown]
    assert max(sizes) - min(sizes) <= 1
    # the control: curves that are apart have all of theirs
    assert marks(100.0) == [list(range(points))] * count


@pytest.mark.few(2)
@pytest.mark.parametrize("count", [2, 4])
@pytest.mark.parametrize("until", [0, 2, 6, 9])
def test_where_lines_coincide_those_below_are_seen_and_it_is_said(count, until):
    x = np.geomspace(1e-3, 1.0, 9)
    # the first points are those of one line
    curves = [
        Curve(x=x, y=x**2 * np.where(np.arange(9) < until, 1.0, 30.0**k), label=f"c{k}")
        for k in range(count)
    ]
    figure, lines = ladder_of(curves)
    below = lines.get("_hidden", [])
    # as many lines of growing width as lie upon each
    assert len(below) == (count * (count - 1) // 2 if until else 0)
    for line in below:
        assert np.flatnonzero(np.isfinite(line.get_ydata())).tolist() == list(range(until))
        assert line.get_zorder() < min(lines[one.label][0].get_zorder() for one in curves)
    widest = sorted({line.get_linewidth() for line in below}, reverse=True)
    assert len(widest) == (count - 1 if until else 0)
    assert ("pale" in figure.legends[0].get_title().get_text()) == bool(until)


@pytest.mark.parametrize(("points", "is_pale"), [(0.9, True), (3.0, False)])
def test_lines_side_by_side_within_their_width_count_as_one(points, is_pale):
    x = np.geomspace(1e-3, 1.0, 6)
    decades = points / (72 * Panel(curves=[], y="").height) * 6.0
    curves = [Curve(x=x, y=x**2 * 10 ** (k * decades), label=f"c{k}") for k in range(2)]
    assert ("_hidden" in ladder_of(curves)[1]) == is_pale


@pytest.mark.few(2)
@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("at", [0, 3, 5])
def test_where_lines_only_meet_every_mark_is_drawn_the_smaller_upon_the_larger(count, at):
    x = np.geomspace(1e-3, 1.0, 6)
    curves = [
        Curve(x=x, y=x[at] ** 2 * (x / x[at]) ** (k + 1), label=f"c{k}") for k in range(count)
    ]
    _, lines = ladder_of(curves)
    found = [{mark.get_xdata()[0]: mark for mark in marks_of(lines, f"c{k}")} for k in range(count)]
    assert all(sorted(own) == x.tolist() for own in found)
    sizes = [own[x[at]].get_markersize() for own in found]
    assert [own[x[at]].get_zorder() for own in found] == sorted(
        own[x[at]].get_zorder() for own in found
    )
    assert all(below > 1.3 * above for below, above in pairwise(sizes))
    # the control: elsewhere all have one size
    assert len({own[x[at - 1]].get_markersize() for own in found}) == 1


@pytest.mark.few(2)
@pytest.mark.parametrize(("share", "count"), [(0.3, 1), (0.8, 2)])
@pytest.mark.parametrize("height", [1.0, 2.4])
def test_curves_are_one_where_less_than_half_a_line_is_between_them(share, count, height):
    t, width = np.linspace(0.0, 6.0, 50), 1.1  # points of a line
    apart = share * width * 2.0 / (72 * height)
    curves = [Curve(x=t, y=np.sin(t) + k * apart, label=f"BDF{k + 1}, degree 1") for k in range(2)]
    (axes,) = over_time([Panel(curves=curves, y="x", height=height)], x="t").axes
    assert len(axes.lines) == count


@pytest.mark.parametrize("depth", [3.0, 9.0])
def test_a_logarithmic_panel_holds_every_value_or_says_how_deep_they_go(depth):
    y = np.full(30, 1e-4)
    y[7] *= 10.0**-depth
    curves = [Curve(x=np.linspace(0.0, 1.0, 30), y=y)]
    (axes,) = over_time([Panel(curves=curves, y="error", is_log=True)], x="t").axes
    is_cut = axes.get_ylim()[0] > y.min()
    assert is_cut == (depth > 5.0)
    remark = axes.get_title(loc="right")
    assert (remark == r"deepest point: $10^{-13}$") if is_cut else not remark


@spread(count=[3, 4, 6], apart=[0.9, 1.3, 1.9])
def test_of_a_pile_at_a_pale_line_those_marks_are_drawn_that_hide_no_other(count, apart):
    x = np.geomspace(1e-3, 1.0, 7)
    decades = apart / (72 * Panel(curves=[], y="").height) * 6.0
    curves = [Curve(x=x, y=x**2 * 10 ** (k * decades), label=f"c{k}") for k in range(count)]
    figure, lines = ladder_of(curves)
    (axes,) = figure.axes
    marks = [mark for k in range(count) for mark in marks_of(lines, f"c{k}")]
    places = np.array([axes.transData.transform(mark.get_xydata())[0] for mark in marks])
    distance = np.hypot(*(places[:, None] - places).T) * 72 / figure.dpi
    assert distance[~np.eye(len(marks), dtype=bool)].min() > 2.9
    # every point has a mark, every curve one or more
    assert {*np.concatenate([mark.get_xdata() for mark in marks]).tolist()} == {*x.tolist()}
    assert len({mark.get_label() for mark in marks}) == count
    # the control: without the rule they would lie upon each other
    assert apart < 2.9 < len(marks)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_cross_lies_upon_what_would_hide_it(order):
    x = np.geomspace(1e-3, 1.0, 6)
    looks = [Look(colour="C0", marker=mark, is_filled=False) for mark in "xv"]
    curves = [Curve(x=x, y=x, label=f"c{k}", look=looks[k]) for k in order]
    _, lines = ladder_of(curves)
    cross, triangle = (lines[f"c{k}"][0].get_zorder() for k in range(2))
    assert cross > triangle


@pytest.mark.parametrize("same", [True, False])
@pytest.mark.parametrize("until", [4, 30])
def test_over_time_a_line_below_one_of_its_colour_is_pale(until, same):
    t = np.linspace(0.0, 3.0, 31)
    looks = [Look(colour="#0072B2", marker="o"), Look(colour="#D55E00", marker="s")]
    other = np.where(np.arange(31) <= until, np.sin(t), np.sin(t) + 1.0)
    curves = [
        Curve(x=t, y=np.sin(t), label="one", look=looks[0]),
        Curve(x=t, y=other + 0.02, label="other", look=looks[0 if same else 1]),
    ]
    figure = over_time([Panel(curves=curves, y="x", height=1.0)], x="t")
    pale = [line for line in figure.axes[0].lines if line.get_label() == "_hidden"]
    assert len(pale) == same
    assert "pale" in figure.legends[0].get_title().get_text() or not same
    for line in pale:
        assert np.flatnonzero(np.isfinite(line.get_ydata())).tolist() == list(range(until + 1))


def inked(figure: Figure, colour: str) -> float:
    """How much of a picture has a colour."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=300)
    buffer.seek(0)
    return float((np.abs(imread(buffer)[:, :, :3] - to_rgb(colour)) < 0.02).all(axis=2).sum())


@pytest.mark.few(2)
@pytest.mark.parametrize("end", [0.0, 1.0])
@pytest.mark.parametrize("from_zero", [True, False])
def test_marks_at_the_sides_of_a_panel_are_whole(end, from_zero):
    def area(x: float, y: float) -> float:
        look = Look(colour="#ff00ff", marker="D", size=12.0, has_line=False)
        frame = Curve(x=np.array([0.0, 1.0]), y=np.array([0.0, 1.0]), look=Look(colour="black"))
        curves = [frame, Curve(x=np.array([x]), y=np.array([y]), label="_dot", look=look)]
        return inked(
            over_time([Panel(curves=curves, y="x")], x="t", from_zero=from_zero), "#ff00ff"
        )

    inside = area(0.7, 0.4)
    assert area(end, 0.4) == pytest.approx(inside, rel=0.03)
    if from_zero:
        assert area(0.7, 0.0) == pytest.approx(inside, rel=0.03)
    assert inside > 1000


@pytest.mark.few(4)
@pytest.mark.parametrize("dashes", LINE_STYLES[1:])
@pytest.mark.parametrize("width", [0.7, 1.1])
@pytest.mark.parametrize("count", [2, 8])
def test_the_key_of_a_dashed_line_shows_all_of_its_parts_beside_the_mark(dashes, width, count):
    looks = [Look(colour="C0", marker="o", dashes=dashes, width=width)] * count
    x = np.geomspace(1e-3, 1.0, 6)
    curves = [
        Curve(x=x, y=9.0**k * x, label=f"method {k}", look=one) for k, one in enumerate(looks)
    ]
    figure, _ = ladder_of(curves)
    line = figure.legends[0].get_lines()[0]
    offset, own = line._unscaled_dash_pattern
    half = 0.5 * np.ptp(line.get_xdata()) / line.get_linewidth()
    edges = np.cumsum([0.0, *own])
    # the middle of the first dash is in the middle of the key, and the others are beside it
    assert (offset + half) % edges[-1] == pytest.approx(own[0] / 2, abs=1e-6)
    assert half > edges[-1] - own[0] / 2
    assert np.array(own) / own[0] == pytest.approx(np.array(dashes[1]) / dashes[1][0])


@pytest.mark.few(1)
@pytest.mark.parametrize("hollow", [{0}, {1}, {0, 2}])
def test_hollow_marks_lie_upon_full_ones_which_are_seen_round_them(hollow):
    x = np.geomspace(1e-3, 1.0, 6)
    looks = [Look(colour=f"C{k}", marker="o", is_filled=k not in hollow) for k in range(3)]
    _, lines = ladder_of([Curve(x=x, y=x, label=f"c{k}", look=one) for k, one in enumerate(looks)])
    heights = [lines[f"c{k}"][0].get_zorder() for k in range(3)]
    assert {*np.argsort(heights)[-len(hollow) :].tolist()} == hollow
    # of one kind the later lie upon the earlier; what is full is seen through what is hollow
    faces = {mark.get_markerfacecolor() for k in hollow for mark in marks_of(lines, f"c{k}")}
    assert faces <= {"none", "white"}
    full = [height for k, height in enumerate(heights) if k not in hollow]
    assert full == sorted(full)


@pytest.mark.few(1)
@pytest.mark.parametrize("count", [1, 2, 5])
def test_marks_of_peaks_differ_in_form_and_the_key_has_them(count):
    t = np.linspace(0.0, 1.0, 50)
    curves = [
        Curve(x=t, y=-(9.0**k) * (t - 0.5) ** 2, label=f"c{k}", peaks=[(0.5, 0.0)])
        for k in range(count)
    ]
    figure = over_time([Panel(curves=curves, y="x")], x="t")
    peaks = [line for line in figure.axes[0].lines if line.get_linestyle() == "None"]
    forms = [line.get_marker() for line in peaks]
    assert len(set(forms)) == count
    assert len({line.get_markersize() for line in peaks}) == 1
    *key, last = figure.legends[0].get_lines()
    if count > 1:
        assert [line.get_marker() for line in key] == forms
        assert last.get_label() == "marks: peaks"
    else:
        assert last.get_label() == "peak"
        assert last.get_marker() == forms[0]


@settings(deadline=None, max_examples=8)
@given(st.integers(-3, 3), st.floats(0.0, 0.1))
def test_an_axis_reaches_the_number_that_it_just_misses(power, missed):
    size = 10.0**power
    x = np.linspace(0.0, (8.0 - 8.0 * missed) * size, 30)
    (axes,) = over_time([Panel(curves=[Curve(x=x, y=x)], y="x")], x="t").axes
    end = axes.get_xlim()[1]
    if missed < 0.02:
        assert end == pytest.approx(8.0 * size, rel=2e-3)
    if missed > 0.05:  # the control
        assert end < 7.95 * size


@settings(deadline=None, max_examples=30)
@given(st.floats(-6.0, 6.0), st.floats(1.0, 300.0))
def test_residuals_of_a_bad_fit_do_not_press_the_others_flat(power, factor):
    size, t = 10.0**power, np.linspace(0.0, 1.0, 40)
    good, bad = (
        Curve(x=t, y=much * size * np.cos(9 * t), label=f"_{name}")
        for name, much in (("good", 1.0), ("bad", -factor))
    )
    (low, high), remark = residual_limits([bad, good], "N")
    assert low <= good.y.min()
    assert high >= good.y.max()
    assert high - low <= 30.001 * np.ptp(good.y)
    is_whole = low <= bad.y.min() and high >= bad.y.max()
    assert ("bad" in remark and " N)" in remark) != is_whole
    assert is_whole == (factor <= 15.0) or abs(factor - 15.0) < 1e-6


@pytest.mark.few(1)
@pytest.mark.parametrize("zero", [0, 5, None])
def test_gaps_of_a_logarithmic_curve_are_explained(zero):
    t = np.linspace(0.0, 1.0, 9)
    y = np.where(np.arange(9) == zero, 0.0, 1e-4 + t)
    (axes,) = over_time([Panel(curves=[Curve(x=t, y=y)], y="error", is_log=True)], x="t").axes
    assert axes.get_title(loc="right") == ("gaps: exactly 0" if zero else "")


@pytest.mark.parametrize(("order", "words"), [(1.0, "1"), (1.5, "3/2"), (3.0, "3")])
@pytest.mark.parametrize("more", [0.0, 300.0])
def test_a_triangle_beside_a_curve_that_falls_faster_is_one_in_the_limit(order, words, more):
    x = np.geomspace(1e-3, 1e-1, 8)
    curve = Curve(x=x, y=x**order * (1.0 + more * x), label="c", order=order)
    figure, _ = ladder_of([curve])
    figure.draw_without_rendering()
    labels = [str(line.get_label()) for line in figure.axes[0].lines]
    (label,) = [one for one in labels if one.endswith(f"order {words}")]
    assert label == f"_{'limit ' if more else ''}order {words}"
