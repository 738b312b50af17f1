"""Units of axes, and what is a peak or a force."""

import re

import pytest
import yaml
from command_line import configuration
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from spread import spread

import fvi_cli as fvi

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
        more="figures: [path]\n",
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
    r"^order |^phase|^(mass|storey) \$i\$|degrees|%"
)


def read(text: str) -> dict[str, object]:
    content: dict[str, object] = yaml.safe_load(text)
    return content


@pytest.fixture(scope="module", params=spread(few=1, name=list(SCENES)).args[1])
def figures(request: pytest.FixtureRequest) -> dict[str, Figure]:
    """The figures of an experiment all of whose units are given."""
    text = SCENES[request.param]
    own = ", force_max: kN" * ("force_max" in text) + ", drift_1: mm" * ("drift_1" in text)
    drawn = fvi.figures(fvi.run(read(text + UNITS % own)))
    assert drawn
    return drawn


def panels(figure: Figure) -> list[Axes]:
    return [axes for axes in figure.axes if axes.axison]


def axes_of(figure: Figure) -> list[Axis]:
    return [axis for one in panels(figure) for axis in (one.xaxis, one.yaxis)]


def test_every_axis_of_a_quantity_has_its_unit(figures):
    for name, figure in figures.items():
        for axis in axes_of(figure):
            words = axis.get_label_text().replace("\n", " ")
            if words and not PURE.search(words):
                assert re.search(r"\((\$.*\$ )?(ms|mm|kN)|\(1/ms|\(.*kN", words), (name, words)


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
    peaks = [line for line in figure.axes[0].lines if line.get_label() == "peak"]
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
