"""What a configuration of a fit must say, and what comes of it."""

from pathlib import Path

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.scenes.records import inputs

TEXT = """\
name: decay
problem:
  kind: damped-oscillator
  stiffness: 3.0
  damping: [{order: 0.6, coefficient: 0.5}]
  initial: {position: 1.0}
  final_time: 5.0
  exact: none
ladder: {steps: [8]}
fit:
  data:
    - {name: one, file: a.csv, columns: {x: xa}}
    - {name: two, file: b.csv, columns: {x: xb}}
  parameters: {problem.stiffness: {from: 0}}
  noise: 0.01
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rows = "".join(f"{t},{np.cos(1.7 * t):.6f}\n" for t in np.arange(0.2, 4.9, 0.4).tolist())
    (tmp_path / "a.csv").write_text("t,xa\n" + rows)
    (tmp_path / "b.csv").write_text("t,xb\n" + rows)
    return tmp_path


def load(folder: Path, text: str = TEXT) -> fvi.LoadedConfig:
    (folder / "decay.yaml").write_text(text)
    return fvi.load(folder / "decay.yaml")


def test_a_run_that_fails_ends_a_fit_with_a_message(folder, monkeypatch):
    from fvi_cli.integrator.gradients.gradient import RunFailedError
    from fvi_cli.studies.fits.model import MotionModel

    def fail(self: MotionModel, *given: object) -> None:
        raise RunFailedError("the run diverged")

    monkeypatch.setattr(MotionModel, "remesh", fail)
    load(folder)
    (result,) = fvi.fit(folder / "decay.yaml")
    assert not result.is_converged
    assert "the run diverged" in result.best.message


def structure(folder: Path, size: int) -> fvi.LoadedConfig:
    generator = np.random.default_rng(1)
    stiffness = generator.standard_normal((size, size)) * 0.01
    np.save(folder / "K.npy", stiffness + stiffness.T + 10 * np.eye(size))
    rows = "".join(f"{t},{np.cos(3.2 * t):.6f}\n" for t in np.arange(0.05, 0.6, 0.05).tolist())
    (folder / "s.csv").write_text("t,x1\n" + rows)
    (folder / "s.yaml").write_text(
        "name: s\nproblem:\n  kind: structure\n"
        f"  mass: {{file: M.npy}}\n  stiffness: {{file: K.npy}}\n"
        "  damping: [{order: 0.5, coefficient: 0.1, acts_on: [x1]}]\n"
        f"  initial: {{position: [{', '.join(['1.0'] + ['0.0'] * (size - 1))}]}}\n"
        "  final_time: 1.0\n  exact: none\nladder: {steps: [8]}\n"
        "fit:\n  data: {file: s.csv, columns: {x1: x1}}\n"
        "  parameters: {problem.damping.0.coefficient: {from: 0}}\n"
    )
    np.save(folder / "M.npy", np.eye(size))
    return fvi.load(folder / "s.yaml")


def test_fitted_numbers_of_large_structures_are_read_again(folder):
    from fvi_cli.config.fits.fitted import fitted_text

    loaded = structure(folder, 460)
    (described,) = (one.problem_specification for one in loaded.experiments)
    values = {"problem.damping.0.coefficient": 0.25}
    text = fitted_text(loaded, 0, described, [("s", values)], folder / "elsewhere")
    (folder / "elsewhere").mkdir()
    (folder / "elsewhere" / "again.yaml").write_text(text)
    again = fvi.load(folder / "elsewhere" / "again.yaml").experiments[0]
    scene, before = again.problem.scene, loaded.experiments[0].problem.scene
    assert np.array_equal(scene.potential.form, before.potential.form)
    assert again.problem_specification["damping"][0]["coefficient"] == 0.25
    # the control: the file must be the one that was read
    np.save(folder / "K.npy", 10 * np.eye(460))
    inputs._KEPT.clear()
    with pytest.raises(fvi.ConfigError, match="has changed"):
        fvi.load(folder / "elsewhere" / "again.yaml")
