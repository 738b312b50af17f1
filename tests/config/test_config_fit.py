"""``fit``: what is read, and what is refused at its line."""

from pathlib import Path

import pytest
from command_line import fvi

from fvi_cli.config import load_config, parse_config
from fvi_cli.errors import ConfigError

HEAD = """\
name: decay
problem:
  kind: damped-oscillator
  stiffness: 4.0
  damping: [{order: 0.5, coefficient: 0.4}]
  initial: {position: 1.0}
  final_time: 5.0
method: {rk: gauss, degree: 2}
ladder: {steps: [16]}
"""
DATA = "t,x,v\n" + "".join(f"{0.1 * k:.1f},{1 - 0.1 * k:.2f},{-0.1 * k:.2f}\n" for k in range(12))


FILES = {
    "decay.csv": DATA,
    "late.csv": "t,x\n0,1\n4,1\n6,1\n",
    "short.csv": "t,x\n0,1\n",
}


def read(folder: Path, fit: str):
    return parse_config(HEAD + fit, str(folder / "decay.yaml"), base=folder)


GOOD = """\
fit:
  data: {file: decay.csv, columns: {x: x, vx: v}}
  parameters:
    problem.stiffness: {from: 0}
    problem.damping.0.order: {start: 0.6}
  noise: 0.01
"""


def test_noise_relative_to_the_values_is_read_where_none_is_0(folder):
    relative = GOOD.replace("noise: 0.01", "noise: {relative: 0.02}")
    columns = relative.replace("{x: x, vx: v}", "{x: x}")
    text = "".join(line + "\n" for line in DATA.splitlines() if not line.startswith("1.0,"))
    (folder / "decay.csv").write_text(text)
    settings = read(folder, columns).experiments[0].fit
    assert (settings.relative, settings.deviation) == (0.02, None)
    with pytest.raises(ConfigError, match=r"fit\.noise: column v holds 0, where relative noise"):
        read(folder, relative)


def test_what_is_read(folder):
    (experiment,) = read(folder, GOOD).experiments
    settings = experiment.fit
    (data,) = settings.data
    assert data.name == "decay"
    assert [one.name for one in data.series] == ["x", "vx"]
    assert [one.quality for one in data.series] == ["length", "velocity"]
    assert data.size == 24
    assert data.last_time == 1.1
    (model,) = settings.models
    assert [one.key for one in model.parameters] == [
        "problem.stiffness",
        "problem.damping.0.order",
    ]
    stiffness, order = model.parameters
    assert (stiffness.start, stiffness.low) == (4.0, 0.0)
    assert (order.start, order.low, order.high) == (0.6, 1e-3, 1.999)
    assert settings.deviation == 0.01


def test_runs_do_not_depend_on_measurements(folder):
    assert "fit" not in read(folder, GOOD).resolved["experiments"][0]


def test_a_parameter_without_influence_is_told(folder):
    path = folder / "decay.yaml"
    path.write_text(
        HEAD.replace("coefficient: 0.4", "coefficient: 0.0")
        + "fit:\n  data: {file: decay.csv, columns: {x: x}}\n"
        "  parameters:\n    problem.stiffness: {}\n    problem.damping.0.order: {}\n"
    )
    done = fvi("fit", str(path), "-o", str(folder / "out"), code=1)
    assert "the data do not determine all parameters" in done.stderr
    assert load_config(path).experiments[0].fit is not None


def test_a_configuration_without_fit_is_told(folder):
    done = fvi("fit", "damped-oscillator", "-o", str(folder / "out"), code=2)
    assert "fit: missing; write it with data and parameters" in done.stderr
