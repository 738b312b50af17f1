"""Matrices from files: every format gives the same scene, and what is wrong is told at its line."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import mmwrite, savemat
from scipy.sparse import coo_array, csr_array, diags_array, save_npz

from fvi_cli.config import load_config
from fvi_cli.effects.matrices import is_sparse
from fvi_cli.effects.scene import Scene
from fvi_cli.scenes.records.inputs import keep_numbers
from fvi_cli.scenes.records.matrices import MatrixFile, matrix_as_numbers

N = 40
CONFIG = """\
name: structure
problem:
  kind: structure
  mass: {file: M.mtx}
  stiffness: {file: K.mtx}
  damping: [{order: 0.5, coefficient: 0.3, acts_on: [x2 - x1, x9]}]
  initial: {position: {at: {x3: 1.0}}}
  final_time: 3.0
  exact: none
method: {rk: gauss, degree: 2}
ladder: {steps: [32]}
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    stiffness = csr_array(
        diags_array([-np.ones(N - 1), 2 * np.ones(N), -np.ones(N - 1)], offsets=[-1, 0, 1])
    )
    mass = csr_array(diags_array(np.linspace(1.0, 2.0, N)))
    mmwrite(tmp_path / "K.mtx", coo_array(stiffness), symmetry="symmetric", precision=17)
    mmwrite(tmp_path / "M.mtx", coo_array(mass), precision=17)
    np.save(tmp_path / "K.npy", stiffness.toarray())
    save_npz(tmp_path / "K.npz", stiffness)
    np.savez(tmp_path / "both.npz", K=stiffness.toarray(), M=mass.toarray())
    savemat(tmp_path / "both.mat", {"K": stiffness, "M": mass})
    np.savetxt(tmp_path / "K.csv", stiffness.toarray(), delimiter=",", fmt="%.17g")
    (tmp_path / "c.yaml").write_text(CONFIG)
    return tmp_path


def scene_of(folder: Path, *overrides: str) -> Scene:
    (experiment,) = load_config(folder / "c.yaml", overrides=overrides).experiments
    return experiment.problem.scene


@pytest.mark.parametrize(
    ("source", "sparse"),
    [
        ("{file: K.mtx}", True),
        ("{file: K.npz}", True),
        ("{file: both.mat, variable: K}", True),
        ("{file: K.npy}", False),
        ("{file: both.npz, variable: K}", False),
        ("{file: K.csv}", False),
    ],
)
def test_every_format_holds_the_same_matrix(folder, source, sparse):
    potential = scene_of(folder, f"problem.stiffness={source}").potential
    expected = scene_of(folder).potential
    assert is_sparse(potential.form) is sparse
    assert np.array_equal(potential.stiffness, expected.stiffness)


@pytest.mark.parametrize("dense", [True, False])
def test_what_is_kept_gives_the_matrix_back_to_the_last_digit(dense):
    rng = np.random.default_rng(5)
    matrix = rng.standard_normal((37, 37)) * (rng.random((37, 37)) < 0.2)
    matrix = matrix + matrix.T
    digest = keep_numbers(matrix_as_numbers(matrix if dense else csr_array(matrix)))
    back = MatrixFile(file="K.mtx", digest=digest).value
    assert is_sparse(back) is not dense
    found = back if isinstance(back, np.ndarray) else back.toarray()
    assert np.array_equal(found, matrix)


def test_rayleigh_damping_by_its_factors_is_the_matrix_that_it_stands_for(folder):
    scene = scene_of(folder, "problem.rayleigh={mass: 0.2, stiffness: 0.01, order: 0.6}")
    term = scene.damping[1]
    assert term.order == 0.6
    expected = 0.2 * scene.inertia.mass + 0.01 * scene.potential.stiffness
    assert term.matrix == pytest.approx(expected)
