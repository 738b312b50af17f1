"""What every kind of figure owes to its reader: units, ticks of one form, no name twice."""

import dataclasses
import re
from collections.abc import Iterator

import numpy as np
import pytest
import yaml
from command_line import configuration
from cost_tables import COUNTS, GAUSS, row, table
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from spread import spread

import fvi_cli as fvi
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.ladders.cost import cost_figure
from fvi_cli.plotting.panels import ladders, over_time, plane
from fvi_cli.plotting.stability import stability_figures
from fvi_cli.studies.cost import CostCase

COSTS = table(CostCase(method=GAUSS, rows=tuple(row(n, n**-4.0, 1e-3 + 1e-5 * n) for n in COUNTS)))
UNITS = "units: {time: ms, length: mm, force: kN%s}\n"
OSCILLATOR = (
    "kind: damped-oscillator, damping: [{order: 0.5, coefficient: 0.3}], "
    "forcing: cos(1.2*t), final_time: 4.0"
)
GROUND = "ground_acceleration: sin(3*t), final_time: 2.0"
SWEPT = "sweep: {problem.damping.0.coefficient: {from: 0.1, to: 0.9, number: %d}}\n"
SCENES = {
    "motion": configuration(
        OSCILLATOR,
        name="motion",
        method="{rk: gauss, degree: [2, 3]}",
        steps="32, 64",
        more="store: {diagnostics: [energy-balance]}\n"
        "figures: [trajectory, energy, error, balance, phase]\n",
    ),
    "ladder": configuration(OSCILLATOR, name="ladder", steps="16, 32, 64"),
    "l2": configuration(OSCILLATOR, name="l2", steps="16, 32, 64", more="report: {norm: l2}\n"),
    "planet": configuration(
        "kind: kepler, initial: {position: [1.0, 0.0], velocity: [0.0, 1.1]}, final_time: 8.0",
        name="planet",
        steps="64",
        more="store: {diagnostics: [momentum-maps]}\nfigures: [momenta, path]\n",
    ),
    "building": configuration(
        "kind: frame, storeys: 2, mass: 2.0, stiffness: 40.0, "
        f"dampers: [{{order: 0.5, coefficient: 1.0}}], {GROUND}",
        name="building",
        steps="40",
        more="quantities: [force_1_1, drift_1]\nfigures: [waterfall, hysteresis, quantities]\n",
    ),
    "spectrum": configuration(
        f"kind: structure, mass: 1.0, stiffness: 9.0, {GROUND}, exact: none, "
        "rayleigh: {stiffness: 0.3, order: 0.5}",
        name="spectrum",
        steps="40",
        more="figures: [spectrum]\nsweep: {problem.stiffness: [4.0, 9.0], "
        "problem.rayleigh.stiffness: [0.1, 0.2]}\n",
    ),
    **{
        f"{count} members": configuration(
            OSCILLATOR,
            name=f"members{count}",
            steps="16, 32, 64",
            more=SWEPT
            % count
            + "events: {period: {when: sin(t)}}\nquantities: {force_max: force_1}\n"
            "figures: [convergence, trajectory, quantities, section, {plot: peak_force_max, "
            "against: problem.damping.0.coefficient}]\n",
        )
        for count in (3, 8)
    },
}
PURE = re.compile(  # numbers without a unit, and what has its unit elsewhere in the words
    r"growth per step|multiply-adds|time \(s\)$|^order |^phase|^(mass|storey) \$i\$|degrees|%"
)


def read(text: str) -> dict[str, object]:
    content: dict[str, object] = yaml.safe_load(text)
    return content


def stability(name: str, more: str, steps: str = "8, 64") -> Iterator[Figure]:
    text = configuration(OSCILLATOR, name=name, method="{bdf: [2, 5]}", steps=steps, more=more)
    config = text + UNITS % "" + "stability: {observe: false}\n"
    yield from stability_figures(name, fvi.stability(read(config))).values()


@pytest.fixture(scope="module", params=spread(few=1, name=list(SCENES)).args[1])
def figures(request: pytest.FixtureRequest) -> dict[str, Figure]:
    """The figures of an experiment all of whose units are given, and one of costs."""
    text = SCENES[request.param]
    own = ", force_max: kN" * ("force_max" in text) + ", drift_1: mm" * ("drift_1" in text)
    drawn = fvi.figures(fvi.run(read(text + UNITS % own)))
    assert drawn
    return {**drawn, "cost": cost_figure(dataclasses.replace(COSTS, units={"length": "mm"}))}


def panels(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.axison]


def axes_of(figure: Figure) -> list[Axis]:
    return [axis for one in panels(figure) for axis in (one.xaxis, one.yaxis)]


def test_the_condition_of_a_section_is_typeset():
    text = SCENES["3 members"]
    (figure,) = [one for name, one in fvi.figures(fvi.run(read(text))).items() if "section" in name]
    words = figure.legends[0].get_title().get_text()
    assert words.startswith(r"points where $\sin(t)$ passes 0")


def test_every_axis_of_a_quantity_has_its_unit(figures):
    for name, figure in figures.items():
        for axis in axes_of(figure):
            words = axis.get_label_text().replace("\n", " ")
            if words and not PURE.search(words):
                assert re.search(r"\((\$.*\$ )?(ms|mm|kN)|\(1/ms|\(.*kN", words), (name, words)


def test_no_two_axes_of_a_figure_say_which_colour_is_which(figures):
    for name, figure in figures.items():
        bars = [one.get_xlabel() for one in figure.axes if one.get_gid() == "decoration"]
        words = [one.get_xlabel() for one in figure.axes if one.get_xlabel()]
        assert all(words.count(bar) == 1 for bar in bars), (name, words)


def numbers(axis: Axis) -> list[str]:
    """The numbers that can be seen beside an axis."""
    low, high = sorted(axis.get_view_interval())
    return [
        tick.label1.get_text()
        for tick in axis.get_major_ticks() + axis.get_minor_ticks()
        if low <= tick.get_loc() <= high and tick.label1.get_text() and tick.label1.get_visible()
    ]


def forms(axis: Axis) -> set[str]:
    """Forms of the numbers: in full, powers of ten, and multiples of these."""
    return {
        "multiple" if r"\times" in one else "power" if "10^" in one else "full"
        for one in numbers(axis)
    }


def test_a_stability_figure_says_that_it_does_not_show_all_panels():
    keys = "problem.stiffness: [1.0], problem.damping.0.coefficient: [0.1, 0.2]"
    more = f"sweep: {{{keys}}}\n"
    for steps, words in (("8, 64", ""), ("8, 16, 24, 32, 40, 48, 56", "the first 12 of 14 panels")):
        (figure,) = stability("maps", more, steps)
        shown = sum(bool(axes.get_title()) for axes in figure.axes)
        (legend,) = figure.legends
        said = legend.get_title().get_text()
        assert (shown, said.partition(";")[0]) == (12 if words else 4, words)


def test_numbers_beside_an_axis_have_one_form(figures):
    for name, figure in figures.items():
        figure.draw_without_rendering()
        for axis in axes_of(figure):
            assert len(forms(axis)) <= 1, (name, axis.get_label_text(), numbers(axis))


@spread(few=1, low=[3e-7, 0.004, 0.3, 1.1, 30.0, 4e5], share=[1.7, 6.0, 30.0, 150.0, 1e5])
def test_logarithmic_axes_of_any_range_have_numbers_of_one_form(low, share):
    x = np.geomspace(low, low * share, 5)
    for figure in (
        ladders([Panel(curves=[Curve(x=x, y=x)], y="error")]),
        over_time(
            [Panel(curves=[Curve(x=x, y=x)], y="size", is_log=True)], x="t", logarithmic=True
        ),
    ):
        figure.draw_without_rendering()
        for axis in axes_of(figure):
            assert len(forms(axis)) == 1, numbers(axis)
            assert len(set(numbers(axis))) == len(numbers(axis))


@spread(few=1, size=[1e-7, 1.0, 3e8])
def test_a_common_factor_stands_beside_the_unit(size):
    x = np.linspace(0.0, size, 9)
    curves = [Curve(x=x, y=x)]
    one = over_time([Panel(curves=curves, y="force (N)")], x="time $t$ (s)")
    other = plane([Panel(curves=curves, x="place", y="force (N)")])
    for figure in (one, other):
        (axes,) = figure.axes
        figure.draw_without_rendering()
        for axis in (axes.xaxis, axes.yaxis):
            factor = axis.get_offset_text()
            assert bool(factor.get_text()) == (size != 1.0)
            assert not (factor.get_text() and factor.get_visible())
            assert ("10^" in axis.get_label_text()) == (size != 1.0)
    exponent = {1e-7: "-7", 1.0: "", 3e8: "8"}[size]
    words = f"force ($10^{{{exponent}}}$ N)" if exponent else "force (N)"
    assert one.axes[0].get_ylabel() == words


@spread(few=1, height=[0.4, 0.61, 0.35])
def test_every_panel_over_time_has_three_numbers_at_least(height):
    x = np.linspace(0.0, 8.0, 100)
    curves = [Curve(x=x, y=height * np.sin(x) + 0.1)]
    figure = over_time([Panel(curves=curves, y="drift (m)", height=0.9)] * 6, x="time $t$ (s)")
    figure.draw_without_rendering()
    assert all(len(numbers(axes.yaxis)) >= 3 for axes in figure.axes)


def test_what_is_zero_throughout_has_no_peak():
    text = configuration(
        "kind: frame, storeys: 2, mass: 2.0, stiffness: 40.0, "
        f"dampers: [{{order: 0.5, coefficient: 1.0}}], {GROUND}",
        name="absent",
        steps="40",
        more="quantities: [force_1_1]\nfigures: [quantities]\n"
        "sweep: {problem.dampers.0.coefficient: [0.0, 1.0]}\n",
    )
    (figure,) = fvi.figures(fvi.run(read(text))).values()
    peaks = [line for line in figure.axes[0].lines if line.get_label().startswith("_peak")]
    assert len(peaks) == 1


def test_a_quantity_is_the_force_of_a_damper_only_if_it_is():
    text = configuration(
        "kind: frame, storeys: 2, mass: 2.0, stiffness: 40.0, "
        f"dampers: [{{order: 0.5, coefficient: 1.0}}], {GROUND}",
        name="named",
        steps="40",
        more="quantities: {force_1_1: force_1_1, force_max: force_1_1, work_1: work_1}\n"
        "figures: [quantities]\n",
    )
    (figure,) = fvi.figures(fvi.run(read(text))).values()
    words = [axes.get_ylabel().replace("\n", " ") for axes in figure.axes]
    assert words == ["force of damper 1 1", "force max", "work on damper 1"]


@pytest.mark.few(1)
@pytest.mark.parametrize("kind", ["caputo", "riemann-liouville"])
def test_a_figure_of_costs_says_which_derivative_it_is_about(kind):
    figure = cost_figure(dataclasses.replace(COSTS, gamma="0.5", derivative=kind))
    words = figure.get_suptitle()
    assert ("Caputo" in words) == (kind == "caputo")
    assert ("Riemann" in words) == (kind != "caputo")
    whole = cost_figure(dataclasses.replace(COSTS, gamma="1", derivative=kind))
    assert "derivative" not in whole.get_suptitle()


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("name", "more"), [("steps", ""), ("swept", "sweep: {problem.stiffness: [1.0, 2.0, 30.0]}\n")]
)
def test_figures_of_stability_have_units_and_ticks_of_one_form(name, more):
    for figure in stability(name, more):
        figure.draw_without_rendering()
        labels = [axis.get_label_text() for axis in axes_of(figure)]
        assert "step size $h$ (ms)" in labels
        if more:
            assert any(label.replace("\n", " ") == "stiffness (kN/mm)" for label in labels)
        assert all(len(forms(axis)) <= 1 for axis in axes_of(figure))


def test_a_curve_that_diverges_and_comes_back_leads_to_the_strip_and_down_again():
    steps = np.array([0.5, 0.25, 0.125, 0.0625])
    errors = np.array([1e-1, np.nan, np.nan, 1e-4])
    lost = [(0.25, "diverged"), (0.125, "diverged")]
    (axes,) = ladders([Panel(curves=[Curve(x=steps, y=errors, lost=lost)], y="error")]).axes
    leads = [line for line in axes.lines if line.get_label() == "_lead to the strip"]
    ends = sorted(tuple(zip(*line.get_data(), strict=True)) for line in leads)
    assert [(left[0], right[0]) for left, right in ends] == [(0.0625, 0.125), (0.25, 0.5)]
    assert (ends[0][0][1], ends[1][1][1]) == (1e-4, 1e-1)
    assert ends[0][1][1] == ends[1][0][1] > 1e-1
