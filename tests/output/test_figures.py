"""Figures are judged by what they draw: every series, every failure, the right slopes."""

import dataclasses
import functools
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from itertools import combinations

import matplotlib as mpl
import numpy as np
import pytest
from command_line import fvi
from letters import spring
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fvi_cli import plotting
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.method_names import method_names
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.plotting.looks import method_labels, method_looks
from fvi_cli.render.figures import compare_figures, write_figures
from fvi_cli.scenes.problem import AnyProblem, DerivativeProblem, Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run

NODES = tuple(Method(cq=f"bdf{p}", degree=1, sampling="nodes") for p in (1, 2, 3))
LADDER = tuple(2**k for k in range(3, 9))
ORDERS = {"bdf1": 1.0, "bdf2": 2.0, "bdf3": 2.0}


def oscillator(exact: bool = True) -> Problem:
    """x'' + x = 0, x(0) = 0, x'(0) = 1, with a damping of coefficient zero for the title."""
    scene = spring((1.5, np.zeros((1, 1))), T=8.0, v=1.0)
    return Problem(
        kind="bagley-torvik", scene=scene, exact=(lambda t: np.sin(t)[:, None]) if exact else None
    )


def experiment(
    *,
    methods: Sequence[AnyMethod] = NODES,
    steps: Sequence[int] = LADDER,
    problem: AnyProblem | None = None,
    name: str = "made-up",
    figures: tuple[str, ...] = (),
) -> Experiment:
    return Experiment(
        name=name,
        problem=problem or oscillator(),
        problem_specification={},
        methods=tuple(methods),
        steps=tuple(steps),
        figures=figures,
    )


def power_law(run: Run) -> float:
    order = ORDERS.get(getattr(run.method, "cq", ""), 1.0)
    return 0.1 / (1 + list(ORDERS).index(getattr(run.method, "cq", "bdf1"))) * run.step_size**order


def finish(
    one: Experiment,
    error: Callable[[Run], float] = power_law,
    status: Callable[[Run], str] = lambda run: "ok",
) -> list[FinishedRun]:
    """Runs whose trajectory is the exact solution plus the error at every point but the first."""
    finished = []
    for run in one.runs():
        time = run.step_size * np.arange(run.n_steps + 1)
        offset = np.where(time > 0, error(run), 0.0)[:, None]
        finished.append(
            FinishedRun(
                run=run,
                trajectory=Trajectory(
                    time=time,
                    position=np.sin(time)[:, None] + offset,
                    momentum=np.cos(time)[:, None],
                    energy=0.5 + offset[:, 0],
                    n_steps=run.n_steps,
                    step_size=run.step_size,
                ),
                error=error(run),
                floor=1e-13,
                status=status(run),
                expected_order=ORDERS.get(getattr(run.method, "cq", ""), float("nan")),
            )
        )
    return finished


@functools.cache
def usual() -> Figure:
    """Errors of three methods that fall with their orders; not to be changed."""
    one = experiment()
    return plotting.convergence_figure([(one, finish(one))])


@functools.cache
def usual_alone() -> Figure:
    """The same of the first of them."""
    one = experiment(methods=NODES[:1])
    return plotting.convergence_figure([(one, finish(one))])


def small(factor: float = 1.0) -> Figure:
    """Soon drawn."""
    figure = Figure(figsize=(2.0, 1.5))
    figure.add_subplot().plot([1.0, 2.0], [factor, 3.0 * factor], label="a")
    return figure


def lines(figure: Figure, *beginnings: str) -> list[Line2D]:
    """Lines whose label begins so; without a beginning those that a legend names."""
    found = [line for axes in figure.axes for line in axes.lines]
    named = [line for line in found if not str(line.get_label()).startswith("_")]
    return (
        [one for one in found if str(one.get_label()).startswith(beginnings)]
        if beginnings
        else named
    )


def guides(figure: Figure) -> list[Line2D]:
    return lines(figure, "_order", "_stated")


def failures(figure: Figure) -> list[Line2D]:
    return [line for line in lines(figure, "_") if ": " in str(line.get_label())]


def words(figure: Figure) -> list[str]:
    return [text.get_text() for axes in figure.axes for text in axes.texts]


def slope(line: Line2D) -> float:
    x, y = np.log(line.get_xdata()), np.log(line.get_ydata())
    return float((y[1] - y[0]) / (x[1] - x[0]))


@pytest.mark.processes
def test_figures_do_without_pyplot_and_leave_the_settings_alone(tmp_path):
    script = """
import sys
import matplotlib
def settings():  # asking for the backend would choose one, with pyplot
    return {key: matplotlib.rcParams[key] for key in matplotlib.rcParams if key != "backend"}
before = settings()
from fvi_cli.plotting import interpolation_figure, save_figure
from pathlib import Path
save_figure(interpolation_figure(), Path(sys.argv[1]), "sketch")
print("matplotlib.pyplot" in sys.modules, settings() == before)
"""
    answer = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, check=True
    )
    assert answer.stdout.split() == ["False", "True"]


def test_a_users_own_settings_do_not_change_a_figure(tmp_path):
    paths = plotting.save_figure(
        plotting.interpolation_figure(), tmp_path / "plain", "sketch", ("svg",)
    )
    with mpl.rc_context({"axes.grid": True, "lines.linewidth": 5.0, "font.size": 20.0}):
        figure = plotting.interpolation_figure()
        other = plotting.save_figure(figure, tmp_path / "own", "sketch", ("svg",))
    assert [path.read_bytes() for path in paths] == [path.read_bytes() for path in other]


def test_convergence_draws_every_error_of_every_method():
    one = experiment()
    finished = finish(one)
    figure = plotting.convergence_figure([(one, finished)])
    drawn = {line.get_label(): line for line in lines(figure)}
    assert set(drawn) == {"BDF1", "BDF2", "BDF3"}
    for method, label in zip(NODES, ("BDF1", "BDF2", "BDF3"), strict=True):
        wanted = sorted((f.run.step_size, f.error) for f in finished if f.run.method == method)
        got = list(zip(drawn[label].get_xdata(), drawn[label].get_ydata(), strict=True))
        assert got == wanted
    assert figure.axes[0].get_xlabel() == "step size $h$"
    assert "max" in figure.axes[0].get_ylabel()
    assert figure.axes[0].get_title() == r"Bagley–Torvik, $\gamma = 3/2$"
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["BDF1", "BDF2", "BDF3"]
    wanted = "degree 1, 1 Gauss point, damping sampled at the nodes"
    assert legend.get_title().get_text() == wanted


def test_axes_of_graded_meshes_say_which_step_size_they_show():
    made = dataclasses.replace(experiment(), grading=2.0, norm="l2")
    axes = plotting.convergence_figure([(made, finish(made))]).axes[0]
    assert axes.get_xlabel() == "mean step size $h = T/N$"
    assert "h_k" in axes.get_ylabel()


@pytest.mark.parametrize("studies", [[], [(experiment(), [])]])
@pytest.mark.parametrize("draw", [plotting.convergence_figure, plotting.saturation_figure])
def test_without_runs_there_is_nothing_to_draw(draw, studies):
    with pytest.raises(ValueError):
        draw(studies)


def test_a_panel_has_its_height_beside_a_legend():
    figure = usual()
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert axes.get_position().height * figure.get_figheight() > 1.5


def test_reference_slopes_have_the_slope_that_their_label_says():
    figure = usual()
    found = {line.get_label(): slope(line) for line in guides(figure)}
    assert set(found) == {"_order 1", "_order 2"}
    assert found["_order 1"] == pytest.approx(1, abs=1e-9)
    assert found["_order 2"] == pytest.approx(2, abs=1e-9)
    assert {"order 1", "order 2"} <= set(words(figure))


def test_slopes_that_the_source_states_are_dashed():
    one = dataclasses.replace(experiment(), claims={"bdf2": 1.8, "bdf3": 2.0})
    figure = plotting.convergence_figure([(one, finish(one))])
    found = {line.get_label(): line for line in guides(figure)}
    # 2 is expected anyhow
    assert set(found) == {"_order 1", "_order 2", "_stated 1.8"}
    assert slope(found["_stated 1.8"]) == pytest.approx(1.8)
    dashes = {label: line.is_dashed() for label, line in found.items()}
    assert dashes == {"_order 1": False, "_order 2": False, "_stated 1.8": True}


def test_many_methods_of_one_experiment_have_a_panel_for_every_variant():
    methods = [
        Method(cq=f"bdf{p}", degree=d, sampling="nodes") for p in (1, 2, 3, 4) for d in (1, 2)
    ]
    one = experiment(methods=methods)
    figure = plotting.convergence_figure([(one, finish(one, error=lambda run: run.step_size))])
    title = r"Bagley–Torvik, $\gamma = 3/2$"
    assert [axes.get_title() for axes in figure.axes] == [f"{title}, degree {d}" for d in (1, 2)]
    for axes in figure.axes:
        drawn = [line for line in axes.lines if not str(line.get_label()).startswith("_")]
        assert [line.get_label() for line in drawn] == ["BDF1", "BDF2", "BDF3", "BDF4"]
    assert len(lines(figure)) == len(methods)
    few = experiment(methods=methods[:6])
    assert len(plotting.convergence_figure([(few, finish(few))]).axes) == 1


def test_observed_slopes_stand_in_where_theory_says_nothing():
    one = experiment(methods=[Baseline(name="explicit-euler"), Baseline(name="implicit-euler")])
    figure = plotting.convergence_figure([(one, finish(one))])
    assert [slope(line) for line in guides(figure)] == pytest.approx([1.0])


def test_a_slope_triangle_stands_beside_the_curve_that_is_expected_to_have_it():
    # observed slopes 1 and 1.2, expected 1 and 2: the second triangle belongs to the second curve
    one = experiment(methods=NODES[:2])
    level = {NODES[0].case: (1.0, 1.0), NODES[1].case: (1e-4, 1.2)}

    def error(run: Run) -> float:
        scale, order = level[run.method.case]
        return scale * run.step_size**order

    figure = plotting.convergence_figure([(one, finish(one, error=error))])
    heights = {line.get_label(): np.mean(np.log(line.get_ydata())) for line in guides(figure)}
    curves = [np.mean(np.log(line.get_ydata())) for line in lines(figure)]
    for label, own, other in (("_order 1", 0, 1), ("_order 2", 1, 0)):
        assert abs(heights[label] - curves[own]) < abs(heights[label] - curves[other])


def fallen_back(coarse: Sequence[int]) -> Figure:
    """BDF2 whose rows with `coarse` step counts are expected to have another order."""
    one = experiment(methods=NODES[1:2])
    finished = [
        dataclasses.replace(item, expected_order=3.3 if item.run.n_steps in coarse else 2.0)
        for item in finish(one)
    ]
    return plotting.convergence_figure([(one, finished)])


def test_the_expected_order_is_that_of_the_smallest_steps():
    figure = fallen_back(LADDER[:3])
    (guide,) = guides(figure)
    assert guide.get_label() == "_order 2"
    # beside rows that have this order, not beside the coarse ones
    assert max(guide.get_xdata()) <= (8.0 / LADDER[3]) * (1 + 1e-9)
    # the other way round the fine rows decide
    (control,) = guides(fallen_back(LADDER[3:]))
    assert control.get_label() == "_order 33/10"


def test_rows_at_round_off_do_not_decide_on_the_expected_order():
    one = experiment(methods=NODES[1:2])
    finished = [
        dataclasses.replace(
            item, **({"error": 1e-14, "expected_order": 3.3} if item.run.n_steps > 100 else {})
        )
        for item in finish(one)
    ]
    figure = plotting.convergence_figure([(one, finished)])
    assert [line.get_label() for line in guides(figure)] == ["_order 2"]


def test_without_any_error_there_is_neither_a_triangle_nor_a_range():
    one = experiment()
    gone = finish(one, status=lambda run: "diverged")
    figure = plotting.convergence_figure([(one, gone)])
    figure.draw_without_rendering()
    assert not guides(figure)
    assert words(figure) == ["diverged"]
    assert len(figure.axes[0].get_yticks()) == 0
    control = usual()
    assert len(control.axes[0].get_yticks()) > 0


def test_slope_triangles_keep_clear_of_curves():
    figure = usual()
    axes = figure.axes[0]
    curves = [line.get_transform().transform(line.get_xydata()) for line in lines(figure)]
    for guide in guides(figure):
        ends = guide.get_transform().transform(guide.get_xydata())
        for curve in curves:
            along = np.linspace(*ends[:, 0], 50)
            inside = (along >= curve[0, 0]) & (along <= curve[-1, 0])
            gap = np.interp(along, *curve.T) - np.interp(along, *ends.T)
            assert np.abs(gap[inside]).min() > 3 * figure.dpi / 72
        low, high = axes.get_ylim()
        assert low < min(guide.get_ydata())
        assert max(guide.get_ydata()) < high


def test_diverged_runs_stand_hollow_at_the_top_under_their_word():
    one = experiment()

    def status(run: Run) -> str:
        return "diverged" if run.method.case.startswith("bdf3") and run.n_steps < 64 else "ok"

    finished = finish(one, status=status)
    figure = plotting.convergence_figure([(one, finished)])
    (marks,) = failures(figure)
    gone = {f.run.step_size for f in finished if f.status == "diverged"}
    assert set(marks.get_xdata()) == gone
    assert marks.get_markerfacecolor() == "none"
    assert min(marks.get_ydata()) > 0.8
    assert "diverged" in words(figure)
    kept = next(line for line in lines(figure) if line.get_label() == "BDF3")
    finite = np.isfinite(kept.get_ydata())
    assert set(np.asarray(kept.get_xdata())[~finite]) == gone
    # the strip lies above every curve
    top = figure.axes[0].transAxes.inverted()
    for line in lines(figure):
        inside = line.get_transform().transform(line.get_xydata()[np.isfinite(line.get_ydata())])
        assert top.transform(inside)[:, 1].max() < min(marks.get_ydata())
    # and so do the numbers of the axis
    panel = figure.axes[0]
    band = min(line.get_ydata()[0] for line in panel.lines if line.get_label() == "_edge")
    bottom, high = np.log(panel.get_ylim())
    ticks = [tick for tick in panel.get_yticks() if tick > 0]
    assert ticks
    assert (np.log(max(ticks)) - bottom) / (high - bottom) <= band
    control = usual()
    assert not failures(control)
    assert "diverged" not in words(control)


@pytest.mark.parametrize("word", ["failed", "refused"])
def test_other_failures_have_their_own_word(word):
    one = experiment(methods=NODES[:1])
    finished = finish(one, error=lambda run: float("nan"), status=lambda run: word)
    figure = plotting.convergence_figure([(one, finished)])
    assert word in words(figure)
    assert len(failures(figure)[0].get_xdata()) == len(LADDER)


def test_round_off_is_hatched_only_where_it_is_reached():
    one = experiment()
    reached = plotting.convergence_figure(
        [(one, finish(one, error=lambda run: max(run.step_size**14, 3e-14)))]
    )
    assert "round-off" in words(reached)
    assert any(patch.get_hatch() for patch in reached.axes[0].patches)
    control = usual()
    assert "round-off" not in words(control)
    assert not any(patch.get_hatch() for patch in control.axes[0].patches)


def test_methods_are_told_apart_in_colour_and_in_grey():
    methods: list[AnyMethod] = [
        *(Method(cq=f"bdf{p}", degree=1, sampling="nodes") for p in range(1, 7)),
        Method(cq="bdf2", degree=2, sampling="nodes"),
        Method(cq="bdf2", degree=2),
        Method(cq="bdf2", degree=2, start="weights"),
        Method(cq="gauss", degree=2),
        Method(cq="gauss", degree=3, start="graded"),
        Baseline(name="explicit-euler"),
    ]
    found = method_looks(methods)
    assert len({one.label for one in found.values()}) == len(found) == len(methods)
    looks = [one.look for one in found.values()]
    for a, b in combinations(looks, 2):
        assert (a.marker, a.is_filled, a.dashes) != (b.marker, b.is_filled, b.dashes)
        assert (a.colour, a.is_filled, a.dashes) != (b.colour, b.is_filled, b.dashes)
    for part in ("colour", "marker"):
        assert len({getattr(look, part) for look in looks[:6]}) == 6


def test_variants_of_one_quadrature_have_colours_of_their_own():
    four = [
        Method(cq="bdf3", degree=d, start=start) for d in (1, 2) for start in ("none", "weights")
    ]
    assert len({one.look.colour for one in method_looks(four).values()}) == 4
    # the control: beside another family a quadrature keeps its colour
    both = method_looks([*four, Method(cq="bdf2", degree=1)])
    assert both[four[0].case].look.colour == method_looks(four[:1])[four[0].case].look.colour


def test_a_method_looks_the_same_in_every_figure():
    families = [
        *(Method(cq=f"bdf{p}", degree=d) for p in range(1, 7) for d in (1, 2)),
        *(Method(cq=cq, degree=s) for cq in ("gauss", "radau-iia") for s in range(1, 5)),
        Baseline(name="explicit-euler"),
    ]
    together = {case: one.look for case, one in method_looks(families).items()}
    for method in families:
        (alone,) = method_looks([method]).values()
        assert alone.look == together[method.case]
    # the control: another quadrature looks otherwise
    assert len({(look.colour, look.is_filled) for look in together.values()}) == len(families)


def test_labels_say_no_more_than_is_needed():
    assert list(method_labels(NODES).values()) == ["BDF1", "BDF2", "BDF3"]
    mixed = [NODES[1], Method(cq="bdf2", degree=2), Method(cq="gauss", degree=3)]
    assert list(method_labels(mixed).values()) == ["BDF2 nodes", "BDF2 points", "Gauss3"]
    beside = [NODES[0], Baseline(name="explicit-euler")]
    assert list(method_labels(beside).values()) == ["BDF1", "explicit Euler"]
    corrected = Method(
        cq="bdf3", degree=2, sampling="nodes", start="weights", start_exponents=(2.5,)
    )
    plain = Method(cq="bdf3", degree=2, sampling="nodes")
    both = method_labels([corrected, plain])
    assert list(both.values()) == ["BDF3, weights $t^{5/2}$", "BDF3, plain"]
    # tables say the same, powers apart
    told = method_names([*mixed, *beside])
    assert {case: name.label for case, name in told.items()} == method_labels([*mixed, *beside])


def test_trajectory_energy_and_error_show_every_method_and_the_exact_solution():
    methods = [NODES[0], Baseline(name="explicit-euler"), Baseline(name="implicit-euler")]
    names = ["BDF1", "explicit Euler", "implicit Euler"]
    one = experiment(methods=methods, steps=[64])
    errors = {method.case: 0.2 * k for k, method in enumerate(methods, start=1)}
    finished = finish(one, error=lambda run: errors[run.method.case])
    made = plotting.figures_for([(one, finished)], name="made-up")
    assert set(made) == {"made-up-trajectory", "made-up-energy", "made-up-error"}
    for kind, symbol in (("trajectory", "x(t)"), ("energy", "H(x, p)"), ("error", "x_k - x(t_k)")):
        figure = made[f"made-up-{kind}"]
        (axes,) = figure.axes
        labels = [line.get_label() for line in axes.lines]
        assert labels == ([] if kind == "error" else ["exact"]) + names
        assert symbol in axes.get_ylabel()
        assert "$t$" in axes.get_xlabel()
        assert "0.125" in axes.get_xlabel()
    drawn = made["made-up-error"].axes[0].lines[0].get_ydata()
    assert np.isnan(drawn[0])
    np.testing.assert_allclose(drawn[1:], 0.2, rtol=1e-10)


def test_curves_that_the_eye_cannot_tell_apart_are_one():
    methods = [NODES[0], NODES[1], Baseline(name="explicit-euler")]
    one = experiment(methods=methods, steps=[64])
    sizes = {method.case: size for method, size in zip(methods, (1e-3, 2e-3, 0.2), strict=True)}
    figure = plotting.trajectory_figure(one, finish(one, error=lambda run: sizes[run.method.case]))
    assert [line.get_label() for line in figure.axes[0].lines] == [
        "exact",
        "BDF1 and BDF2",
        "explicit Euler",
    ]


def test_a_solution_that_runs_away_does_not_press_the_others_flat():
    one = experiment(methods=NODES[:2], steps=[64])
    finished = finish(one, error=lambda run: 1e6 if run.method == NODES[1] else 1e-3)
    low, high = plotting.trajectory_figure(one, finished).axes[0].get_ylim()
    assert -3 < low < -1
    assert 1 < high < 3


def test_a_picture_of_motions_takes_the_finest_step_at_which_they_differ():
    one = experiment(methods=NODES[:2])
    finished = finish(one, error=lambda run: 0.4 * run.step_size)  # the largest position is 1.2
    figure = plotting.trajectory_figure(one, finished)
    assert "h = 0.5$" in figure.axes[0].get_xlabel()
    # errors are drawn where they are least, and motions that agree everywhere on the finest grid
    assert "h = 0.03125$" in plotting.error_figure(one, finished).axes[0].get_xlabel()
    close = finish(one, error=lambda run: 1e-3)
    assert "h = 0.03125$" in plotting.trajectory_figure(one, close).axes[0].get_xlabel()


def test_of_several_methods_the_finest_step_that_all_have_reached_is_drawn():
    two = experiment(methods=NODES[:2])

    def status(run: Run) -> str:
        return "diverged" if run.method == NODES[1] and run.n_steps > 64 else "ok"

    together = plotting.trajectory_figure(two, finish(two, status=status))
    assert "h = 0.125$" in together.axes[0].get_xlabel()


def derivative_study(b: int) -> tuple[Experiment, list[FinishedRun]]:
    problem = DerivativeProblem(
        function=lambda t: (t ** (b - 1) * np.sin(t))[:, None],
        order=0.5,
        final_time=1.0,
        exact=lambda t: np.sin(t)[:, None],
    )
    one = experiment(problem=problem, methods=NODES, name=f"saturation-b{b}")
    return one, finish(one, error=lambda run: 1e-3 * run.step_size ** min(2, b - 0.5))


@functools.cache
def saturated() -> Figure:
    """The usual four rows; not to be changed."""
    made = plotting.figures_for([derivative_study(b) for b in (1, 3, 4, 5)], name="saturation")
    assert set(made) == {"saturation"}
    return made["saturation"]


def test_saturation_has_a_row_for_every_b_and_a_column_for_every_norm():
    figure = saturated()
    assert [axes.get_title().split("\n")[-1] for axes in figure.axes] == [
        f"$b = {b}$: order $\\min(p, {limit})$"
        for b in (1, 3, 4, 5)
        for limit in (f"{2 * b - 1}/2", b + 1)
    ]
    titles = [axes.get_title().split("\n")[0] for axes in figure.axes[:2]]
    assert titles == ["largest on the grid", "at $t = 1$"]
    # every panel has the range of its own errors
    ranges = [axes.get_ylim() for axes in figure.axes[::2]]
    assert ranges[0] != ranges[1]
    assert len(lines(figure)) == 24
    heading = figure.legends[0].get_title().get_text()
    assert r"$t^{\,b-1} \sin t$" in heading
    assert "order 1/2" in heading
    # the second column is measured at the end of the trajectory
    (_, finished) = derivative_study(1)
    last = [abs(f.trajectory.position[-1, 0] - np.sin(1.0)) for f in finished[: len(LADDER)]]
    np.testing.assert_allclose(lines(figure)[3].get_ydata(), last[::-1], rtol=1e-12)


def test_saturation_refuses_other_problems():
    one = experiment()
    with pytest.raises(ValueError, match="bagley-torvik"):
        plotting.saturation_figure([(one, finish(one))])


def test_sketch_shows_control_and_quadrature_points():
    figure = plotting.interpolation_figure()
    drawn = {str(line.get_label()): line for line in figure.axes[0].lines}
    assert len(drawn["control points at nodes"].get_xdata()) == 4
    assert len(drawn["quadrature points"].get_xdata()) == 2
    assert "inner control points" in drawn
    pieces = [line for line in figure.axes[0].lines if "piece" in str(line.get_label())]
    assert len(pieces) == 2
    # every piece is a polynomial of that degree, and of no lower one
    x, y = pieces[0].get_xdata(), pieces[0].get_ydata()
    defects = [np.abs(np.polyval(np.polyfit(x, y, k), x) - y).max() for k in (2, 1)]
    assert defects[0] < 1e-12
    assert defects[1] > 1e-3


def test_which_figures_an_experiment_gets():
    ladder = experiment()
    assert plotting.figure_kinds(ladder, finish(ladder)) == ("convergence",)
    short = experiment(steps=[8, 16])
    assert plotting.figure_kinds(short, finish(short)) == ("trajectory", "energy", "error")
    unknown = experiment(steps=[8], problem=oscillator(exact=False))
    lost = finish(unknown, error=lambda run: float("nan"))
    assert plotting.figure_kinds(unknown, lost) == ("trajectory", "energy")
    # errors against a refined run are as good
    assert plotting.figure_kinds(unknown, finish(unknown)) == ("trajectory", "energy", "error")
    named = experiment(figures=("energy", "convergence"))
    assert plotting.figure_kinds(named, finish(named)) == ("energy", "convergence")
    wrong = experiment(figures=("enrgy",))
    with pytest.raises(ValueError, match="'enrgy' is not one of convergence, trajectory"):
        plotting.figure_kinds(wrong, finish(wrong))


def test_a_figure_that_is_named_and_cannot_be_drawn_is_told_with_its_reason():
    one = experiment(problem=oscillator(exact=False), figures=("trajectory", "error"))
    lost = finish(one, error=lambda run: float("nan"))
    (line,) = plotting.left_out([(one, lost)])
    assert line.startswith("made-up: no error figure, since no error is known: the reference is")
    assert plotting.left_out([(one, finish(one))]) == []
    assert plotting.left_out([(experiment(), lost)]) == []  # nothing was named
    named = experiment(figures=("energy",), methods=NODES[:1])
    still = [
        dataclasses.replace(item, trajectory=dataclasses.replace(item.trajectory, energy=None))
        for item in finish(named)
    ]
    assert plotting.left_out([(named, still)]) == [
        "made-up: no energy figure, since no method of the experiment has a momentum"
    ]


def test_error_is_measured_against_a_refined_run_where_no_exact_solution_is_known():
    one = experiment(methods=NODES[:1], steps=[64], problem=oscillator(exact=False))
    (axes,) = plotting.error_figure(one, finish(one)).axes
    known = experiment(methods=NODES[:1], steps=[64])
    (other,) = plotting.error_figure(known, finish(known)).axes
    got, wanted = (panel.lines[0].get_ydata()[1:] for panel in (axes, other))
    np.testing.assert_allclose(got, wanted, rtol=1e-9)
    assert "refined run" in axes.get_ylabel()
    assert "refined run" not in other.get_ylabel()


def test_experiments_of_one_configuration_share_a_convergence_figure():
    both = (experiment(name=name, methods=NODES[:1]) for name in "ab")
    studies = [(one, finish(one)) for one in both]
    together = plotting.figures_for(studies, name="table-1")
    assert set(together) == {"table-1-convergence"}
    # one kind and order twice: the names tell the panels apart
    assert [axes.get_title() for axes in together["table-1-convergence"].axes] == ["a", "b"]


def test_saved_files_are_the_same_bytes_every_time(tmp_path):
    kept = []
    for folder in ("first", "second"):
        paths = plotting.save_figure(small(), tmp_path / folder, "made-up")
        assert [path.name for path in paths] == ["made-up.pdf", "made-up.png", "made-up.json"]
        kept.append([path.read_bytes() for path in paths])
    assert kept[0] == kept[1]
    assert b"CreationDate" not in kept[0][0]
    assert b"atplotlib" not in kept[0][0] + kept[0][1]


def test_a_failure_while_saving_leaves_the_old_files_and_nothing_else(tmp_path, monkeypatch):
    figure = small()
    plotting.save_figure(figure, tmp_path, "sketch", ("svg", "json"))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    figure.suptitle("another")
    with monkeypatch.context() as patch:
        patch.setattr("fvi_cli.storage.atomic.os.fsync", _no_space)
        with pytest.raises(OSError, match="no space"):
            plotting.save_figure(figure, tmp_path, "sketch", ("svg", "json"))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    plotting.save_figure(figure, tmp_path, "sketch", ("svg", "json"))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} != before


def _no_space(handle: int) -> None:
    raise OSError("no space")


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "a b"])
def test_names_of_files_stay_in_their_folder(tmp_path, name):
    with pytest.raises(ValueError, match="letters, digits"):
        plotting.save_figure(plotting.interpolation_figure(), tmp_path, name)
    assert not list(tmp_path.iterdir())


def test_files_that_show_the_same_are_left_as_they_are(tmp_path):
    def save(factor: float) -> dict[str, bytes]:
        paths = write_figures({"made-up": small(factor)}, tmp_path, formats=("svg",))
        return {path.name: path.read_bytes() for path in paths}

    first = save(1.0)
    picture = tmp_path / "figures" / "made-up.svg"
    picture.write_bytes(b"of another machine")
    kept = save(1 + 1e-6)
    assert kept == {**first, "made-up.svg": b"of another machine"}
    picture.unlink()
    assert save(1.0) == first
    assert save(1.1) != first


def test_formats_are_those_that_are_asked_for(tmp_path):
    figure = small()
    paths = plotting.save_figure(figure, tmp_path, "sketch", ("svg", "png", "json"))
    assert [path.name for path in paths] == ["sketch.svg", "sketch.png", "sketch.json"]
    text = (tmp_path / "sketch.svg").read_text(encoding="utf-8")
    assert "<svg" in text
    assert "<dc:date>" not in text
    path = plotting.save_figure(small(), tmp_path / "again", "sketch", ("svg",))[0]
    assert path.read_text(encoding="utf-8") == text
    with pytest.raises(ValueError, match="'gif' is not one of pdf, png, svg"):
        plotting.save_figure(figure, tmp_path, "sketch", ("gif",))


def test_a_style_file_sets_fonts_and_leaves_methods_their_colours(tmp_path):
    one = experiment(methods=NODES[:2])
    style = tmp_path / "mine.mplstyle"
    style.write_text("axes.labelsize: 13.0  # large\nlines.linewidth: 3\n")

    def drawn() -> tuple[float, list[object], list[float]]:
        figure = plotting.convergence_figure([(one, finish(one))])
        write_figures({"made-up": figure}, tmp_path, formats=("svg",))
        curves = lines(figure)
        return (
            figure.axes[0].xaxis.label.get_fontsize(),
            [line.get_color() for line in curves],
            [line.get_linewidth() for line in curves],
        )

    plain = drawn()
    path = tmp_path / "figures" / "made-up.svg"
    picture = path.read_bytes()
    with plotting.style_file(style):
        size, colours, widths = drawn()
        styled = path.read_bytes()
    assert (size, colours, widths) == (13.0, plain[1], [3.0] * 2)
    assert styled != picture
    # without the file everything is as before, and drawn anew
    assert drawn() == plain
    assert path.read_bytes() == picture


@pytest.mark.parametrize("font", ["STIXGeneral", "DejaVu Sans Mono"])
@pytest.mark.parametrize("kind", ["convergence", "saturation", "error", "sketch"])
def test_words_stay_on_the_figure_in_any_font(tmp_path, font, kind):
    style = tmp_path / "mine.mplstyle"
    style.write_text(f"font.family: {font}\n")
    one = experiment(methods=NODES)
    with plotting.style_file(style):
        figure = {
            "convergence": lambda: plotting.convergence_figure([(one, finish(one))]),
            "saturation": saturated.__wrapped__,
            "error": lambda: plotting.error_figure(one, finish(one)),
            "sketch": plotting.interpolation_figure,
        }[kind]()
        figure.draw_without_rendering()
    whole = figure.bbox
    words = [text for one in figure.legends for text in (*one.get_texts(), one.get_title())]
    for axes in figure.axes:
        words += [axes.title, axes.xaxis.label, axes.yaxis.label]
    for text in filter(mpl.text.Text.get_text, words):
        box = text.get_window_extent()
        assert box.x0 >= whole.x0 - 1, text
        assert box.x1 <= whole.x1 + 1, text


def test_a_style_file_sets_the_size_and_the_dots(tmp_path):
    style = tmp_path / "mine.mplstyle"
    style.write_text("figure.figsize: 5, 5\nsavefig.dpi: 80\n")

    def size() -> tuple[int, int]:
        figure = plotting.convergence_figure([(one, finish(one))])
        (path,) = plotting.save_figure(figure, tmp_path, "made-up", ("png",))
        header = path.read_bytes()[16:24]
        return int.from_bytes(header[:4]), int.from_bytes(header[4:])

    one = experiment(methods=NODES[:1])
    plain = size()
    with plotting.style_file(style):
        styled = size()
    assert styled[0] == 400
    assert plain[0] == 669
    # twice as high at two fifths of the dots
    assert styled[1] == pytest.approx(plain[1] * 2 * 80 / 200, abs=2)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("axes.grid: on\nline.width: 3\n", "line 2: 'line.width' is not a setting"),
        ("font.size\n", "line 1: 'font.size' is not a setting"),
        ("font.size: big\n", "font.size"),
        ("font.sizes: 8\n", "did you mean 'font.size'"),
        ("backend: svg\n", "line 1: 'backend' is not a property of the drawing"),
        ("savefig.format: svg\n", "remove the line and write --format"),
        ("font.family: Times Nwe Roman\n", "Times Nwe Roman is not installed; write another"),
        ("font.family: serif\nfont.serif: Garamondo\n", "Garamondo is not installed"),
        (None, "cannot be read"),
    ],
)
def test_a_style_file_that_cannot_be_followed(tmp_path, text, complaint):
    style = tmp_path / "mine.mplstyle"
    if text is not None:
        style.write_text(text)
    with pytest.raises(ValueError, match=complaint), plotting.style_file(style):
        pass


def test_the_command_takes_formats_and_a_style(tmp_path):
    config = tmp_path / "tiny.yaml"
    config.write_text(
        "name: tiny\nproblem: {kind: pendulum, final_time: 1.0, initial: {position: 1.0}}\n"
        "method: {rk: gauss, degree: 2}\nladder: {steps: [8]}\nfigures: [trajectory]\n"
    )
    style = tmp_path / "mine.mplstyle"
    style.write_text("font.size: 12\n")
    asked = ["plot", str(config), "-q", "--output", str(tmp_path), "--style", str(style)]
    fvi(*asked, "--format", "svg", "--format", "png", code=0)
    written = {path.name for path in (tmp_path / "figures").iterdir()}
    assert written == {f"tiny-trajectory.{suffix}" for suffix in ("svg", "png", "json")}
    refused = fvi(*asked, "--format", "gif", code=2)
    assert "--format: 'gif' is not one of pdf, png, svg" in refused.stderr
    style.write_text("font.sise: 12\n")
    refused = fvi(*asked, code=2)
    assert "--style" in refused.stderr
    assert "line 1: 'font.sise' is not a setting of matplotlib" in refused.stderr


def test_drawn_data_survives_its_file(tmp_path):
    figure = usual()
    (path,) = plotting.save_figure(figure, tmp_path, "made-up", ("json",))
    assert path.read_text(encoding="utf-8") == plotting.drawn_text(figure)
    stored = json.loads(path.read_text(encoding="utf-8"))
    assert plotting.compare_drawn(stored, plotting.drawn_data(figure)) == []
    (panel,) = stored["panels"]
    by_label = {line["label"]: line for line in panel["lines"]}
    assert by_label["order 2"] == {"label": "order 2", "slope": 2.0}
    assert by_label["BDF1"]["y"] == [float(f"{0.1 * 8.0 / n:.2e}") for n in reversed(LADDER)]


@pytest.mark.parametrize(("factor", "differences"), [(1.0005, 0), (1.03, len(LADDER))])
def test_comparison_sees_the_third_digit_and_no_more(factor, differences):
    one = experiment(methods=NODES[:1])
    old = plotting.drawn_data(usual_alone())
    moved = finish(one, error=lambda run: factor * power_law(run))
    new = plotting.drawn_data(plotting.convergence_figure([(one, moved)]))
    assert len(plotting.compare_drawn(old, new)) == differences


def test_comparison_leaves_round_off_alone():
    one = experiment(methods=NODES[:1])

    def drawn(noise: float) -> object:
        made = finish(one, error=lambda run: max(run.step_size**9, noise))
        return plotting.drawn_data(plotting.convergence_figure([(one, made)]))

    old = drawn(2e-14)
    assert plotting.compare_drawn(old, drawn(5e-14)) == []
    assert plotting.compare_drawn(old, drawn(5e-9)) != []


def test_comparison_names_what_went_missing():
    long = experiment()
    old, new = plotting.drawn_data(usual()), plotting.drawn_data(usual_alone())
    found = plotting.compare_drawn(old, new)
    assert any("panels.0.lines" in line for line in found)
    diverged = finish(long, status=lambda run: "diverged" if run.n_steps == 8 else "ok")
    assert plotting.compare_drawn(
        old, plotting.drawn_data(plotting.convergence_figure([(long, diverged)]))
    )


def test_nothing_is_written_too_small_to_read():
    one = experiment()
    made = [
        plotting.interpolation_figure(),
        saturated(),
        usual(),
        plotting.error_figure(one, finish(one)),
    ]
    for figure in made:
        assert figure.get_figwidth() == pytest.approx(85 / 25.4)
        sizes = [text.get_fontsize() for text in figure.findobj(mpl.text.Text) if text.get_text()]
        assert min(sizes) >= 7


def test_a_curve_that_breaks_off_explains_no_slope():
    one = experiment(methods=[Method(cq=f"bdf{p}", degree=1, sampling="nodes") for p in (2, 3)])

    def status(run: Run) -> str:
        return "diverged" if run.method.case.startswith("bdf3") and run.n_steps == 128 else "ok"

    def error(run: Run) -> float:
        return (1.0 if run.method.case.startswith("bdf3") else 1e-4) * run.step_size**2

    def height(**how: Callable[[Run], str]) -> float:
        figure = plotting.convergence_figure([(one, finish(one, error=error, **how))])
        (guide,) = guides(figure)
        return float(np.mean(np.log(guide.get_ydata())))

    # beside the lower curve, which has no gap
    lower, upper = (np.log(scale * 0.25**2) for scale in (1e-4, 1.0))
    broken = height(status=status)
    assert abs(broken - lower) < abs(broken - upper)


@pytest.mark.parametrize(("share", "differs"), [("59 %", False), ("60 %", True), ("59", True)])
def test_comparison_forgives_a_percentage_its_last_digit(share, differs):
    found = plotting.compare_drawn({"texts": ["58 %"]}, {"texts": [share]})
    assert bool(found) == differs


def test_a_check_asks_for_the_pictures_that_are_wanted(tmp_path):
    figures = {"sketch": small()}
    write_figures(figures, tmp_path, formats=("svg",))
    assert compare_figures(figures, tmp_path, formats=("svg",)) == []
    (line,) = compare_figures(figures, tmp_path)
    assert line.endswith("sketch.png: missing")
