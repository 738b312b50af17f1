"""Every loop over steps tells how far it is to whoever watches, and to nobody else."""

import numpy as np
import pytest

from fvi_cli.integrator import advance
from fvi_cli.integrator.advance import on_progress
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.scenes.registry import build_scene

N = 1024
LINEAR = {"kind": "bagley-torvik", "damping": [{"order": 0.5, "coefficient": 0.5}]}
LINEAR |= {"initial": {"position": 1.0, "velocity": 0.0}, "final_time": 8.0}
PENDULUM = {**LINEAR, "kind": "pendulum"}
GENERAL = {
    "kind": "lagrangian",
    "coordinates": ["x"],
    "lagrangian": "(1 + x**2)*vx**2/2 - x**2/2",
    "damping": LINEAR["damping"],
    "initial": {"position": 0.5, "velocity": 0.0},
    "final_time": 8.0,
}
METHODS = {
    "blocks": Method(cq="bdf2", degree=1),
    "exponentials": Method(cq="gauss", degree=2),
    "baseline": Baseline(name="implicit-euler"),
    "gruenwald-letnikov": Baseline(name="gruenwald-letnikov"),
    "product-integration": Baseline(name="product-integration"),
}
CASES = [(LINEAR, name) for name in METHODS]
CASES += [(PENDULUM, "blocks"), (PENDULUM, "exponentials")]
CASES += [(GENERAL, "blocks")]


@pytest.mark.parametrize(("specification", "name"), CASES)
def test_every_loop_tells_how_far_it_is(specification, name, monkeypatch):
    monkeypatch.setattr(advance, "SECONDS_BETWEEN", 0.0)
    scene, method = build_scene(specification), METHODS[name]
    told = []
    with on_progress(lambda done, n_steps: told.append((done, n_steps))):
        watching = integrate(scene, method, N)
    of_this_run = [done for done, n_steps in told if n_steps == N]
    assert of_this_run
    assert of_this_run[0] == 0
    assert of_this_run == sorted(of_this_run)
    assert of_this_run[-1] < N
    if name not in ("exponentials", "blocks"):  # which go through so few steps in one piece
        assert len(of_this_run) >= 2
    # afterwards nobody is told, and the numbers are the same
    count = len(told)
    alone = integrate(scene, method, N)
    assert len(told) == count
    assert np.array_equal(watching.position, alone.position)


def test_a_watcher_is_told_seldom():
    told = []
    with on_progress(lambda done, n_steps: told.append(done)):
        for index in range(100_000):
            advance.report_progress(index, 100_000)
    assert told[0] == 0
    assert len(told) < 100
