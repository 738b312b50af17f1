"""The plan on the command line: dry runs, stored files, and runs for which there is no memory."""

import json
import re
from pathlib import Path

import h5py
import pytest
from command_line import configuration, fvi

SCENE = configuration(
    "kind: bagley-torvik, damping: [{order: 0.5, coefficient: 1.0}], "
    "initial: {position: 1.0, velocity: 0.0}, final_time: 4.0",
    name="planned",
    method="{rk: gauss, degree: [2, 3]}",
    steps="64, 128",
)


FILES = {"planned.yaml": SCENE}


def test_a_dry_run_tells_what_every_run_takes(folder):
    header, *rows = fvi("run", "planned.yaml", "--dry-run").stdout.splitlines()
    place = header.index("operations")
    told = [int(row[place:].split()[0]) for row in rows]
    assert all("about" in row and " MB " in row for row in rows)
    fvi("run", "planned.yaml", "-q")

    with h5py.File(Path("results/planned.h5")) as file:
        counted = [
            int(run.attrs["history_operations"])
            for case in file["planned"].values()
            for name, run in case.items()
            if re.fullmatch(r"n\d+", name)
        ]
    assert sorted(told) == sorted(counted)


def test_machinery_is_printed_when_more_is_asked_for(folder):
    brief = fvi("run", "planned.yaml", "--dry-run").stdout
    full = fvi("run", "planned.yaml", "--dry-run", "-v").stdout
    assert len(full.splitlines()) > len(brief.splitlines()) + 20
    for head in ("steps: blocks of", "exponentials in place of the past", "start: ", "forcing: "):
        assert head in full
        assert head not in brief
    fvi("run", "planned.yaml", "-q")
    stored = fvi("show", "results/planned.h5", "-v").stdout
    assert "planned Gauss2, graded, N=64\n  effects: inertia (1 dof)" in stored
    assert "steps: " not in fvi("show", "results/planned.h5").stdout


def test_a_run_for_which_there_is_no_memory_is_refused_with_the_number(folder, monkeypatch):
    """The dense matrices of Gauss3 take more than those of Gauss2; the limit lies between."""
    (folder / "planned.yaml").write_text(SCENE.replace("[64, 128]", "[4096]"))
    module = "fvi_cli.config.memory.machine_bytes"
    monkeypatch.setattr(module, lambda: 3_900_000)
    result = fvi("run", "planned.yaml", code=2)
    assert "planned.yaml:4:18: ladder.steps.0: 4096 steps need about 0.00457" in result.stderr
    assert "this machine has 0.0039 GB" in result.stderr
    assert not (folder / "results").exists()
    fvi("check", "planned.yaml", "--set", "method.degree=2", code=0)
    # without diagnostics there is room; a mistake elsewhere is reported first
    monkeypatch.setattr(module, lambda: 5_000_000)
    fvi("check", "planned.yaml", code=0)
    diagnosed = ("check", "planned.yaml", "--set", "store.diagnostics=[energy-balance]")
    assert "ladder.steps.0: 4096 steps need about" in fvi(*diagnosed, code=2).stderr
    other = fvi(*diagnosed, "--set", "claims={bdf2: 2}", code=2).stderr
    assert "claims" in other
    assert "steps need" not in other


def test_a_dry_run_of_a_sweep_tells_what_members_take_together(folder):
    """The memory of each takes as many operations as alone."""
    sweep = "sweep: {problem.stiffness: {from: 1, to: 5, number: 256}}\n"
    alone = SCENE.replace("[64, 128]", "[1030]").replace(
        "{rk: gauss, degree: [2, 3]}", "{bdf: 2, sampling: nodes}"
    )
    (folder / "planned.yaml").write_text(alone + sweep)
    (folder / "alone.yaml").write_text(alone.replace("name: planned", "name: alone"))
    header, row = fvi("run", "planned.yaml", "--dry-run").stdout.splitlines()
    told = int(row[header.index("operations") :].split()[0])
    assert "compute 256 members" in row
    (single,) = fvi("run", "alone.yaml", "--dry-run").stdout.splitlines()[1:]
    assert f" {told} " in single
    whole = fvi("run", "planned.yaml", "--dry-run", "-v").stdout
    assert "16 members together" in whole
    assert f"operations of the history: {told:,}\n" in whole
    # a part has the same members together
    fvi("run", "planned.yaml", "-q", "--shard", "1/16")
    (part,) = Path("results").rglob("planned*.h5")
    with h5py.File(part) as file:
        (case,) = file["planned"].values()
        assert case["n001030"]["history_operations"][:].tolist() == [told] * 16


@pytest.mark.parametrize("members", [1, 40])
def test_a_dry_run_says_the_same_as_json_and_as_text(folder, members):
    sweep = f"sweep: {{problem.stiffness: {{from: 1, to: 5, number: {members}}}}}\n"
    (folder / "planned.yaml").write_text(SCENE + (sweep if members > 1 else ""))
    header, *rows = fvi("run", "planned.yaml", "--dry-run").stdout.splitlines()
    runs = json.loads(fvi("run", "planned.yaml", "--dry-run", "--json").stdout)["runs"]
    assert len(runs) == members * len(rows)
    for row, run in zip(rows, runs[::members], strict=True):
        words = row[header.index("operations") :].split()
        assert int(words[0]) == run["history_operations"]
        assert float(words[1]) == pytest.approx(run["memory_bytes"] / 1e6, rel=5e-3)
