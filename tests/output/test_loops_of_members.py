"""Loops of members, whose dampers act on different deformations."""

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.config import parse_config
from fvi_cli.plotting.kinds.planes import hysteresis_figure
from fvi_cli.reports.kinds.quantities import quantities_report
from fvi_cli.reports.write import to_markdown
from fvi_cli.studies.loops import deformation_against

LAW = "law: zener, order: 0.6, time: 0.5, relaxed: 0.5, unrelaxed: 5.0"
REST = """  final_time: 12.0
  exact: none
ladder: {steps: [240]}
output: {step: 0.05}
quantities: {force: force_d}
figures: [hysteresis]
"""
FRAME = """name: a
problem:
  kind: frame
  masses: [1.2, 1.0, 0.8]
  stiffnesses: [12.0, 10.0, 8.0]
  ground_acceleration: sin(2*t)
  dampers: [{storey: %s, name: d, %s}]
"""
STRUCTURE = """name: a
problem:
  kind: structure
  mass: [[1.2, 0, 0], [0, 1, 0], [0, 0, 0.8]]
  stiffness: [[22, -10, 0], [-10, 18, -8], [0, -8, 8]]
  ground_acceleration: sin(2*t)
  damping:
    - {acts_on: %s, name: %s, %s}
    - {acts_on: [x2], name: %s, %s}
"""


def frames() -> tuple[str, list[str]]:
    storeys = np.random.default_rng(7).permutation(3) + 1
    whole = FRAME % (storeys[0], LAW) + REST
    sweep = f"sweep: {{problem.dampers.0.storey: {storeys.tolist()}}}\n"
    return whole + sweep, [FRAME % (one, LAW) + REST for one in storeys]


def structures() -> tuple[str, list[str]]:
    factors = np.random.default_rng(8).uniform(-2, 2, (3, 3)).round(3).tolist()
    acts = ["[" + " + ".join(f"({f})*x{k + 1}" for k, f in enumerate(one)) + "]" for one in factors]
    whole = STRUCTURE % (acts[0], "d", LAW, "e", LAW) + REST
    designs = "".join(
        f"  n{k}: {{problem.damping.0.acts_on: {one}}}\n" for k, one in enumerate(acts)
    )
    alone = [STRUCTURE % (one, "d", LAW, "e", LAW) + REST for one in acts]
    return whole + "designs:\n" + designs, alone


def loops_of(outcome):
    (sheet,) = (
        one for one in quantities_report("a", outcome.finished).sheets if one.name == "loops"
    )
    return sheet.rows


@pytest.mark.few(1)
@pytest.mark.parametrize("drawn", [frames, structures])
def test_a_member_has_the_loop_of_its_own_deformation(drawn):
    text, alone = drawn()
    (outcome,) = fvi.run(parse_config(text, "a"))
    experiment = outcome.finished[0].run.experiment
    loops = loops_of(outcome)
    (axes,) = hysteresis_figure(experiment, outcome.finished).axes
    lines = [line for line in axes.lines if len(line.get_xdata()) > 10]
    assert len(loops) == len(lines) == len(alone) == 3
    for found, line, one in zip(loops, lines, alone, strict=True):
        (by_itself,) = fvi.run(parse_config(one, "a"))
        (expected,) = loops_of(by_itself)
        for name in ("amplitude", "stiffness", "loss_factor", "work"):
            assert found[name] == pytest.approx(expected[name], rel=1e-6), name
        drawn_alone = deformation_against(by_itself.finished[0], "force")
        np.testing.assert_allclose(line.get_data(), drawn_alone, atol=1e-9)


def test_a_damper_without_force_has_no_loss_factor():
    bare = (
        "designs: {bare: {problem.damping.0.relaxed: 0, problem.damping.0.unrelaxed: 0}, a: {}}\n"
    )
    text = STRUCTURE % ("[x1]", "d", LAW, "e", LAW) + REST + bare
    (outcome,) = fvi.run(parse_config(text, "a"))
    report = quantities_report("a", outcome.finished)
    without, usual = loops_of(outcome)
    assert without["work"] == without["stiffness"] == 0.0 < without["amplitude"]
    assert np.isnan(without["loss_factor"])
    assert usual["loss_factor"] > 0.1
    assert "inf" not in to_markdown(report.blocks)


def test_the_force_of_a_given_motion_is_that_of_all_dampers_of_a_member():
    text = (
        "name: a\nproblem: {{kind: material, law: {}, displacement: '0.02*sin(6*t)', "
        "final_time: 3}}\nladder: {{steps: [120]}}\nmethod: {{rk: gauss, degree: 4}}\n"
    )
    rng = np.random.default_rng(9)
    terms = [f"{{order: {a:.2f}, coefficient: {b:.2f}}}" for a, b in rng.uniform(0.1, 0.9, (3, 2))]
    laws = [f"[{', '.join(terms[:count])}]" for count in (1, 2, 3)]
    swept = text.format(laws[0]) + f"sweep: {{problem.law: [{', '.join(laws)}]}}\n"
    (outcome,) = fvi.run(parse_config(swept, "a"))
    for found, law in zip(outcome.finished, laws, strict=True):
        (alone,) = fvi.run(parse_config(text.format(law), "a"))
        expected = alone.finished[0].trajectory.observed.quantities["force"]
        assert found.status == "ok"
        np.testing.assert_allclose(
            found.trajectory.observed.quantities["force"], expected, rtol=1e-9, atol=1e-12
        )


@pytest.mark.parametrize(("steps", "is_sparse"), [(60, True), (240, False)])
def test_a_loop_of_few_points_says_what_it_lacks(steps, is_sparse):
    law = {"law": "zener", "order": 0.55, "time": 0.2, "relaxed": 3.0e4, "unrelaxed": 2.0e5}
    bench = {"kind": "material", "law": law, "displacement": "0.01*sin(2*pi*t)", "final_time": 6.0}
    (outcome,) = fvi.run({"name": "a", "problem": bench, "ladder": {"steps": [steps]}})
    text = to_markdown(quantities_report("a", outcome.finished).blocks)
    assert ("A loop without numbers has too few stored points" in text) == is_sparse
