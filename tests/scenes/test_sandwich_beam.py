"""The finite elements of a sandwich beam against closed forms, and the scene that they make."""

import numpy as np
import pytest
from oracles.sandwich_beam import beam_matrices, sandwich_beam
from scipy.sparse.linalg import eigsh

from fvi_cli.effects.matrices import as_csc, is_sparse
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.method import Method

BEAM = {
    "length": 0.2,
    "width": 0.01,
    "face_thickness": 1e-3,
    "core_thickness": 1e-3,
    "face_modulus": 7e10,
    "face_density": 2700.0,
    "core_density": 1000.0,
}
# of a clamped beam, the first zero of cos(x) cosh(x) + 1
CLAMPED = 1.8751040687119611


def first_frequency(core_modulus: float, elements: int) -> float:
    mass, faces, core = (as_csc(form) for form in beam_matrices(elements, **BEAM))
    values = eigsh(faces + core_modulus * core, k=1, M=mass, sigma=0.0, return_eigenvectors=False)
    return float(np.sqrt(values[0]))


def euler_bernoulli(rigidity: float) -> float:
    b, hf, hc = BEAM["width"], BEAM["face_thickness"], BEAM["core_thickness"]
    line_mass = b * (2 * BEAM["face_density"] * hf + BEAM["core_density"] * hc)
    return CLAMPED**2 / BEAM["length"] ** 2 * float(np.sqrt(rigidity / line_mass))


def test_without_a_core_the_faces_bend_each_for_itself():
    alone = 2 * BEAM["face_modulus"] * BEAM["width"] * BEAM["face_thickness"] ** 3 / 12
    assert first_frequency(1e-3, 24) == pytest.approx(euler_bernoulli(alone), rel=1e-4)


def test_with_a_stiff_core_they_bend_as_one():
    b, hf, d = (
        BEAM["width"],
        BEAM["face_thickness"],
        BEAM["face_thickness"] + BEAM["core_thickness"],
    )
    together = BEAM["face_modulus"] * b * (2 * hf**3 / 12 + hf * d**2 / 2)
    found = first_frequency(1e11, 60)
    assert found == pytest.approx(euler_bernoulli(together), rel=4e-3)


def test_the_scene_is_sparse_and_loses_energy_in_every_step():
    strike = np.zeros(48)
    strike[44] = 1.0
    scene = sandwich_beam(12, initial_velocity=strike, final_time=0.002)
    assert scene.dimension == 48
    assert is_sparse(scene.inertia.form)
    method = Method(cq="gauss", degree=2, start="graded")
    found = integrate(scene, method, 60, diagnostics=True)
    assert found.diagnostics.stored_energy is not None
    total = found.energy + found.diagnostics.stored_energy
    assert np.diff(total).max() < 1e-12 * total[0]
    assert total[-1] < 0.9 * total[0]


def pushed(elements: int) -> Scene:
    force = ["0"] * (4 * elements)
    force[-4] = "exp(-((t-0.002)/0.0004)**2)"
    return sandwich_beam(elements, final_time=0.01, forcing=force)


def test_adaptive_steps_follow_the_motion_and_not_the_finest_modes():
    method, steps = Method(cq="gauss", degree=4, start="graded"), AdaptiveSteps(tolerance=1e-7)
    coarse, fine = (integrate(pushed(elements), method, steps) for elements in (6, 48))
    # the highest frequency is 64 times as high
    assert fine.n_steps == pytest.approx(coarse.n_steps, rel=0.15)
    finer = integrate(pushed(48), Method(cq="gauss", degree=5, start="graded"), 400)
    assert fine.position[-1] == pytest.approx(finer.position[-1], abs=2e-10)
