"""Figures: what they draw is what the runs say, in the right places, with the right units."""

import dataclasses
import re
from collections.abc import Mapping

import numpy as np
import pytest
import yaml
from command_line import configuration
from made_runs import LADDER, NODES, made_study
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from spread import spread

import fvi_cli as fvi
from fvi_cli import plotting
from fvi_cli.errors import RequestError
from fvi_cli.integrator.method import Method
from fvi_cli.plotting.kinds.motions import drawn_motion, drawn_times, drawn_velocity
from fvi_cli.plotting.kinds.spectra import modes_figure
from fvi_cli.plotting.style import method_words

UNITS = "units: {time: ms, length: mm, force: kN%s}\n"
OSCILLATOR = (
    "kind: damped-oscillator, damping: [{order: 0.5, coefficient: 0.3}], "
    "forcing: cos(1.2*t), final_time: 4.0"
)
GROUND = "ground_acceleration: sin(3*t), final_time: 2.0"
FRAME = (
    "kind: frame, storeys: 2, mass: 2.0, stiffness: 40.0, "
    f"dampers: [{{order: 0.5, coefficient: 1.0}}], {GROUND}"
)
PLANET = "kind: kepler, initial: {position: [1.0, 0.0], velocity: [0.0, 1.1]}, final_time: 8.0"
SWEPT = "sweep: {problem.damping.0.coefficient: {from: 0.1, to: 0.9, number: %d}}\n"
SCENES = {
    "motion": configuration(
        OSCILLATOR,
        name="motion",
        method="{rk: gauss, degree: [2, 3]}",
        steps="32, 64",
        more="store: {diagnostics: [energy-balance]}\n"
        "figures: [trajectory, energy, balance, phase]\n",
    ),
    "ladder": configuration(OSCILLATOR, name="ladder", steps="16, 32, 64"),
    "l2": configuration(OSCILLATOR, name="l2", steps="16, 32, 64", more="report: {norm: l2}\n"),
    "planet": configuration(PLANET, name="planet", steps="64", more="figures: [path]\n"),
    "building": configuration(
        FRAME,
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
            "figures: [convergence, trajectory, quantities, section, {ensemble: [x]}, "
            "{plot: peak_force_max, against: problem.damping.0.coefficient}]\n",
        )
        for count in (3, 8)
    },
}
PURE = re.compile(r"^order |^phase|^(mass|storey|coordinate)$|degrees|%")  # numbers without a unit


def run_of(text: str) -> fvi.Outcome:
    content: Mapping[str, object] = yaml.safe_load(text)
    (outcome,) = fvi.run(content)
    return outcome


def panels(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.axison]


def drawn(axes: Axes) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Abscissas and ordinates of the lines of a panel by label."""
    return {str(one.get_label()): np.array(one.get_data(), dtype=float) for one in axes.lines}


@pytest.mark.parametrize("name", spread(few=3, name=list(SCENES)).args[1])
def test_every_axis_of_a_quantity_has_its_unit(name):
    own = ", force_max: kN" * ("force_max" in SCENES[name]) + ", drift_1: mm" * (name == "building")
    outcome = run_of(SCENES[name] + UNITS % own)
    figures = fvi.figures(outcome)
    wanted = max(len(outcome.experiment.figures), 1)
    assert len(figures) == wanted
    for title, figure in figures.items():
        for axes in panels(figure):
            for words in (axes.get_xlabel(), axes.get_ylabel()):
                words = words.replace("\n", " ").replace("\N{NO-BREAK SPACE}", " ")
                if words and not PURE.search(words):
                    assert re.search(r"\((\$.*\$ )?(ms|mm|kN)|\(1/ms|\(.*kN", words), (title, words)


def test_a_ladder_has_every_error_and_marks_every_lost_run():
    def status(run):
        return "diverged" if run.method == NODES[2] and run.n_steps > 32 else "ok"

    experiment, finished = made_study(status=status)
    axes = plotting.convergence_figure([(experiment, finished)]).axes[0]
    lines = [line for line in axes.lines if len(line.get_xdata()) == len(LADDER)]
    for line, method in zip(lines, NODES, strict=True):
        runs = sorted((f for f in finished if f.run.method == method), key=lambda f: -f.run.n_steps)
        errors = [one.error if one.status == "ok" else np.nan for one in runs]
        np.testing.assert_array_equal(line.get_ydata(), errors)
        np.testing.assert_array_equal(line.get_xdata(), [one.run.step_size for one in runs])
    (lost,) = (line for line in axes.lines if line.get_markerfacecolor() == "none")
    gone = [one.run.step_size for one in finished if one.status == "diverged"]
    assert sorted(lost.get_xdata()) == sorted(gone)


@pytest.mark.parametrize("claims", [{}, {"bdf2": 1.8}])
def test_slopes_are_those_of_theory_and_of_the_source(claims):
    axes = plotting.convergence_figure([made_study(claims=claims)]).axes[0]
    rays = [line for line in axes.lines if line.get_transform() is axes.transAxes]
    (left, right), (low, high) = np.log10(axes.get_xlim()), np.log10(axes.get_ylim())
    slopes = [
        np.diff(one.get_ydata())[0] / np.diff(one.get_xdata())[0] * (high - low) / (right - left)
        for one in rays
    ]
    assert slopes == pytest.approx(sorted({1.0, 2.0, *claims.values()}))
    assert sum(one.get_linestyle() == "--" for one in rays) == len(claims)


def test_methods_look_different_and_each_the_same_everywhere():
    methods = [
        *(Method(cq=f"bdf{p}", degree=s) for p in range(1, 7) for s in (1, 2)),
        *(Method(cq="gauss", degree=s) for s in range(1, 5)),
    ]
    looks = {case: words["look"] for case, words in method_words(methods).items()}
    assert len({(one.colour, one.marker, str(one.dashes)) for one in looks.values()}) == 16
    case = methods[-1].case
    assert method_words([methods[-1], methods[0]])[case]["look"] == looks[case]


BALL = {
    "name": "ball",
    "problem": {
        "kind": "lagrangian",
        "coordinates": ["x"],
        "lagrangian": "vx**2/2 - x",
        "initial": {"position": 1.0},
        "final_time": 6.0,
        "exact": "none",
    },
    "impacts": {"floor": {"when": "x", "restitution": 0.8}},
    "method": {"rk": "gauss", "degree": 2},
    "ladder": {"steps": [10]},
}


def test_motions_are_the_polynomials_of_their_steps_and_bounces_reach_the_floor():
    experiment = fvi.load(BALL).experiments[0]
    (run,) = experiment.runs()
    motion = fvi.integrate(run.scene, run.method, 10, with_steps=True, impacts=BALL["impacts"])
    (outcome,) = fvi.run(BALL)
    item = dataclasses.replace(outcome.finished[0], trajectory=motion)
    times, position = drawn_motion(item)
    np.testing.assert_allclose(position, motion(times), rtol=1e-14)
    assert times.size > max(600, 20 * motion.steps.n_steps)
    floors = np.isin(times, motion.observed.events["floor"].time)
    assert floors.sum() >= 2
    assert np.abs(position[floors]).max() < 1e-12
    assert drawn_velocity(item).shape == position.shape
    assert np.array_equal(drawn_times(outcome.finished[0])[[0, -1]], [0.0, 6.0])


def test_runs_for_a_tolerance_are_drawn_within_their_steps_also_from_a_file(tmp_path):
    text = configuration(OSCILLATOR, name="few", method="", more="quantities: {force: force_1}\n")
    text = text.replace("ladder: {steps: [8, 16]}", "accuracy: {tolerance: 1.0e-8}")
    config = fvi.load(yaml.safe_load(text))
    fvi.run(config, output=tmp_path)
    (stored,) = fvi.recall(tmp_path / "few.h5")
    (item,) = stored.finished
    assert item.trajectory.time.size < 60
    scene, steps = item.run.scene, item.trajectory.steps
    again = fvi.integrate(scene, item.run.method, steps.mesh(scene.break_points), with_steps=True)
    for figure in ("trajectory", "quantities"):
        (axes,) = stored.plot(figure).axes
        assert max(len(line.get_xdata()) for line in axes.lines) > 600
    times, position = drawn_motion(item)
    np.testing.assert_allclose(position, again(times), atol=1e-13)
    np.testing.assert_allclose(drawn_velocity(item), again.velocity(times), atol=1e-12)


@pytest.mark.parametrize("scene", ["3 members", "bdf"])
def test_runs_without_steps_are_drawn_as_cubic_polynomials(scene, tmp_path):
    text = SCENES.get(scene) or configuration(
        OSCILLATOR, name="bdf", method="[bdf3]", steps="64", more="figures: [phase]\n"
    )
    outcome = run_of(text)
    (fine,) = fvi.run({**yaml.safe_load(text), "ladder": {"steps": [512]}})
    item, other = outcome.finished[-1], fine.finished[-1]
    times, position = drawn_motion(item)
    assert times.size > max(600, 20 * item.run.n_steps)
    every = times.size // item.run.n_steps
    np.testing.assert_allclose(position[::every], item.trajectory.position, atol=1e-14)
    exact = np.interp(times, *(np.ravel(one) for one in drawn_motion(other)))
    assert np.abs(position[:, 0] - exact).max() < 1e-3 * np.ptp(exact)
    rates = np.gradient(position[:, 0], times)
    assert np.abs(drawn_velocity(item)[:, 0] - rates).max() < 0.02 * np.ptp(rates)


def test_balance_shows_energy_works_and_a_sum_that_does_not_move():
    outcome = run_of(SCENES["motion"])
    figure = outcome.plot("balance")
    lines, best = drawn(figure.axes[0]), outcome.finished[-1].trajectory
    np.testing.assert_allclose(lines["energy $E$"][1], best.energy, atol=1e-12)
    assert np.ptp(lines["$E+W_d-W_f$"][1]) < 1e-9 < np.ptp(best.energy)
    assert all(np.abs(line[1]).max() < 1e-14 for line in drawn(figure.axes[1]).values())


def test_a_waterfall_lifts_every_line_by_one_factor():
    outcome = run_of(SCENES["building"])
    above, below = outcome.plot("waterfall").axes
    position = outcome.finished[0].trajectory.position
    moved = [line for line in above.lines if len(line.get_xdata()) > 2]
    lifted = {round(line.get_ydata()[0]): line.get_ydata() for line in moved}
    factors = [
        (y - k)[1:] / position[1:, k - 1] for k, y in lifted.items() if len(y) == len(position)
    ]
    assert len(lifted) == 2
    assert all(np.ptp(one) < 1e-6 * one.mean() for one in factors)
    (ground,) = (line for line in below.lines if len(line.get_xdata()) > 2)
    np.testing.assert_allclose(ground.get_ydata(), np.sin(3 * ground.get_xdata()), atol=1e-12)


def test_a_path_has_its_start_and_end_and_the_name_of_its_method_above():
    outcome = run_of(SCENES["planet"])
    figure = outcome.plot("path")
    (axes,), (start, end) = figure.axes, outcome.finished[0].trajectory.position[[0, -1]]
    found = {words.get_text(): words.xy for words in axes.texts}
    assert found["start"] == pytest.approx(start)
    assert found["end"] == pytest.approx(end)
    assert axes.get_title(loc="left") == "Gauss2, $h=0.125$"
    assert not figure.legends


def test_the_largest_peak_of_a_panel_has_its_number():
    outcome = run_of(SCENES["building"])
    figure = outcome.plot("quantities")
    for axes, extent in zip(
        figure.axes, outcome.finished[0].trajectory.observed.extents.values(), strict=True
    ):
        (number,) = axes.texts
        value = float(number.get_text().replace("\N{MINUS SIGN}", "-"))
        assert abs(value) == pytest.approx(extent.peak, rel=5e-3)
        assert number.xy[0] == extent.peak_time


def test_response_spectra_are_largest_displacements_over_periods():
    outcome = run_of(SCENES["spectrum"])
    upper, lower = outcome.plot("spectrum").axes
    largest = {
        tuple(one.run.member.values.values()): np.abs(one.trajectory.position).max()
        for one in outcome.finished
    }
    for line, other, ratio in zip(upper.lines, lower.lines, (0.1, 0.2), strict=True):
        period, size = np.array(line.get_data())
        assert period == pytest.approx(2 * np.pi / np.array([3.0, 2.0]))
        assert list(size) == [largest[stiffness, ratio] for stiffness in (9.0, 4.0)]
        assert other.get_ydata() == pytest.approx((2 * np.pi / period) ** 2 * size)


def test_peaks_and_events_are_drawn_against_the_swept_key():
    key = "problem.damping.0.coefficient"
    outcome = run_of(SCENES["8 members"])
    finest = [one for one in outcome.finished if one.run.n_steps == 64]
    (line,) = outcome.plot({"plot": "peak_force_max", "against": key}).axes[0].lines
    swept = [one.run.member.values[key] for one in finest]
    peaks = [one.trajectory.observed.extents["force_max"].peak for one in finest]
    np.testing.assert_array_equal(line.get_data(), [swept, peaks])
    (dots,) = outcome.plot({"plot": "period", "against": key}).axes[0].lines
    events = [one.trajectory.observed.events["period"].position[:, 0] for one in finest]
    np.testing.assert_array_equal(dots.get_ydata(), np.concatenate(events))
    (mean,) = outcome.plot({"ensemble": ["x"]}).axes[0].lines
    motions = [one.trajectory.position[:, 0] for one in finest]
    np.testing.assert_allclose(mean.get_ydata(), np.mean(motions, axis=0), rtol=1e-12)


@pytest.mark.parametrize(
    ("scene", "figure", "words"),
    [
        ("planet", "balance", "store: {diagnostics: [energy-balance]}"),
        ("planet", "error", "no exact solution is known"),
        ("planet", "waterfall", "made for chain, frame"),
        ("motion", "path", "one coordinate only"),
        ("motion", "spectrum", "sweep over stiffness or mass"),
        ("3 members", "spectrum", "sweep over stiffness or mass"),
    ],
)
def test_a_figure_of_nothing_says_in_one_line_why(scene, figure, words):
    outcome = run_of(SCENES[scene])
    with pytest.raises(fvi.RequestError, match=re.escape(words)) as error:
        outcome.plot(figure)
    assert "\n" not in str(error.value)


def test_files_are_complete_and_the_same_every_time(tmp_path):
    for folder in ("one", "two"):
        figure = plotting.convergence_figure([made_study()])
        plotting.save_figure(figure, tmp_path / folder, "made", ("png", "pdf", "svg"))
    for kind in ("png", "pdf", "svg"):
        first, second = ((tmp_path / f / f"made.{kind}").read_bytes() for f in ("one", "two"))
        assert first == second
    with pytest.raises(RequestError, match="format"):
        plotting.save_figure(figure, tmp_path, "made", ("docx",))


def test_any_style_of_matplotlib_may_be_used():
    with plotting.styled("dark_background"):
        dark = plotting.interpolation_figure()
    assert dark.get_facecolor()[:3] == (0.0, 0.0, 0.0)
    assert plotting.interpolation_figure().get_facecolor()[:3] == (1.0, 1.0, 1.0)
    with pytest.raises(RequestError, match="nowhere"), plotting.styled("nowhere"):
        pass


def test_modes_are_poles_above_and_damping_ratios_on_stems_below():
    (table,) = fvi.modes(yaml.safe_load(SCENES["building"]))
    above, below = modes_figure([table]).axes
    poles = np.array([mode.frequency for mode in table.modes])
    np.testing.assert_allclose(above.lines[0].get_data(), [poles.real, poles.imag / (2 * np.pi)])
    ratios = [100 * mode.damping_ratio for mode in table.modes]
    points, stems = (np.ravel(line.get_ydata()) for line in below.lines[1:])
    np.testing.assert_array_equal(points, ratios)
    np.testing.assert_array_equal(stems[1::3], ratios)
    assert [words.get_text() for words in below.texts] == ["1", "2"]
