"""``fvi stability`` as it is called."""

import dataclasses

from command_line import fvi, rows_of

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


def call(folder, *arguments, text=CONFIG):
    path = folder / "quick.yaml"
    path.write_text(text, encoding="utf-8")
    command = ["stability", str(path), "--output", str(folder / "out"), *arguments]
    return fvi(*command)


def rows(folder):
    return rows_of(folder / "out/tables/quick-stability.csv")


def test_what_is_observed_otherwise_is_told(tmp_path, monkeypatch):
    # the control: an observation that contradicts every prediction
    true = stability_study.observe_growth

    def wrong(scene, method, n_steps):
        seen = true(scene, method, n_steps)
        return dataclasses.replace(
            seen, verdict="stable" if seen.verdict == "unstable" else "unstable"
        )

    monkeypatch.setattr(stability_study, "observe_growth", wrong)
    result = call(tmp_path)
    assert result.exit_code == 3
    assert "0 of 4 runs as predicted" in result.output
    assert {row["agrees"] for row in rows(tmp_path)} == {"no"}


def test_ranges_become_a_sweep():
    assert ranges([]) == []
    assert ranges(["a.b=1:10:3:log"]) == ["sweep={a.b: {from: 1, to: 10, number: 3, spacing: log}}"]
