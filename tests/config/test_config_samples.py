"""Forces from CSV files: how they are read, what is kept of them, and every mistake."""

import json

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.config import load_config, parse_config
from fvi_cli.errors import ConfigError
from fvi_cli.scenes.records import inputs
from fvi_cli.scenes.records.inputs import kept_numbers
from fvi_cli.scenes.registry import build_problem
from fvi_cli.storage.identity import identity_of

CSV = "t,a,b\n0,0,1\n0.5,1,2\n1.0,-1e-1,3\n2,4,4\n"
CONFIG = """\
name: shaken
problem:
  kind: bagley-torvik
  damping: [{order: 0.5, coefficient: 1.0}]
  forcing: {file: quake.csv, column: a}
  final_time: 2.0
ladder: {steps: [8]}
"""


FILES = {"quake.csv": CSV, "shaken.yaml": CONFIG}


def load(folder, text=CONFIG, overrides=()):
    (folder / "shaken.yaml").write_text(text)
    return load_config(folder / "shaken.yaml", overrides=overrides)


def forcing_of(config):
    return config.experiments[0].problem.scene.forcing


def test_a_relative_path_begins_at_the_configuration(folder, monkeypatch):
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    forcing = forcing_of(load(folder))
    time = np.array([0.0, 0.25, 1.0, 1.5])
    np.testing.assert_allclose(forcing(time)[:, 0], [0.0, 0.5, -0.1, 1.95])


def test_the_resolved_configuration_needs_the_file_no_more(folder):
    config = load(folder)
    described = config.experiments[0].problem_specification["forcing"]
    assert described["interpolation"] == "linear"
    time, values = kept_numbers(described["digest"]).T
    assert time.tolist() == [0.0, 0.5, 1.0, 2.0]
    assert values.tolist() == [0.0, 1.0, -0.1, 4.0]
    (folder / "quake.csv").unlink()
    again = parse_config(json.dumps(config.resolved), "stored")
    assert again.resolved == config.resolved
    time = np.linspace(0, 2, 33)
    np.testing.assert_array_equal(forcing_of(again)(time), forcing_of(config)(time))
    # so does what a process gets
    rebuilt = build_problem(config.experiments[0].problem_specification)
    np.testing.assert_array_equal(rebuilt.scene.forcing(time), forcing_of(config)(time))


def test_other_numbers_in_the_file_are_another_run_and_another_name_is_not(folder):
    def identity(name="quake.csv"):
        changes = [f"problem.forcing.file={name}"]
        return identity_of(load(folder, overrides=changes).experiments[0].runs()[0])

    before = identity()
    assert identity() == before
    (folder / "moved.csv").write_text(CSV)
    assert identity("moved.csv") == before
    (folder / "quake.csv").write_text(CSV.replace("0.5,1,2", "0.5,1.0000001,2"))
    assert identity() != before


def test_a_result_file_stands_alone(folder, tmp_path):
    config = load(folder)
    (outcome,) = fvi.run(config, output=tmp_path / "out")
    (folder / "quake.csv").unlink()
    inputs._KEPT.clear()
    (again,) = fvi.recall(tmp_path / "out" / f"{config.name}.h5")
    first, second = (one.finished[0].trajectory.position for one in (outcome, again))
    assert np.array_equal(first, second)
    time = np.linspace(0, 2, 33)
    forces = [one.experiment.problem.scene.forcing(time) for one in (outcome, again)]
    assert np.array_equal(*forces)


def test_a_changed_file_is_told_beside_its_digest(folder):
    resolved = json.dumps(load(folder).resolved)
    (folder / "quake.csv").write_text(CSV.replace("0.5,1,2", "0.5,7,2"))
    inputs._KEPT.clear()
    with pytest.raises(ConfigError, match=r"forcing\.digest: quake\.csv has changed"):
        parse_config(resolved, "again.yaml", base=folder)
