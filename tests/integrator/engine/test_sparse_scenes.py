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
    symmetric_form,
)
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.prediction import predict_stability

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
