"""Figures of motions: what they draw is what the runs say, in the right places."""

import re

import numpy as np
import pytest
from command_line import configuration
from matplotlib.figure import Figure

import fvi_cli as fvi
from fvi_cli import plotting
from fvi_cli.config import parse_config
from fvi_cli.plotting.curves import Curve, Panel
from fvi_cli.plotting.motions.paths import path_figure, phase_figure, waterfall_figure
from fvi_cli.plotting.motions.time_series import balance_figure
from fvi_cli.plotting.panels import over_time
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.study import study

Study = tuple[Experiment, list[FinishedRun]]

OSCILLATOR = configuration(
    "kind: damped-oscillator, damping: [{order: 0.5, coefficient: 0.3}], "
    "forcing: cos(1.2*t), final_time: 4.0",
    name="one",
    method="{rk: gauss, degree: [2, 3]}",
    steps="32, 64",
    more="store: {diagnostics: [energy-balance]}\n",
)
KEPLER = configuration(
    "kind: kepler, damping: [{order: 0.5, coefficient: 0.05}], initial: {position: [1.0, "
    "0.0], velocity: [0.0, 1.1]}, final_time: 8.0",
    name="planet",
    method="[{rk: gauss, degree: 2}, {baseline: implicit-euler}]",
    steps="128",
    more="expect: {implicit-euler: diverged}\nstore: {diagnostics: [energy-balance]}\n",
)
PENDULUM = configuration(
    "kind: double-pendulum, lengths: [1.0, 0.5], joints: [{order: 0.5, coefficient: 0.1}], "
    "initial: {position: [2.0, 2.5], velocity: 0.0}, final_time: 2.0",
    name="two",
    steps="40",
)
CHAIN = configuration(
    "kind: chain, masses: 40, dampers: [{order: 0.5, coefficient: 0.05}], "
    "initial: {position: 0.0, velocity: 1.0}, final_time: 4.0",
    name="row",
    steps="40",
)
FRAME = configuration(
    "kind: frame, storeys: 3, mass: 2.0, stiffness: 40.0, dampers: [{order: 0.5, "
    "coefficient: 1.0}], ground_acceleration: sin(3*t), final_time: 2.0",
    name="house",
    steps="40",
)
STRING = configuration(
    "kind: string, modes: 6, length: 2.0, pluck: {at: 0.3, height: 0.1}, "
    "internal_damping: [{order: 0.5, coefficient: 0.01}], final_time: 2.0",
    name="tone",
    steps="64",
)


def made(text: str) -> Study:
    (experiment,) = parse_config(text, "made.yaml").experiments
    return experiment, list(study(experiment))


@pytest.fixture(scope="module")
def oscillator() -> Study:
    return made(OSCILLATOR)


@pytest.fixture(scope="module")
def planet() -> Study:
    return made(KEPLER)


def drawn(figure: Figure) -> dict[str, dict[str, np.ndarray]]:
    """Lines of the first panel by label."""
    return {
        str(line.get_label()): {
            "x": np.asarray(line.get_xdata()),
            "y": np.asarray(line.get_ydata()),
        }
        for line in figure.axes[0].lines
    }


def test_balance_shows_energy_works_and_a_sum_that_does_not_move(oscillator):
    figure = balance_figure(*oscillator)
    lines = drawn(figure)
    best = oscillator[1][-1].trajectory
    assert np.array_equal(lines["energy $E$"]["y"], best.energy)
    assert np.ptp(lines["$E + W_d - W_f$"]["y"]) < 1e-9 < np.ptp(best.energy)
    below = figure.axes[1]
    assert below.get_yscale() == "log"
    two, three = (np.nanmax(np.asarray(line.get_ydata())) for line in below.lines)
    # both balance exactly
    assert max(two, three) < 1e-14


def test_paths_lead_from_the_start_through_the_stored_points(planet):
    figure = path_figure(*planet)
    lines = drawn(figure)
    place = planet[1][0].trajectory.position
    assert np.array_equal(lines["Gauss2"]["x"], place[:, 0])
    assert (lines["start"]["x"][0], lines["start"]["y"][0]) == (1.0, 0.0)
    assert lines["centre"]["x"][0] == 0.0
    assert figure.axes[0].get_aspect() == 1.0


def test_a_double_pendulum_moves_in_space():
    experiment, finished = made(PENDULUM)
    lines = drawn(path_figure(experiment, finished))
    inner, outer = (lines[f"path of the {one} mass"] for one in ("first", "second"))
    assert np.hypot(inner["x"], inner["y"]) == pytest.approx(1.0)
    rod = np.hypot(outer["x"] - inner["x"], outer["y"] - inner["y"])
    assert rod == pytest.approx(0.5)
    assert (inner["x"][0], inner["y"][0]) == pytest.approx((np.sin(2.0), -np.cos(2.0)))


def test_phase_portraits_have_a_panel_for_every_component(planet):
    figure = phase_figure(*planet)
    assert [axes.get_xlabel() for axes in figure.axes] == ["position $x$", "position $y$"]
    assert [axes.get_ylabel() for axes in figure.axes] == ["momentum $p_{x}$", "momentum $p_{y}$"]
    first = planet[1][0].trajectory
    assert np.array_equal(np.asarray(figure.axes[1].lines[0].get_ydata()), first.momentum[:, 1])


def test_a_long_chain_is_drawn_by_some_of_its_masses_in_their_places():
    experiment, finished = made(CHAIN)
    lines = drawn(waterfall_figure(experiment, finished))
    masses = {
        int(m[1]): line for label, line in lines.items() if (m := re.match(r"_mass (\d+)", label))
    }
    assert len(masses) == 24
    assert {1, 40} <= set(masses)
    position = finished[0].trajectory.position
    lifted = masses[40]["y"] - 40
    moving = np.abs(position[:, 39]) > 1e-3
    factors = lifted[moving] / position[moving, 39]
    assert np.ptp(factors) < 1e-9
    # masses at rest at the start stand in their places
    assert all(line["y"][0] == index for index, line in masses.items())


def test_the_axis_of_a_chain_names_its_first_and_its_last_mass():
    experiment, finished = made(CHAIN.replace("masses: 40", "masses: 20"))
    axes = waterfall_figure(experiment, finished).axes[0]
    assert list(axes.get_yticks()) == [1, 5, 10, 15, 20]


def test_a_frame_is_drawn_above_the_ground_that_shakes_it():
    experiment, finished = made(FRAME)
    above, below = waterfall_figure(experiment, finished).axes
    assert "storey" in above.get_ylabel()
    time = finished[0].trajectory.time
    (ground,) = below.lines
    np.testing.assert_allclose(ground.get_ydata(), np.sin(3 * time), atol=1e-12)
    # nothing shakes: no panel
    still = FRAME.replace("ground_acceleration: sin(3*t)", "initial: {position: 0, velocity: 1}")
    assert len(waterfall_figure(*made(still)).axes) == 1


def test_a_string_is_drawn_in_its_shapes():
    experiment, finished = made(STRING)
    figure = waterfall_figure(experiment, finished)
    lines = drawn(figure)
    start = lines["_t = 0"]
    assert start["x"][-1] == 2.0
    assert start["y"][[0, -1]] == pytest.approx(0.0, abs=1e-12)
    # plucked at 0.3 of its length, as far as six modes can tell
    assert abs(start["x"][start["y"].argmax()] - 0.6) < 0.1
    # the bar: a round displacement that is not larger than the largest
    (bar,) = (
        float(text.get_text().strip("$").removeprefix("u = ")) for text in figure.axes[0].texts
    )
    assert bar in (0.05, 0.1)


@pytest.mark.few(4)
@pytest.mark.parametrize("masses", [1, 2, 5, 30])
@pytest.mark.parametrize("text", [CHAIN, FRAME, STRING])
def test_lines_of_a_waterfall_do_not_touch_and_use_their_room(text, masses):
    for key in ("masses: 40", "storeys: 3", "modes: 6"):
        text = text.replace(key, f"{key.split(':')[0]}: {masses}")
    axes = waterfall_figure(*made(text)).axes[0]
    found = {
        line.get_label(): line.get_ydata() for line in axes.lines if line.get_label()[:1] == "_"
    }
    found = {float(re.findall(r"[0-9.]+$", word)[0]): y for word, y in found.items() if " " in word}
    levels = np.array(sorted(found))[:, None]
    lines = np.array([found[level] for level in levels[:, 0]])
    spacing = np.diff(levels[:, 0]).min(initial=1e9 if len(found) > 1 else 1.0)
    room = (np.minimum(lines, levels)[1:] - np.maximum(lines, levels)[:-1]).min(initial=spacing)
    assert room > 0.1 * spacing
    assert np.abs(lines - levels).max() > 0.4 * spacing


def test_what_cannot_be_drawn_is_told_with_its_reason():
    text = OSCILLATOR.replace("store: {diagnostics: [energy-balance]}", "")
    figures_key = "figures: [balance, phase, path, waterfall]\n"
    bare, runs = made(text + figures_key)
    told = plotting.left_out([(bare, runs)])
    assert [line.split(" figure")[0] for line in told] == [
        "one: no balance",
        "one: no path",
        "one: no waterfall",
    ]
    assert plotting.figure_kinds(bare, runs) == ("phase",)


def test_bands_hold_all_members_where_their_times_differ_by_round_off():
    rng = np.random.default_rng(3)
    t, scales = np.linspace(0.0, 7.3, 60), np.linspace(1.0, 2.0, 12)
    times = [t * (1 + 2.3e-16 * rng.integers(-2, 3, t.size)) for _ in scales]
    curves = [
        Curve(x=x, y=scale * np.cos(t), label=f"{scale}")
        for x, scale in zip(times, scales, strict=True)
    ]
    figure = over_time([Panel(curves=tuple(curves), y="x", is_ensemble=True)], x="t")
    (median,) = [one for one in figure.axes[0].lines if one.get_label() == "median"]
    assert len(median.get_xdata()) == t.size
    assert np.allclose(median.get_ydata(), 1.5 * np.cos(t))


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("numbers", "scale"),
    [
        (np.linspace(0.1, 1.9, 19), "linear"),
        (np.geomspace(0.1, 1.9, 19), "log"),
        (np.geomspace(0.1, 0.9, 19), "linear"),
        (np.array([1.0, 100.0]), "linear"),
    ],
)
def test_colours_follow_the_spacing_of_what_is_swept(numbers, scale):
    t = np.linspace(0.0, 1.0, 5)
    curves = tuple(Curve(x=t, y=n * t, label=f"{n}", by=n) for n in numbers.tolist())
    figure = over_time([Panel(curves=curves, y="x")], x="t", bar="order")
    assert figure.axes[-1].get_xscale() == scale


@pytest.mark.few(1)
@pytest.mark.parametrize("periods", [2.3, 3.7, 5.1])
def test_a_loop_is_drawn_from_its_beginning_to_its_end(periods):
    text = (
        "name: loop\nproblem: {kind: material, law: {order: 0.5, coefficient: 2.0}, "
        f"displacement: t*sin(6.2831853*t), final_time: {periods}}}\nmethod: gauss3\n"
        "ladder: {steps: [400]}\nquantities: {force: force_1}\nfigures: [hysteresis]\n"
    )
    (outcome,) = fvi.run(parse_config(text, "loop"))
    loop = drawn(outcome.plot("hysteresis"))["last full cycle"]
    # both ends are at the deformation in the middle, between points of the motion
    whole = drawn(outcome.plot("hysteresis"))["whole motion"]
    middle = 0.5 * (whole["x"].min() + whole["x"].max())
    assert loop["x"][[0, -1]] == pytest.approx(middle, abs=0.02 * np.ptp(whole["x"]))
    assert not set(loop["x"][[0, -1]]) & set(whole["x"])


def test_the_damper_that_a_design_lacks_does_not_hide_the_others():
    text = (
        "name: two\nproblem: {kind: damped-oscillator, stiffness: 9, final_time: 4, exact: none, "
        "initial: {position: 1}, damping: [{order: 0.5, coefficient: 1}]}\nmethod: gauss3\n"
        "designs: {bare: {problem.damping.0.coefficient: 0}, damped: {}}\n"
        "ladder: {steps: [40]}\nquantities: {damper: force_1}\nfigures: [quantities]\n"
    )
    (outcome,) = fvi.run(parse_config(text, "two"))
    peak = max(one.trajectory.observed.extents["damper"].peak for one in outcome.finished)
    (axes,) = outcome.plot("quantities").axes
    assert np.abs(axes.get_ylim()).max() >= peak > 0.5
