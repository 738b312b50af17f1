"""Scenes on which routes once disagreed, commands ended, or steps were wasted by the million."""

from pathlib import Path

import numpy as np
import pytest
from letters import spring
from written_out import every_lag_written_out

import fvi_cli as fvi
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.diagnostics_request import DiagnosticsRequest
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.lagrangian import lagrangian_scene
from fvi_cli.scenes.linear_response import linear_response

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
    watched = integrate(scene, method, 400, diagnostics=DiagnosticsRequest(energy_balance=True))
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


EXTREME = """
name: extreme
experiments:
  - name: far
    problem:
      kind: damped-oscillator
      stiffness: 3.0e+80
      damping: [{order: 0.6, coefficient: 7.0e+55}]
      initial: {position: 0.0, velocity: 0.5e+40}
      final_time: 6.0e-40
    method: {rk: gauss, degree: 3}
    ladder: {steps: [64, 128]}
  - name: near
    problem: {kind: damped-oscillator, final_time: 5.0}
    method: {rk: gauss, degree: 3}
    ladder: {steps: [64]}
"""


def test_extreme_units_end_no_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("extreme.yaml").write_text(EXTREME, encoding="utf-8")
    far, near = fvi.run("extreme.yaml")
    assert [one.status for one in (*far.finished, *near.finished)] == ["ok", "ok", "ok"]
    assert far.finished[1].error < 1e-11


@pytest.mark.parametrize("order", [1.5, 1.75, 1.99])
def test_strong_damping_takes_few_steps(order):
    scene = spring((order, 50 * np.eye(1)), T=5.0, k=1.0, x=1.0, v=0.5)
    found = fvi.solve(scene, tolerance=1e-8)
    exact = linear_response(
        mass=1.0, stiffness=1.0, damping=((order, 50.0),), position=1.0, velocity=0.5
    )
    assert found.assessment.outcome == "met"
    # once 2.6e5 to 4.2e6
    assert found.time.size < 40
    assert np.abs(found.position[:, 0] - exact(found.time)).max() < 1e-8
