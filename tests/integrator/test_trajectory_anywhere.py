"""Meshes, adaptive steps and values at any time, as programs call them."""

import numpy as np
import pytest
from letters import swing

import fvi_cli as fvi
from fvi_cli.integrator.meshes.mesh import uniform_mesh

SCENE = swing((0.5, 0.3), T=10.0, x=2.0)


@pytest.fixture(scope="module")
def fine() -> fvi.Trajectory:
    return fvi.integrate(SCENE, "gauss8", fvi.AdaptiveSteps(tolerance=1e-10), with_steps=True)


def test_a_name_with_a_mesh_means_the_method_on_its_steps(fine):
    mesh = fvi.graded_mesh(10.0, 100, 2.5)
    by_name = fvi.integrate(SCENE, "gauss4", mesh)
    by_value = fvi.integrate(SCENE, fvi.Method(cq="gauss", degree=4), mesh)
    assert np.array_equal(by_name.position, by_value.position)
    assert np.array_equal(by_name.time, 10.0 * (np.arange(101) / 100) ** 2.5)
    assert np.abs(by_name.position - fine(by_name.time)).max() < 1e-7
    through = fvi.integrate(SCENE, "gauss4", fvi.mesh_of(by_name.time))
    assert np.abs(through.position - by_name.position).max() < 1e-13
    even = fvi.integrate(SCENE, "gauss4", uniform_mesh(10.0, 100))
    assert np.array_equal(even.time[[0, -1]], [0.0, 10.0])
