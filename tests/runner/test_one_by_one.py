"""Sweeps whose members cannot be integrated in batches say why."""

import logging

import pytest

import fvi_cli as fvi

SWEEP = """
name: swept
experiments:
  - name: a
    problem: {{kind: damped-oscillator, damping: [{{order: 0.5, coefficient: 0.3}}],
              initial: {{position: 1, velocity: 0}}, final_time: 4, exact: none}}
    sweep: {{problem.stiffness: [1, 2, 3, 4, 5]}}
    method: {{rk: gauss, degree: 2}}
    ladder: {{steps: [16]}}
{more}
"""
ASKED = {
    "output": "    output: {step: 1}",
    "quantities": "    quantities: {far: x**2}",
    "events": "    events: {up: {when: x}}",
    "impacts": "    impacts: {floor: {when: x + 2}}\n    output: {step: 1}",
}


@pytest.mark.parametrize("key", [*ASKED, ""])
def test_what_keeps_members_apart_is_named(tmp_path, monkeypatch, caplog, key):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swept.yaml").write_text(SWEEP.format(more=ASKED.get(key, "")), encoding="utf-8")
    with caplog.at_level(logging.WARNING):
        fvi.run("swept.yaml")
    said = [one.getMessage() for one in caplog.records if "one by one" in one.getMessage()]
    if key == "impacts":
        assert said
        assert f"`{key}`" in said[0]
        assert "5 members" in said[0]
    else:
        assert not said
