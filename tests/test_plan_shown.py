"""Dry runs, and runs for which there is no memory."""

from command_line import configuration, fvi

SCENE = configuration(
    "kind: bagley-torvik, damping: [{order: 0.5, coefficient: 1.0}], "
    "initial: {position: 1.0, velocity: 0.0}, final_time: 4.0",
    name="planned",
    method="{rk: gauss, degree: [2, 3]}",
    steps="64, 128",
)


FILES = {"planned.yaml": SCENE}


def test_a_run_for_which_there_is_no_memory_is_refused_with_the_number(folder, monkeypatch):
    (folder / "planned.yaml").write_text(SCENE.replace("[64, 128]", "[4096]"))
    module = "fvi_cli.config.machine.machine_bytes"
    # twice time, energy, position and momentum of every point
    monkeypatch.setattr(module, lambda: 8 * 8 * 4096 - 1)
    result = fvi("run", "planned.yaml", code=2)
    assert "planned.yaml:4:18: ladder.steps.0: 4096 steps need about 0.000262" in result.stderr
    assert "this machine has 0.000262 GB" in result.stderr
    assert not (folder / "results").exists()
    # without diagnostics there is room; a mistake elsewhere is reported first
    monkeypatch.setattr(module, lambda: 8 * 8 * 4096)
    fvi("check", "planned.yaml", code=0)
    diagnosed = ("check", "planned.yaml", "--set", "store.diagnostics=[energy-balance]")
    assert "ladder.steps.0: 4096 steps need about" in fvi(*diagnosed, code=2).stderr
    other = fvi(*diagnosed, "--set", "claims={bdf2: 2}", code=2).stderr
    assert "claims" in other
    assert "steps need" not in other
