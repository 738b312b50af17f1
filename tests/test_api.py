"""Whatever the command line does is one call away, and costs nothing until it is asked for."""

import doctest
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from command_line import fvi as here
from letters import spring

import fvi_cli as fvi
from fvi_cli import api, reports
from fvi_cli.reports.kinds.orders import order_report

ROOT = Path(__file__).parents[1]

CONFIG = {
    "name": "free",
    "problem": {
        "kind": "bagley-torvik",
        "damping": [{"order": 0.5, "coefficient": 0.7}],
        "initial": {"position": 1.0, "velocity": 0.5},
        "final_time": 2.0,
    },
    "method": [{"rk": "gauss", "degree": 2}],
    "ladder": {"steps": [4, 8, 16, 32]},
}


def test_the_examples_are_true():
    failed, tried = doctest.testmod(api)
    assert tried >= 8
    assert failed == 0


@pytest.mark.processes
def test_importing_the_package_loads_nothing():
    program = "import sys, fvi_cli; print('numpy' in sys.modules); fvi_cli.integrate; print(1)"
    package = str(Path(fvi.__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={"PYTHONPATH": package, "PATH": ""},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["False", "1"]


def test_every_public_name_is_there_and_no_other():
    assert set(api.__all__) <= set(dir(fvi))
    for name in api.__all__:
        assert getattr(fvi, name) is getattr(api, name)
        assert getattr(fvi, name).__doc__ or name == "Source"
    # a part of the installed package of the same name would be found first
    package = ROOT / "fvi_cli"
    parts = {path.stem for path in (*package.glob("*.py"), *package.glob("*/"))}
    assert "runner" in parts
    assert not parts & set(api.__all__)


def test_a_mapping_a_file_and_a_command_give_the_same(tmp_path):
    file = tmp_path / "free.yaml"
    file.write_text(yaml.safe_dump(CONFIG), encoding="utf-8")
    (outcome,) = fvi.run(CONFIG)
    (again,) = fvi.run(file, output=tmp_path)
    errors = [finished.error for finished in outcome.finished]
    assert errors == [finished.error for finished in again.finished]
    assert fvi.order_tables([outcome])[0].cases[0].slope == pytest.approx(4, abs=0.2)
    done = here("convergence", str(file), "--output", str(tmp_path))
    assert done.exit_code == 0
    made = fvi.order_tables([again])
    assert reports.compare(tmp_path / "tables", order_report("free", made)) == []
    assert set(fvi.figures([again], name="free")) == {"free-convergence"}


def test_results_are_reused_recalled_and_exported(tmp_path):
    (first,) = fvi.run(CONFIG, output=tmp_path)
    (second,) = fvi.run(CONFIG, output=tmp_path)
    (third,) = fvi.recall(tmp_path / "free.h5")
    seconds = [
        [finished.trajectory.seconds for finished in outcome.finished]
        for outcome in (first, second, third)
    ]
    assert seconds[0] == seconds[1] == seconds[2]  # read back, not measured again
    (fresh,) = fvi.run(CONFIG, output=tmp_path, fresh=True)
    assert [f.trajectory.seconds for f in fresh.finished] != seconds[0]
    written = fvi.export(tmp_path / "free.h5", tmp_path / "csv")
    assert len(written) == 4


def test_a_result_file_tells_what_it_holds(tmp_path):
    fvi.run(CONFIG, output=tmp_path)
    stored = fvi.contents(tmp_path / "free.h5")
    assert [run.values["n_steps"] for run in stored.runs] == [4, 8, 16, 32]
    assert "Gauss2" in fvi.as_text(stored)


COMMANDS = {  # what each command prints under a heading, by the call that stands for it
    "convergence": lambda: fvi.order_tables(fvi.run(CONFIG)),
    "stability": lambda: fvi.stability(CONFIG),
    "modes": lambda: fvi.modes(CONFIG),
}


@pytest.mark.few(1)
@pytest.mark.parametrize("command", COMMANDS)
def test_calls_write_what_commands_write(command, tmp_path):
    config = tmp_path / "free.yaml"
    config.write_text(yaml.safe_dump(CONFIG), encoding="utf-8")
    done = here(command, str(config), "--output", str(tmp_path / "command"))
    assert done.exit_code == 0, done.output
    results = COMMANDS[command]()
    assert fvi.as_text(results) in done.stdout
    for path in fvi.write(results, tmp_path / "call"):
        other = tmp_path / "command" / path.relative_to(tmp_path / "call")
        assert other.is_file()
        if path.suffix == ".md":
            assert path.read_bytes() == other.read_bytes()


def test_outcomes_are_written_as_tables_and_figures(tmp_path):
    outcomes = fvi.run(CONFIG)
    written = fvi.write(outcomes, tmp_path, name="other")
    folders = [path.relative_to(tmp_path).parts[0] for path in written]
    assert sorted(set(folders)) == ["figures", "tables"]
    assert {path.stem for path in written} == {"other", "other-convergence"}


def test_stability_is_studied_over_a_parameter():
    tables = fvi.stability(
        {
            **CONFIG,
            "method": [{"bdf": 3, "sampling": "nodes"}],
            "sweep": {"problem.damping.0.coefficient": [1.0, 10.0, 100.0, 1000.0]},
        }
    )
    verdicts = {row.prediction.verdict for row in tables[0].rows}
    assert verdicts == {"stable", "unstable"}
    assert list(fvi.figures(tables))


def test_costs_are_measured():
    integer = {**CONFIG["problem"], "damping": [{"order": 1.0, "coefficient": 0.7}]}
    tables = fvi.cost({**CONFIG, "problem": integer, "ladder": {"steps": [4, 8]}})
    assert [row.finished.status for row in tables[0].rows] == ["ok", "ok"]
    assert "Gauss2" in fvi.as_text(tables)
    assert list(fvi.figures(tables)) == ["free-cost"]


def test_nothing_is_written_without_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fvi.run(CONFIG)
    assert list(tmp_path.iterdir()) == []


def test_a_scene_is_integrated_without_any_configuration():
    scene = spring((0.5, 0.7), T=8.0, x=1.0)
    method = fvi.Method(cq="gauss", degree=3, start="graded")
    coarse, fine = (fvi.integrate(scene, method, n) for n in (32, 64))
    assert np.abs(fine.position[::2] - coarse.position).max() < 1e-6
    assert fvi.predict_stability(scene, method, 32).verdict == "stable"


def test_a_scene_is_integrated_by_the_name_of_a_method():
    scene = fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian="vx**2/2 - x**2/2",
        final_time=2.0,
        damping=[fvi.FractionalDamping(order=0.5, coefficient=0.3)],
        initial_position=[1.0],
        initial_velocity=[0.0],
    )
    wanted = True
    named = fvi.integrate(scene, "gauss3", 16, diagnostics=wanted)
    given = fvi.integrate(scene, fvi.Method(cq="gauss", degree=3, start="graded"), 16)
    np.testing.assert_allclose(named.position, given.position, atol=1e-14)
    assert named.diagnostics is not None
    (member,) = fvi.integrate_members([scene], "gauss3", 16)
    np.testing.assert_allclose(member.position, given.position, atol=1e-14)
    assert fvi.predict_stability(scene, "gauss3", 16).verdict == "stable"


def test_arrays_stand_for_lists_and_what_cannot_be_written_is_told():
    arrays = {
        "kind": "bagley-torvik",
        "mass": np.eye(2),
        "stiffness": np.array([[2, -1], [-1, 2]]),
        "damping": [{"order": np.float64(0.5), "coefficient": 1.0}],
        "initial": {"position": np.array([1.0, 0.0]), "velocity": 0.0},
        "final_time": 1.0,
    }
    lists = {
        **arrays,
        "mass": [[1, 0], [0, 1]],
        "stiffness": [[2, -1], [-1, 2]],
        "damping": [{"order": 0.5, "coefficient": 1.0}],
        "initial": {"position": [1.0, 0.0], "velocity": 0.0},
    }
    one, other = (fvi.run({**CONFIG, "problem": problem})[0] for problem in (arrays, lists))
    assert [f.error for f in one.finished] == [f.error for f in other.finished]
