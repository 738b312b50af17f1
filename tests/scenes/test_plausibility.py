"""Remarks on what is valid and surely not meant are told in time; they stand in tests/mistakes."""

import numpy as np
import pytest
from command_line import configuration, fvi

from fvi_cli.config import parse_config, shipped_configs
from fvi_cli.runner.request import gather, plausibility_remarks


@pytest.mark.few(10)
@pytest.mark.parametrize("name", shipped_configs())
def test_what_is_shipped_is_not_remarked_on(name):
    for request in gather([name]):
        assert plausibility_remarks(request) == []


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
