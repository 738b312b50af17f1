"""``fvi stability`` as it is called."""

import csv
import dataclasses
import json

import pytest
from command_line import fvi

from fvi_cli.runner.request import ranges
from fvi_cli.studies import stability_study

CONFIG = """
problem:
  kind: bagley-torvik
  damping: [{order: 1.5, coefficient: 1.0}]
  final_time: 1.0
method: {bdf: [2, 6], sampling: nodes, degree: 1}
ladder: {steps: [16, 64]}
"""
REGION = """stability:
  observe: false
  region:
    orders: 1.5
    stiffness: {from: 0.01, to: 100, number: 4, spacing: log}
    damping: [0.01, 1.0, 100.0]
"""


def call(folder, *arguments, text=CONFIG):
    path = folder / "quick.yaml"
    path.write_text(text, encoding="utf-8")
    command = ["stability", str(path), "--output", str(folder / "out"), *arguments]
    return fvi(*command)


def rows(folder):
    with (folder / "out/tables/quick-stability.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_over_the_steps(tmp_path):
    result = call(tmp_path)
    assert result.exit_code == 0, result.output
    assert "4 of 4 runs as predicted" in result.output
    for name in ("tables/quick-stability.md", "tables/quick-stability.json"):
        assert (tmp_path / "out" / name).is_file()
    for form in ("pdf", "png", "json"):
        assert (tmp_path / f"out/figures/quick-stability.{form}").is_file()
    assert [row["predicted"] for row in rows(tmp_path)] == ["stable", "stable"] + ["unstable"] * 2
    assert {row["agrees"] for row in rows(tmp_path)} == {"yes"}
    # what is stored is up to date, until it is changed
    fresh = call(tmp_path, "--check")
    assert (fresh.exit_code, fresh.output) == (0, "up to date\n")
    table = tmp_path / "out/tables/quick-stability.csv"
    table.write_text(table.read_text().replace(",stable,0.0,", ",unstable,0.0,", 1))
    (tmp_path / "out/figures/quick-stability.png").unlink()
    stale = call(tmp_path, "--check")
    assert stale.exit_code == 3
    assert "predicted: 'unstable' is stored, now 'stable'" in stale.output
    assert "quick-stability.png: missing" in stale.output


def test_a_region_without_observation(tmp_path):
    result = call(tmp_path, text=CONFIG + REGION)
    assert result.exit_code == 0, result.output
    assert "Not observed." in result.output
    assert {row["observed"] for row in rows(tmp_path)} == {""}
    drawn = json.loads((tmp_path / "out/figures/quick-stability-region-1-5.json").read_text())
    assert len(drawn["panels"]) == 2
    content = json.loads((tmp_path / "out/tables/quick-stability.json").read_text())
    assert [row["points"] for row in content["sheets"]["regions"]["rows"]] == [12, 12]


@pytest.mark.parametrize("number", [1, 2])
def test_over_parameters(tmp_path, number):
    over = ("problem.stiffness=1:100:2:log", "problem.damping.0.coefficient=0.5:1:2")[:number]
    options = [part for text in over for part in ("--over", text)]
    result = call(tmp_path, "--no-observe", "--set", "ladder.steps=[16]", *options)
    assert result.exit_code == 0, result.output
    assert len(rows(tmp_path)) == 2 * (2, 4)[number - 1]
    assert rows(tmp_path)[0]["member"].startswith("stiffness = 1")
    assert (tmp_path / "out/figures/quick-stability.png").is_file()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--over", "problem.stiffness"], "must be KEY=FROM:TO:NUMBER"),
        (["--over", "problem.stiffness=1:2"], "must be KEY=FROM:TO:NUMBER"),
        (["--over", "problem.stifness=1:2:3"], "--over: problem.stifness: "),
        (["--over", "foo=1:2:3"], "--over: foo: only keys of the problem"),
        (["--over", "problem.stiffness=1:2:3:cubic"], "linear"),
        (["--over", "a=1:2:3", "--over", "b=1:2:3", "--over", "c=1:2:3"], "at most two"),
        (["--set", "stability.region.orders=2.5"], "between 0 and 2"),
        (["--set", "stability.region={orders: 1, stiffness: [2, 1], damping: 1}"], "increase"),
    ],
)
def test_mistakes_are_told(tmp_path, options, message):
    result = call(tmp_path, *options, text=CONFIG + REGION)
    assert result.exit_code == 2
    assert message in result.output
    assert not (tmp_path / "out").exists()


def test_a_derivative_has_no_stability(tmp_path):
    text = """
problem: {kind: fractional-derivative, order: 0.5, function: t**2, final_time: 1.0}
method: {bdf: 1, sampling: nodes}
ladder: {steps: [16]}
"""
    result = call(tmp_path, text=text)
    assert result.exit_code == 2
    assert "has no motion, and so no stability" in result.output


def test_what_is_observed_otherwise_is_told(tmp_path, monkeypatch):
    # the control: an observation that contradicts every prediction
    true = stability_study.observe

    def wrong(scene, method, n_steps):
        seen = true(scene, method, n_steps)
        return dataclasses.replace(
            seen, verdict="stable" if seen.verdict == "unstable" else "unstable"
        )

    monkeypatch.setattr(stability_study, "observe", wrong)
    result = call(tmp_path)
    assert result.exit_code == 3
    assert "0 of 4 runs as predicted" in result.output
    assert {row["agrees"] for row in rows(tmp_path)} == {"no"}


def test_ranges_become_a_sweep():
    assert ranges([]) == []
    assert ranges(["a.b=1:10:3:log"]) == ["sweep={a.b: {from: 1, to: 10, number: 3, spacing: log}}"]
