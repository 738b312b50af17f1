"""Figures are judged by what they draw."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from made_runs import BDF1, BDF2, BDF3, LADDER, NODES, made_study, swinging
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fvi_cli import plotting
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.plotting.ladders import convergence as convergence_plots
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run

Study = tuple[Experiment, list[FinishedRun]]

EULER = Baseline(name="explicit-euler")
IMPLICIT = Baseline(name="implicit-euler")
VARIANTS = [Method(cq=f"bdf{p}", degree=d, sampling="nodes") for p in (1, 2, 3, 4) for d in (1, 2)]

# --- what is drawn --------------------------------------------------------------------------------


def convergence(*methods: AnyMethod, **changes: Any) -> Figure:
    return plotting.convergence_figure([made_study(methods or NODES, **changes)])


@functools.cache
def usual() -> Figure:
    """Errors of three methods that fall with their orders; not to be changed."""
    return convergence()


def fallen_back(coarse: Sequence[int]) -> Figure:
    """BDF2 whose rows with `coarse` step counts are expected to have another order."""
    one, finished = made_study([BDF2])
    changed = [
        dataclasses.replace(item, expected_order=3.3 if item.run.n_steps in coarse else 2.0)
        for item in finished
    ]
    return plotting.convergence_figure([(one, changed)])


def at_round_off() -> Figure:
    """BDF2 whose finest rows are round-off, and expected to have another order."""
    one, finished = made_study([BDF2])
    round_off = {"error": 1e-14, "expected_order": 3.3}
    changed = [
        dataclasses.replace(item, **(round_off if item.run.n_steps > 100 else {}))
        for item in finished
    ]
    return plotting.convergence_figure([(one, changed)])


def lost(method: AnyMethod, is_lost: Callable[[int], bool], word: str = "diverged") -> Any:
    return lambda run: word if run.method == method and is_lost(run.n_steps) else "ok"


def sizes(*found: float) -> Callable[[Run], float]:
    """Errors by the place of the method among those of the experiment."""
    return lambda run: found[run.experiment.methods.index(run.method)]


def of_motions(draw: Any, methods: Sequence[AnyMethod], **changes: Any) -> Callable[[], Figure]:
    return lambda: draw(*made_study(methods, **changes))


def of_methods(kind: str) -> Figure:
    study = made_study([BDF1, EULER, IMPLICIT], [64], error=sizes(0.2, 0.4, 0.6))
    return plotting.figures_for([study], name="made-up")[f"made-up-{kind}"]


def derivative_study(b: int) -> Study:
    problem = DerivativeProblem(
        function=lambda t: (t ** (b - 1) * np.sin(t))[:, None],
        order=0.5,
        final_time=1.0,
        exact=lambda t: np.sin(t)[:, None],
    )

    def error(run: Run) -> float:
        return 1e-3 * run.step_size ** min(2, b - 0.5)

    return made_study(problem=problem, name=f"saturation-b{b}", error=error)


@functools.cache
def saturated() -> Figure:
    """The usual four rows; not to be changed."""
    made = plotting.figures_for([derivative_study(b) for b in (1, 3, 4, 5)], name="saturation")
    assert set(made) == {"saturation"}
    return made["saturation"]


FIGURES: dict[str, Callable[[], Figure]] = {
    "usual": usual,
    "graded-l2": lambda: convergence(grading=2.0, norm="l2"),
    # 2 is expected anyhow
    "stated-orders": lambda: convergence(claims={"bdf2": 1.8, "bdf3": 2.0}),
    "eight-methods": lambda: convergence(*VARIANTS, error=lambda run: run.step_size),
    "six-methods": lambda: convergence(*VARIANTS[:6]),
    "observed-slope": lambda: convergence(EULER, IMPLICIT),
    "another-order-on-coarse-steps": lambda: fallen_back(LADDER[:3]),
    "another-order-on-fine-steps": lambda: fallen_back(LADDER[3:]),
    "rows-at-round-off": at_round_off,
    "round-off-reached": lambda: convergence(error=lambda run: max(run.step_size**14, 3e-14)),
    "all-diverged": lambda: convergence(status=lambda run: "diverged"),
    "diverged": lambda: convergence(status=lost(BDF3, lambda n: n < 64)),
    "failed": lambda: convergence(BDF1, error=lambda run: np.nan, status=lambda run: "failed"),
    "refused": lambda: convergence(BDF1, error=lambda run: np.nan, status=lambda run: "refused"),
    "two-of-one-kind": lambda: plotting.figures_for(
        [made_study([BDF1], name=name) for name in "ab"], name="table-1"
    )["table-1-convergence"],
    **{kind: lambda kind=kind: of_methods(kind) for kind in ("trajectory", "energy", "error")},
    "error-without-solution": of_motions(
        plotting.error_figure, [BDF1], steps=[64], problem=swinging(exact=False)
    ),
    "two-that-look-alike": of_motions(
        plotting.trajectory_figure, [BDF1, BDF2, EULER], steps=[64], error=sizes(1e-3, 2e-3, 0.2)
    ),
    # the largest position is 1.2; errors are drawn where they are least
    **{
        f"step-of-{kind}": of_motions(
            draw, NODES[:2], error=lambda run: 0.4 * run.step_size, steps=LADDER[:4]
        )
        for kind, draw in (
            ("motions", plotting.trajectory_figure),
            ("errors", plotting.error_figure),
        )
    },
    "step-of-motions-alike": of_motions(
        plotting.trajectory_figure, NODES[:2], error=lambda run: 1e-3, steps=LADDER[:4]
    ),
    "step-that-all-reach": of_motions(
        plotting.trajectory_figure, NODES[:2], status=lost(BDF2, lambda n: n > 32), steps=LADDER[:4]
    ),
    "saturation": saturated,
    "sketch": plotting.interpolation_figure,
}


@pytest.mark.few(9)
@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_drawn(name):
    figure = FIGURES[name]()
    figure.draw_without_rendering()
    assert all(axes.lines for axes in figure.axes)


def test_convergence_draws_every_error_of_every_method():
    _, finished = made_study()
    for method, line in zip(NODES, lines(usual()), strict=True):
        wanted = sorted((f.run.step_size, f.error) for f in finished if f.run.method == method)
        assert list(zip(line.get_xdata(), line.get_ydata(), strict=True)) == wanted
    (legend,) = usual().legends
    assert {one.label for one in NODES} <= {text.get_text() for text in legend.get_texts()}


def test_saturation_says_what_it_is_about_and_every_panel_has_its_own_range():
    ranges = [axes.get_ylim() for axes in saturated().axes[::2]]
    assert ranges[0] != ranges[1]
    heading = saturated().legends[0].get_title().get_text()
    assert r"$f(t) = t^{\,b-1} \sin t$" in heading
    assert "order 1/2" in heading


@pytest.mark.parametrize("b", [1, 2, 3])
def test_a_saturated_order_is_explained_beside_curves_that_have_it(b, monkeypatch):
    drawn = []
    monkeypatch.setattr(convergence_plots, "ladders", lambda panels, **_: drawn.extend(panels))
    plotting.saturation_figure([derivative_study(b)])
    for panel, limit in zip(drawn, (b - 0.5, b + 1), strict=True):
        most = min(limit, 3)
        orders = {int(curve.label[3]): curve.order for curve in panel.curves}
        assert {p for p, order in orders.items() if order == most} == {
            p for p in (1, 2, 3) if p >= most
        }
        assert all(np.isnan(order) for p, order in orders.items() if p < most)


def test_pieces_of_the_sketch_are_polynomials_of_their_degree_and_of_no_lower_one():
    drawn = plotting.interpolation_figure().axes[0].lines
    pieces = [line for line in drawn if "piece" in str(line.get_label())]
    assert len(pieces) == 2
    x, y = pieces[0].get_xdata(), pieces[0].get_ydata()
    defects = [np.abs(np.polyval(np.polyfit(x, y, k), x) - y).max() for k in (2, 1)]
    assert defects[0] < 1e-12
    assert defects[1] > 1e-3


def test_a_solution_that_runs_away_does_not_press_the_others_flat():
    one = made_study(NODES[:2], [64], error=sizes(1e-3, 1e6))
    low, high = plotting.trajectory_figure(*one).axes[0].get_ylim()
    assert -3 < low < -1
    assert 1 < high < 3


# --- which figures --------------------------------------------------------------------------------


@pytest.mark.parametrize("studies", [[], [(made_study()[0], [])]])
@pytest.mark.parametrize("draw", [plotting.convergence_figure, plotting.saturation_figure])
def test_without_runs_there_is_nothing_to_draw(draw, studies):
    with pytest.raises(ValueError):
        draw(studies)


def test_saturation_refuses_other_problems():
    with pytest.raises(ValueError, match="bagley-torvik"):
        plotting.saturation_figure([made_study()])


NO_ERRORS = {"problem": swinging(exact=False), "error": lambda run: np.nan}


@pytest.mark.parametrize(
    ("study", "kinds"),
    [
        (made_study(), ("convergence",)),
        (made_study(steps=[8, 16]), ("trajectory", "energy", "error")),
        (made_study(steps=[8], **NO_ERRORS), ("trajectory", "energy")),
        # errors against a refined run are as good
        (
            made_study(steps=[8], problem=swinging(exact=False)),
            ("trajectory", "energy", "error"),
        ),
        (made_study(figures=("energy", "convergence")), ("energy", "convergence")),
    ],
)
def test_which_figures_an_experiment_gets(study, kinds):
    assert plotting.figure_kinds(*study) == kinds


def test_a_figure_that_is_not_there_or_cannot_be_drawn_is_told_with_its_reason():
    with pytest.raises(ValueError, match="'enrgy' is not one of convergence, trajectory"):
        plotting.figure_kinds(*made_study(figures=("enrgy",)))
    named = {"figures": ("trajectory", "error"), "problem": swinging(exact=False)}
    (line,) = plotting.left_out([made_study(**named, error=lambda run: np.nan)])
    assert line.startswith("made-up: no error figure, since no error is known: the reference is")
    assert plotting.left_out([made_study(**named)]) == []
    assert plotting.left_out([made_study(**NO_ERRORS)]) == []  # nothing was named
    one, finished = made_study([BDF1], figures=("energy",))
    still = [
        dataclasses.replace(item, trajectory=dataclasses.replace(item.trajectory, energy=None))
        for item in finished
    ]
    assert plotting.left_out([(one, still)]) == [
        "made-up: no energy figure, since no method of the experiment has a momentum; "
        "write method: gauss3"
    ]


# --- where it is drawn ----------------------------------------------------------------------------


def lines(figure: Figure) -> list[Line2D]:
    """Lines that a legend names."""
    found = [line for axes in figure.axes for line in axes.lines]
    return [line for line in found if not str(line.get_label()).startswith("_")]


def guides(figure: Figure) -> dict[str, Line2D]:
    """Rays with slopes by what they say."""
    found = {str(line.get_label())[1:]: line for axes in figure.axes for line in axes.lines}
    return {name: line for name, line in found.items() if name.startswith("order ")}


def test_a_panel_has_its_height_beside_a_legend_and_its_numbers():
    usual().draw_without_rendering()
    (axes,) = usual().axes
    assert axes.get_position().height * usual().get_figheight() > 1.5
    assert len(axes.get_yticks()) > 0
    gone = convergence(status=lambda run: "diverged")
    gone.draw_without_rendering()
    assert len(gone.axes[0].get_yticks()) == 0


def test_slopes_that_the_source_states_are_dashed():
    found = guides(convergence(claims={"bdf2": 1.8, "bdf3": 2.0}))
    dashes = {label: line.is_dashed() for label, line in found.items()}
    assert dashes == {"order 1": False, "order 2": False, "order 9/5 stated": True}


def test_rays_have_the_slopes_that_they_say():
    (axes,) = usual().axes
    for order in (1, 2):
        ray = guides(usual())[f"order {order}"]
        ends = axes.transData.inverted().transform(ray.get_transform().transform(ray.get_xydata()))
        across, up = np.log(ends[1] / ends[0])
        assert up / across == pytest.approx(order, rel=1e-6)


def test_lost_runs_stand_hollow_at_the_top_above_curves():
    figure = convergence(status=lost(BDF3, lambda n: n < 64))
    (panel,) = figure.axes
    (marks,) = (line for line in panel.lines if str(line.get_label()).startswith("_lost"))
    assert marks.get_markerfacecolor() == "none"
    assert list(marks.get_xdata()) == [8.0 / n for n in reversed(LADDER) if n < 64]
    top = panel.transAxes.inverted()
    for line in lines(figure):
        inside = line.get_transform().transform(line.get_xydata()[np.isfinite(line.get_ydata())])
        assert top.transform(inside)[:, 1].max() < min(marks.get_ydata())


def test_round_off_is_hatched_only_where_it_is_reached():
    reached = FIGURES["round-off-reached"]()
    assert any(patch.get_hatch() for patch in reached.axes[0].patches)
    assert not any(patch.get_hatch() for patch in usual().axes[0].patches)


def test_nothing_is_written_too_small_to_read():
    made = [
        plotting.interpolation_figure(),
        saturated(),
        usual(),
        plotting.error_figure(*made_study()),
    ]
    for figure in made:
        assert figure.get_figwidth() == pytest.approx(85 / 25.4)
        sizes = [text.get_fontsize() for text in figure.findobj(mpl.text.Text) if text.get_text()]
        assert min(sizes) >= 7
