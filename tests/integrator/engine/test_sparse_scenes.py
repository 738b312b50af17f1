"""Scenes with sparse matrices: the same motion as with dense ones, and nothing dense is made."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.matrices import (
    Factored,
    indefinite_words,
    is_semidefinite,
    is_sparse,
    symmetric_form,
)
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.memory.reach import find_damper_forms
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import engine_for, mesh_for
from fvi_cli.integrator.stability.prediction import predict_stability
from fvi_cli.scenes.registry import build_scene

GAUSS = Method(cq="gauss", degree=2, start="graded")


def second_differences(n: int) -> csr_array:
    beside = -np.ones(n - 1)
    return csr_array(diags_array([beside, 2.0 * np.ones(n), beside], offsets=[-1, 0, 1]))


def differences(n: int, places: tuple[int, ...]) -> np.ndarray:
    rows = np.zeros((len(places), n))
    for index, place in enumerate(places):
        rows[index, place], rows[index, place - 1] = 1.0, -1.0
    return rows


def row_of_masses(n: int, *, sparse: bool, orders: tuple[float, ...] = (0.5, 1.5)) -> Scene:
    mass, stiffness = csr_array(diags_array(np.linspace(1.0, 2.0, n))), 50 * second_differences(n)
    rows, inner = differences(n, (7, 20, 33)), np.diag([1.0, 2.0, 0.5])
    factored = Factored(rows=rows, inner=inner)
    coefficient = factored if sparse else rows.T @ inner @ rows
    rng = np.random.default_rng(3)
    return Scene(
        inertia=Inertia(mass=mass if sparse else mass.toarray()),
        potential=QuadraticPotential(stiffness=stiffness if sparse else stiffness.toarray()),
        damping=tuple(FractionalDamping(order=o, coefficient=coefficient) for o in orders),
        initial_position=rng.standard_normal(n),
        initial_velocity=rng.standard_normal(n),
        final_time=2.0,
    )


@pytest.mark.parametrize("orders", [(0.5,), (1.5,), (0.5, 1.0, 1.5)])
def test_the_motion_is_that_of_dense_matrices(orders):
    asked = True
    one = integrate(row_of_masses(48, sparse=True, orders=orders), GAUSS, 40, diagnostics=asked)
    two = integrate(row_of_masses(48, sparse=False, orders=orders), GAUSS, 40, diagnostics=asked)
    assert np.abs(one.position - two.position).max() < 1e-12
    assert np.abs(one.diagnostics.energy_defect).max() < 1e-10
    difference = one.diagnostics.stored_energy - two.diagnostics.stored_energy
    assert np.abs(difference).max() < 1e-11


@pytest.mark.parametrize(("cq", "degree"), [("gauss", 5), ("lobatto-iiic", 3)])
def test_so_it_is_for_methods_of_many_stages(cq, degree):
    method = Method(cq=cq, degree=degree, start="none")
    one, two = (integrate(row_of_masses(48, sparse=s), method, 20) for s in (True, False))
    assert np.abs(one.position - two.position).max() < 1e-12


def test_so_it_is_in_adaptive_steps():
    steps = AdaptiveSteps(tolerance=1e-6)
    one = integrate(row_of_masses(40, sparse=True), Method(cq="gauss", degree=4), steps)
    two = integrate(row_of_masses(40, sparse=False), Method(cq="gauss", degree=4), steps)
    # sizes of steps are powers of 2^(1/4), and round-off may decide on one of them
    same = np.cumprod(np.abs(one.time - two.time) < 1e-13).astype(bool)
    assert same.sum() > 100
    assert np.abs(one.position[same] - two.position[same]).max() < 1e-11


@pytest.mark.parametrize("degree", [2, 4])
def test_turned_coordinates_of_large_scenes_turn_the_motion(degree):
    """With full matrices, which nothing makes sparse and no modes take apart."""
    n = 1024 // (4 * degree) + 6
    given = row_of_masses(n, sparse=True)
    turn = np.linalg.qr(np.random.default_rng(degree).standard_normal((n, n)))[0]
    mass, stiffness, coefficient = (
        symmetric_form(turn @ one @ turn.T, "turned")
        for one in (given.inertia.mass, given.stiffness, given.damping[0].matrix)
    )
    turned = replace(
        given,
        inertia=Inertia(mass=mass),
        potential=QuadraticPotential(stiffness=stiffness),
        damping=tuple(replace(one, coefficient=coefficient) for one in given.damping),
        initial_position=turn @ given.initial_position,
        initial_velocity=turn @ given.initial_velocity,
    )
    assert not turned.is_sparse
    method = Method(cq="gauss", degree=degree, start="graded")
    one, two = (integrate(scene, method, 40) for scene in (given, turned))
    assert np.abs(one.position @ turn.T - two.position).max() < 1e-10


def test_states_stand_on_directions_and_not_on_degrees_of_freedom():
    scene = row_of_masses(300, sparse=True, orders=(0.5,))
    engine = engine_for([scene], GAUSS, mesh_for(scene, GAUSS, 200))
    assert engine.start().z.shape == (1, engine.n_states, 3)


def test_terms_on_overlapping_directions_share_their_forms():
    rows = differences(60, (5, 9))
    terms = [
        FractionalDamping(order=0.5, coefficient=Factored(rows=rows, inner=np.eye(2))),
        FractionalDamping(order=0.7, coefficient=Factored(rows=rows[1:], inner=np.eye(1))),
    ]
    reach = find_damper_forms(terms)
    assert reach.count == 2
    values = np.random.default_rng(1).standard_normal(60)
    for term in terms:
        inner = reach.inner(term)
        force = reach.spread(np.asarray(inner @ reach.along(values)))
        assert force == pytest.approx(term.coefficient @ values, abs=1e-14)


def test_nothing_of_size_d_by_d_is_made():
    n = 3000
    scene = row_of_masses(n, sparse=True)
    tracemalloc.start()
    try:
        trajectory = integrate(scene, GAUSS, 8)
        assert predict_stability(scene, GAUSS, 8).verdict == "stable"
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert trajectory.status == "ok"
    assert peak < 0.3 * 8 * n * n


def test_definite_or_not_is_told_without_eigenvalues():
    n = 100
    matrix = second_differences(n)
    least = 2.0 - 2.0 * np.cos(np.pi / (n + 1))
    for shift, expected in ((0.0, True), (-0.99 * least, True), (-1.01 * least, False)):
        shifted = symmetric_form(csr_array(matrix + shift * diags_array(np.ones(n))), "K")
        assert (not indefinite_words(shifted)) is expected
    free = matrix.tolil()
    free[0, 0] = free[-1, -1] = 1.0
    singular = symmetric_form(csr_array(free), "K")
    assert is_semidefinite(singular)
    assert indefinite_words(singular) or np.linalg.eigvalsh(singular.toarray())[0] > -1e-12


def test_the_entry_that_is_wrong_is_named():
    matrix = second_differences(40).tolil()
    matrix[3, 4] = -2.0
    with pytest.raises(ValueError, match="row 4, column 5 differs by -1 from its mirror image"):
        symmetric_form(csr_array(matrix), "stiffness")
    matrix[3, 4] = matrix[4, 3] = np.nan
    with pytest.raises(ValueError, match="row 4, column 5 is nan; every entry must be finite"):
        symmetric_form(csr_array(matrix), "stiffness")
    with pytest.raises(ValueError, match="must be positive definite"):
        Inertia(mass=csr_array(diags_array(np.append(np.ones(39), 0.0))))


def test_a_tall_frame_is_sparse_and_the_same():
    storeys = 250
    stiffness = np.linspace(2.0, 1.0, storeys)
    scene = build_scene(
        {
            "kind": "frame",
            "stiffnesses": stiffness.tolist(),
            "damping": [{"order": 0.5, "coefficient": 1.0, "acts_on": ["x1", "x40 - x39"]}],
            "dampers": [{"order": 1.0, "coefficient": 0.1}],
            "final_time": 1.0,
        }
    )
    assert scene.is_sparse
    assert all(is_sparse(term.form) for term in scene.damping)
    upper = np.append(stiffness[1:], 0.0)
    bands = np.diag(stiffness + upper) - np.diag(upper[:-1], 1) - np.diag(upper[:-1], -1)
    assert np.array_equal(scene.stiffness, bands)


@pytest.mark.parametrize("sparse", [True, False])
def test_a_step_without_a_unique_solution_ends_the_run(sparse):
    """m/h^2 + k/4 = 0 in all of its steps."""
    n = 40
    mass, stiffness = csr_array(diags_array(np.ones(n))), csr_array(diags_array(np.full(n, -4.0)))
    scene = Scene(
        inertia=Inertia(mass=mass if sparse else mass.toarray()),
        potential=QuadraticPotential(stiffness=stiffness if sparse else stiffness.toarray()),
        initial_position=np.ones(n),
        initial_velocity=np.zeros(n),
        final_time=10.0,
    )
    found = integrate(scene, Method(cq="gauss", degree=1), 10)
    assert found.status == "failed"
    assert "have no unique solution" in found.message
    assert found.time.size == 1
