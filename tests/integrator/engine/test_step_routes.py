"""Two routes to one motion: blocks, recurrences and batches against single steps, members alone."""

import numpy as np
import pytest
from letters import spring
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.recurrence import Recurrence
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run import loop
from fvi_cli.integrator.run.on_mesh import engine_for, mesh_for
from fvi_cli.scenes.lagrangian import lagrangian_scene
from fvi_cli.scenes.registry import build_scene

METHODS = [
    Method(cq="gauss", degree=3),
    Method(cq="gauss", degree=1, start="graded"),
    Method(cq="lobatto-iiic", degree=2),
    Method(cq="bdf2", degree=1, sampling="nodes"),
    Method(cq="bdf4", degree=2),
]


def coupled(order: float, *, forced: bool, speed: float):
    """Three masses on springs, whose damper acts between two of them."""
    return build_scene(
        {
            "kind": "chain",
            "masses": 3,
            "stiffness": 4.0,
            "damping": [
                {"order": order, "coefficient": 0.3, "acts_on": ["x2 - x1"]},
                {"order": 0.5, "coefficient": 0.1, "acts_on": ["x3"]},
            ],
            "initial": {"position": [1.0, 0.0, -0.5], "velocity": [0.0, speed, 0.0]},
            "final_time": 10.0,
            **({"forcing": ["sin(2*t)", "0", "t*exp(-t)"]} if forced else {}),
        }
    )


@spread(method=METHODS, order=[0.3, 1.0, 1.6], forced=[True, False], speed=[0.0, 0.7], n=[90, 4096])
def test_linear_blocks_are_single_steps(monkeypatch, method, order, forced, speed, n):
    scene = coupled(order, forced=forced, speed=speed)
    found = integrate(scene, method, n)
    monkeypatch.setattr(loop, "block_length", lambda engine, total: 1)
    expected = integrate(scene, method, n)
    assert np.abs(found.position - expected.position).max() < 2e-12
    assert np.abs(found.momentum - expected.momentum).max() < 2e-11


@spread(few=2, method=METHODS, order=[0.3, 1.0, 1.6], kind=["vx**2/2", "vx**2*(1 + sin(x)/4)/2"])
def test_nonlinear_blocks_are_single_steps(monkeypatch, method, order, kind):
    """Blocks contract on most of the way, not where the wall is met."""
    scene = lagrangian_scene(
        final_time=12.0,
        coordinates=("x",),
        lagrangian=f"{kind} - x**2/2 - exp(20*(x - 1))/20",
        damping=[FractionalDamping(order=order, coefficient=0.05 * np.eye(1))],
        initial_position=[-0.9],
        initial_velocity=[0.5],
    )
    found = integrate(scene, method, 1500)
    monkeypatch.setattr(loop, "block_length", lambda engine, total: 1)
    expected = integrate(scene, method, 1500)
    assert found.status == expected.status == "ok"
    assert found.newton_iterations < expected.newton_iterations
    assert np.abs(found.position - expected.position).max() < 1e-10


@spread(bdf_order=[1, 2, 4], degree=[1, 2], terms=[1, 3])
def test_recurrences_keep_what_near_lags_cause(bdf_order, degree, terms):
    """The recurrence has a few combinations of lags; blocks have all of them."""
    rng = np.random.default_rng([bdf_order, degree, terms])
    damping = [
        FractionalDamping(order=order, coefficient=[[rng.uniform(0.1, 1.0)]])
        for order in rng.uniform(0.1, 1.0 if bdf_order > 2 else 1.9, terms)
    ]
    force = Forcing.from_text("sin(3*t)")
    scene = spring(T=20.0, k=3.0, x=1.0, v=0.4, damping=damping, forcing=force)
    sampling = "nodes" if degree == 1 else "points"
    method, n = Method(cq=f"bdf{bdf_order}", degree=degree, sampling=sampling), 64 * 80
    engine, h = engine_for([scene], method, mesh_for(scene, method, n)), 20.0 / n
    loads = engine.loads(0.0, h, n, is_fresh=True)
    state, other = engine.start(), engine.start()
    made = Recurrence(engine, h, 64)
    assert len(made._to_w) < engine.n_states
    x, p, u = made.run(state, 80, loads, with_unknowns=True)
    for k in range(80):
        steps = engine.solve(other, h, 64, loads[:, 64 * k : 64 * k + 64], 64)
        end = other.x[:, None] + steps.dx, other.p[:, None] + steps.dp
        assert np.abs(x[:, 64 * k : 64 * k + 64] - end[0]).max() < 1e-12
        assert np.abs(p[:, 64 * k : 64 * k + 64] - end[1]).max() < 1e-11
        assert np.abs(u[:, 64 * k : 64 * k + 64] - steps.unknowns).max() < 1e-9
        engine.accept(other, steps, (k + 1) * 64 * h)
    assert np.abs(state.x - other.x).max() < 1e-12
    assert np.abs(state.z[:, -1] - other.z[:, -1]).max() < 1e-9


@pytest.mark.parametrize("degree", [1, 3])
def test_the_step_is_that_of_all_equations_at_once(degree):
    """The unknowns of a step fulfil the equations that are written out, to round-off."""
    scene = coupled(0.5, forced=True, speed=0.3)
    method = Method(cq="gauss", degree=degree)
    engine = engine_for([scene], method, mesh_for(scene, method, 1))
    assert isinstance(engine, Engine)
    h, t = 10.0, engine.tables
    loads = engine.loads(0.0, h, 1, is_fresh=True)
    steps = engine.solve(engine.start(), h, 1, loads)
    u = steps.unknowns[0, 0]
    v, x = t.slopes[1:].T @ u, scene.initial_position + h * t.basis[1:].T @ u
    force = np.zeros_like(v)
    frame = engine.frame(h, 1)
    for one, local in zip(engine.damping.directions, frame.memory.local, strict=True):
        force += local[0] @ v @ one.matrix[0]
    rows = (t.weights * t.slopes) @ (v @ scene.inertia.mass)
    rows -= h * t.test_weights @ (x @ scene.stiffness)
    rows += loads[0, 0] - h * t.to_loads @ force
    rows[0] += engine.p0[0]
    rows[-1] -= engine.p0[0] + steps.dp[0, 0]
    assert np.abs(rows).max() < 1e-11
