"""Remarks on what is valid and surely not meant: each on its own mistake, and on nothing else."""

import numpy as np
import pytest
from command_line import configuration, fvi

from fvi_cli.config import parse_config, shipped_configs
from fvi_cli.runner.request import gather, plausibility_remarks, requested

BUILDING = """\
name: tower
problem:
  kind: frame
  masses: [220, 200, 180]
  stiffnesses: [3.2e5, 2.6e5, 1.7e5]
  dampers: [{name: low, storey: 1, law: zener, order: 0.6, time: 0.05, relaxed: 1e4, unrelaxed: 2e5}]
  ground_acceleration: {file: record.csv, column: a, scale: g}
  final_time: 4.0
  exact: none
method: gauss3
ladder: {steps: [200]}
quantities: [drift_1, acceleration_3, base_shear]
units: {time: s, length: m}
"""  # noqa: E501
TIMES = np.linspace(0.0, 4.0, 201)
RECORD = "t,a\n" + "".join(f"{t:.2f},{0.3 * np.sin(9 * t):.6f}\n" for t in TIMES)


def remarks(tmp_path, text):
    (tmp_path / "record.csv").write_text(RECORD, encoding="utf-8")
    loaded = parse_config(text, "tower.yaml", base=tmp_path)
    return plausibility_remarks(requested(loaded))


def test_what_is_meant_is_not_remarked_on(tmp_path):
    assert remarks(tmp_path, BUILDING) == []
    for request in gather(shipped_configs()):
        assert plausibility_remarks(request) == [], request.name


ODD = {
    "at rest": (
        ("{file: record.csv, column: a, scale: g}", "0"),
        "problem: it stays at rest: it begins in equilibrium, and no force acts",
    ),
    "in g without scale": ((", scale: g}", "}"), "which is 0.0306 g; for a record in g write"),
    "scaled twice": (("scale: g", "scale: 96.2"), "which is 2.94 g"),
    "in cm/s^2": (("scale: g", "scale: 961.7"), "which is 29.4 g; for a record in g write scale"),
    "kg with kN/m": (
        ("[220, 200, 180]", "[2.2e5, 2.0e5, 1.8e5]"),
        "problem: the first period is",
    ),
    "in milliseconds": (("time: 0.05", "time: 5.0e+6"), "damper low damps nothing: its loss"),
    "a law against the ground": (
        (
            "  final_time",
            "  damping: [{law: zener, order: 0.6, time: 0.05, relaxed: 1e4, unrelaxed: 2e5}]\n"
            "  final_time",
        ),
        "problem.damping.0: zener acts on every floor against the ground",
    ),
    "a shear without the ground": (
        ("[drift_1, acceleration_3, base_shear]", "{shear: 220*ax1 + 200*ax2 + 180*ax3}"),
        "quantities: shear: ax1 and the like are accelerations against the ground",
    ),
}


@pytest.mark.parametrize("mistake", [name for name in ODD if name != "scaled twice"])
def test_what_is_not_meant_is_named_with_its_number(tmp_path, mistake):
    (old, new), told = ODD[mistake]
    assert BUILDING.count(old) == 1
    (line,) = remarks(tmp_path, BUILDING.replace(old, new))
    assert line.startswith("tower: ")
    assert told in line


def test_numbers_at_the_edge_are_left_alone(tmp_path):
    (old, new), _ = ODD["scaled twice"]
    assert remarks(tmp_path, BUILDING.replace(old, new)) == []
    # other units of length have another g; of an unknown one nothing is said
    for unit, scale, count in (("mm", 9806.65, 0), ("mm", 9.80665e5, 1), ("yd", 9.80665e5, 0)):
        text = BUILDING.replace("length: m", f"length: {unit}").replace(
            "scale: g", f"scale: {scale}"
        )
        assert len(remarks(tmp_path, text)) == count


def test_problems_without_units_are_left_alone(tmp_path):
    for problem in (
        "kind: pendulum, initial: {position: 1e-9}, final_time: 1e9, exact: none",
        "kind: chain, initial: {velocity: 1e9}, stiffness: 1e-9, final_time: 1.0, exact: none",
        "kind: damped-oscillator, stiffness: 1e12, initial: {position: 1.0}, final_time: 1.0, "
        "exact: none, damping: [{law: maxwell, order: 0.5, time: 1e12, modulus: 1.0}]",
    ):
        assert remarks(tmp_path, configuration(problem)) == []


def test_members_that_begin_elsewhere_and_fits_are_not_at_rest(tmp_path):
    spring = "kind: damped-oscillator, final_time: 1.0, exact: none"
    (line,) = remarks(tmp_path, configuration(spring))
    assert "stays at rest" in line
    swept = configuration(spring, more="sweep: {problem.initial.position: [0.0, 1.0]}\n")
    assert remarks(tmp_path, swept) == []
    stiffer = configuration(spring, more="sweep: {problem.stiffness: [4.0, 1.0]}\n")
    assert len(remarks(tmp_path, stiffer)) == 1


def test_every_design_is_looked_at(tmp_path):
    weak = "{storey: 1, law: maxwell, order: 0.9, time: 1e9, modulus: 1e4}"
    text = f"{BUILDING}designs:\n  zener: {{}}\n  maxwell: {{problem.dampers: [{weak}]}}\n"
    (line,) = remarks(tmp_path, text)
    assert "damper 1 damps nothing" in line


def test_check_and_run_say_them_and_others_do_not(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = configuration("kind: damped-oscillator, final_time: 1.0, exact: none")
    (tmp_path / "made.yaml").write_text(text, encoding="utf-8")
    for command, is_said in (("check", True), ("run", True), ("modes", False)):
        output = fvi(command, "made.yaml", code=0).output
        assert ("stays at rest" in output) == is_said
    assert "stays at rest" not in fvi("check", "made.yaml", "-q", code=0).output


BENCH = """\
name: bench
problem:
  kind: material
  law: {order: 0.5, coefficient: 2.0}
  displacement: {file: bench.csv, column: u}
ladder: {steps: [40]}
fit:
  data: {file: bench.csv, columns: {force: f}}
  parameters: {problem.law.coefficient: {from: 0}}
"""


@pytest.mark.parametrize(
    ("change", "is_said"),
    [(("", ""), False), (("column: u", "column: f"), True), (("force: f", "force: minus"), True)],
)
def test_a_damper_that_gives_energy_is_remarked_on(tmp_path, caplog, change, is_said):
    t = np.linspace(0.0, 6.0, 121)
    rows = zip(t, np.sin(3 * t), np.sin(3 * t + 0.7) - 0.6 * np.exp(-2 * t), strict=True)
    lines = (f"{t:.3f},{u:.6f},{f:.6f},{-f:.6f}\n" for t, u, f in rows)
    (tmp_path / "bench.csv").write_text("t,u,f,minus\n" + "".join(lines), encoding="utf-8")
    text = BENCH.replace(*change) if change[0] else BENCH
    if change[0] == "column: u":
        text = text.replace("force: f", "force: u")
    parse_config(text, "bench.yaml", base=tmp_path)
    assert ("negative: is its sign" in caplog.text) == is_said
