"""Whatever the command line does is one call away, and costs nothing until it is asked for."""

from __future__ import annotations

import doctest
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import fvi_cli as fvi
from fvi_cli import api
from fvi_cli.cli import app
from fvi_cli.output import tables

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


def test_the_examples_are_true() -> None:
    failed, tried = doctest.testmod(api)
    assert tried >= 6
    assert failed == 0


def test_importing_the_package_loads_nothing() -> None:
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


def test_every_public_name_is_there_and_no_other() -> None:
    assert set(api.__all__) <= set(dir(fvi))
    for name in api.__all__:
        assert getattr(fvi, name) is getattr(api, name)
        assert getattr(fvi, name).__doc__ or name == "Source"
    with pytest.raises(AttributeError, match="has no attribute 'campagne'"):
        _ = fvi.campagne


def test_a_mapping_a_file_and_a_command_give_the_same(tmp_path: Path) -> None:
    import yaml

    file = tmp_path / "free.yaml"
    file.write_text(yaml.safe_dump(CONFIG), encoding="utf-8")
    (outcome,) = fvi.run(CONFIG)
    (again,) = fvi.run(file, output=tmp_path)
    errors = [finished.error for finished in outcome.finished]
    assert errors == [finished.error for finished in again.finished]
    assert fvi.order_tables([outcome])[0].cases[0].slope == pytest.approx(4, abs=0.2)
    done = CliRunner().invoke(app, ["convergence", str(file), "--output", str(tmp_path)])
    assert done.exit_code == 0
    made = fvi.order_tables([again])
    assert tables.compare_with_tables(tmp_path / "tables", "free", made) == []
    assert set(fvi.figures([again], name="free")) == {"free-convergence"}


def test_results_are_reused_recalled_and_exported(tmp_path: Path) -> None:
    (first,) = fvi.run(CONFIG, output=tmp_path)
    (second,) = fvi.run(CONFIG, output=tmp_path)
    (third,) = fvi.recall(tmp_path / "free.h5")
    seconds = [
        [finished.trajectory.stepping_seconds for finished in outcome.finished]
        for outcome in (first, second, third)
    ]
    assert seconds[0] == seconds[1] == seconds[2]  # read back, not measured again
    (fresh,) = fvi.run(CONFIG, output=tmp_path, fresh=True)
    assert [f.trajectory.stepping_seconds for f in fresh.finished] != seconds[0]
    written = fvi.export(tmp_path / "free.h5", "csv", tmp_path / "csv")
    assert len(written) == 4


def test_nothing_is_written_without_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    fvi.run(CONFIG)
    assert list(tmp_path.iterdir()) == []


def test_mistakes_are_exceptions_with_the_words_of_the_command_line() -> None:
    with pytest.raises(fvi.ConfigError, match="final_time"):
        fvi.load({**CONFIG, "problem": {**CONFIG["problem"], "final_time": -1}})
    with pytest.raises(fvi.RequestError, match="damped-oscilator"):
        fvi.load("damped-oscilator")
    with pytest.raises(fvi.RequestError, match="first loaded"):
        fvi.load(fvi.load(CONFIG), overrides=["name=other"])


def test_a_scene_is_integrated_without_any_configuration() -> None:
    scene = fvi.linear_oscillator(
        final_time=8.0,
        damping=[fvi.FractionalDamping(order=0.5, coefficient=0.7)],
        initial_position=1.0,
    )
    method = fvi.Method(cq="gauss", degree=3, start="series")
    coarse, fine = (fvi.integrate(scene, method, n) for n in (32, 64))
    assert np.abs(fine.position[::2] - coarse.position).max() < 1e-6
    assert fvi.predict_stability(scene, method, 32).verdict == "stable"
