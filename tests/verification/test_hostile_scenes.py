"""Scenes on which routes once disagreed, commands ended, or steps were wasted by the million."""

import numpy as np
import pytest
from written_out import every_lag_written_out

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.lagrangian import lagrangian_scene

GROWING = {
    "a mass that moves for ever": ("(1 + 0.1*sin(x)**2)*vx**2/2 + x**2/2", 5.0),
    "far": ("(1 + 0.1*exp(-x**2))*vx**2/2 + x**2/2", 30.0),
}


@pytest.mark.few(1)
@pytest.mark.parametrize("name", GROWING)
def test_routes_agree_on_mass_matrices_that_move_and_negative_stiffness(name):
    lagrangian, final_time = GROWING[name]
    scene = lagrangian_scene(
        coordinates=("x",),
        lagrangian=lagrangian,
        damping=[FractionalDamping(order=0.5, coefficient=0.01 * np.eye(1))],
        final_time=final_time,
        initial_position=1.0,
    )
    method = Method(cq="gauss", degree=2)
    usual = integrate(scene, method, 400)
    times = final_time / 400 * np.arange(401)
    times[-1] = final_time
    single = integrate(scene, method, mesh_of(times))
    watched = integrate(scene, method, 400, diagnostics=True)
    assert {usual.status, single.status, watched.status} == {"ok"}
    assert usual.time.size == single.time.size
    # bit for bit
    assert np.array_equal(usual.position, watched.position)
    sound = np.abs(usual.position[:, 0]) < 1e3
    assert sound.sum() > 50
    assert np.abs(usual.position - single.position)[sound].max() < 1e-11 * 1e3
    backward = integrate(scene, Method(cq="bdf2", degree=1), 400)
    with every_lag_written_out():
        direct = integrate(scene, Method(cq="bdf2", degree=1), 400)
    assert backward.status == direct.status
    assert backward.time.size == direct.time.size
