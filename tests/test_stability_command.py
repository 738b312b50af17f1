"""``fvi stability`` as it is called."""

from command_line import fvi, rows_of

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


def test_every_method_and_step_is_told(tmp_path):
    result = call(tmp_path)
    assert result.exit_code == 0
    assert [row["predicted"] for row in rows(tmp_path)] == [
        "stable",
        "stable",
        "unstable",
        "unstable",
    ]
    assert "UNSTABLE" in result.output


def test_members_of_a_sweep_are_told_too(tmp_path):
    sweep = "sweep: {problem.damping.0.coefficient: [1e-9, 1.0]}\n"
    assert call(tmp_path, text=CONFIG + sweep).exit_code == 0
    assert len(rows(tmp_path)) == 8
    assert (tmp_path / "out/figures/quick-stability.png").exists()


def test_a_run_says_what_is_predicted_once_and_of_how_many_steps(tmp_path):
    path = tmp_path / "quick.yaml"
    path.write_text(CONFIG, encoding="utf-8")
    result = fvi("run", str(path), "--output", str(tmp_path / "out"))
    (line,) = (line for line in result.stderr.splitlines() if "predicted" in line)
    assert "N=16: predicted unstable: a mode grows by a factor" in line
    assert line.endswith(" per step (and 1 more run)")
