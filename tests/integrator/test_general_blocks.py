"""Blocks of steps of general Lagrangians against single steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator import block_newton
from fvi_cli.integrator.frozen_laws import LagrangianLaw
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.checkpoint import Checkpoint
from fvi_cli.integrator.run.march import CHUNK
from fvi_cli.integrator.run.parts import integrate_part
from fvi_cli.planning.plan import plan_run
from fvi_cli.scenes.lagrangian import double_pendulum, lagrangian_scene

GAUSS3 = Method(cq="gauss", degree=3, start="series")
SINGLE_STEP_CALLS = 3
"""Evaluations of all derivatives in a single step: two of Newton's iteration, one at its end."""


def bent(order: float = 0.5) -> Scene:
    return double_pendulum(
        final_time=5.0, joints=[(order, 0.2)], initial_position=[1.0, -0.5], masses=(1.0, 2.0)
    )


def charge() -> Scene:
    """A charge in a magnetic field that changes with the place: products of q and v."""
    return lagrangian_scene(
        final_time=6.0,
        coordinates=("x", "y"),
        lagrangian="(vx**2 + vy**2)/2 + (1 + 0.3*x)*(x*vy - y*vx) - x**4/4 - y**2/2 + t*x/5",
        damping=[FractionalDamping(order=0.7, coefficient=np.diag([0.2, 0.1]))],
        forcing=Forcing.from_text("sin(t)", "cos(2*t)"),
        initial_position=[0.5, 0.0],
        initial_velocity=[0.0, 1.0],
    )


def fast() -> Scene:
    """Not quadratic in the velocity."""
    return lagrangian_scene(
        final_time=6.0,
        coordinates=("x",),
        lagrangian="-sqrt(1 - vx**2) - x**2/2 - x**4/4",
        damping=[FractionalDamping(order=1.3, coefficient=0.3)],
        initial_position=0.8,
        initial_velocity=0.2,
    )


def largest_difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


@pytest.mark.parametrize(
    ("scene", "method"),
    [
        (bent(), GAUSS3),
        (bent(1.5), GAUSS3),
        (bent(1.0), Method(cq="gauss", degree=2)),
        (bent(), Method(cq="bdf4", degree=2, start="series")),
        (bent(), Method(cq="bdf2", degree=1, sampling="nodes")),
        (charge(), GAUSS3),
        (charge(), Method(cq="radau-iia", degree=2)),
        (fast(), GAUSS3),
        (fast(), Method(cq="gauss", degree=2)),
        (replace(bent(), damping=()), Method(cq="gauss", degree=2)),
    ],
    ids=lambda value: value.case if isinstance(value, Method) else f"{value.dimension}",
)
def test_blocks_give_what_single_steps_give(scene: Scene, method: Method) -> None:
    single = integrate(scene, replace(method, history="direct"), 512)
    blocks = integrate(scene, replace(method, history="fft"), 512)
    assert single.status == blocks.status == "ok"
    assert largest_difference(blocks.position, single.position) <= 1e-12
    assert single.momentum is not None
    assert blocks.momentum is not None
    assert largest_difference(blocks.momentum, single.momentum) <= 1e-12
    # a change far below the accuracy of the method is seen
    other = replace(scene, initial_velocity=scene.initial_velocity + 1e-9)
    assert largest_difference(integrate(other, method, 512).position, single.position) > 1e-11


def test_blocks_call_for_far_fewer_evaluations(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    original = LagrangianLaw.remainder

    def counted(self, inputs, points, previous):  # type: ignore[no-untyped-def]
        calls.append(points.shape[0])
        return original(self, inputs, points, previous)

    monkeypatch.setattr(LagrangianLaw, "remainder", counted)
    single = integrate(bent(), replace(GAUSS3, history="direct"), 128)
    assert single.newton.iterations >= (SINGLE_STEP_CALLS - 1) * 128
    integrate(bent(), GAUSS3, 2048)
    assert len(calls) < SINGLE_STEP_CALLS * 2048 / 4
    assert max(calls) == block_newton.newton_block(bent(), 3, 2048)


def test_a_block_that_does_not_contract_is_halved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(block_newton, "LEAST_BLOCKS", 1)
    scene = double_pendulum(
        final_time=40.0, joints=[(0.5, 0.2)], initial_position=[1.5, 1.0], initial_velocity=3.0
    )
    single = integrate(scene, replace(GAUSS3, history="direct"), 400)
    blocks = integrate(scene, GAUSS3, 400)
    assert blocks.status == "ok"
    assert largest_difference(blocks.position, single.position) <= 1e-12


@pytest.mark.parametrize("n_steps", [64, 300, 1024])
@pytest.mark.parametrize("method", [GAUSS3, Method(cq="bdf2", degree=1, sampling="nodes")])
def test_the_plan_tells_the_work(n_steps: int, method: Method) -> None:
    planned = plan_run(bent(), method, n_steps)
    assert planned.history_operations == integrate(bent(), method, n_steps).history_operations


def test_leaving_where_the_lagrangian_is_a_number_is_told() -> None:
    scene = lagrangian_scene(
        final_time=4.0,
        coordinates=("x",),
        lagrangian="vx**2*(1 + x**2)/2 - log(x)",
        initial_position=1.0,
    )
    run = integrate(scene, GAUSS3, 64)
    assert run.status == "failed"
    assert run.message.startswith("step ")
    assert run.energy is not None
    assert np.isfinite(run.energy).all()


def test_a_start_where_the_lagrangian_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="not finite at the initial position"):
        lagrangian_scene(
            final_time=4.0,
            coordinates=("x",),
            lagrangian="vx**2*(1 + x**2)/2 - log(x)",
            initial_position=-1.0,
        )


EXPONENTIALS = replace(GAUSS3, start="none", history="exponentials")


@pytest.mark.parametrize("make", [bent, lambda: bent(1.5), charge, fast])
def test_exponentials_give_what_single_steps_give(make: Callable[[], Scene]) -> None:
    scene = make()
    single = integrate(scene, replace(EXPONENTIALS, history="direct"), 256)
    free = integrate(scene, EXPONENTIALS, 256)
    assert free.status == "ok"
    for name in ("position", "momentum", "energy"):
        assert largest_difference(getattr(free, name), getattr(single, name)) <= 1e-12
    few = integrate(scene, EXPONENTIALS, 256, every=100)
    assert few.time == pytest.approx(scene.final_time * np.array([0, 100, 200, 256]) / 256)
    assert np.array_equal(few.position, free.position[[0, 100, 200, 256]])


def test_a_run_of_exponentials_goes_on_bit_for_bit() -> None:
    scene = charge()
    n_steps = CHUNK + 500
    whole = integrate_part(scene, EXPONENTIALS, n_steps)
    first = integrate_part(scene, EXPONENTIALS, n_steps, until=100)
    assert first.checkpoint is not None
    assert first.checkpoint.done == CHUNK
    kept = Checkpoint.from_bytes(first.checkpoint.to_bytes())
    rest = integrate_part(scene, EXPONENTIALS, n_steps, checkpoint=kept)
    for name in ("position", "momentum", "energy"):
        parts = [getattr(part.trajectory, name) for part in (first, rest)]
        assert np.array_equal(np.concatenate(parts), getattr(whole.trajectory, name))


def test_exponentials_tell_where_a_run_cannot_go_on() -> None:
    scene = lagrangian_scene(
        final_time=4.0,
        coordinates=("x",),
        lagrangian="x*vx**2/2 - x",
        damping=[FractionalDamping(order=0.5, coefficient=0.1)],
        initial_position=1.0,
    )
    run = integrate(scene, EXPONENTIALS, 64)
    assert run.status == "failed"
    assert run.message.startswith("step ")
    assert np.isfinite(run.position).all()


def test_velocities_do_not_depend_on_their_neighbours() -> None:
    lagrangian = charge().lagrangian
    assert lagrangian is not None
    position = np.array([[0.1, 0.2], [np.nan, 0.0], [3.0, -1.0]])
    momentum = np.array([[1.0, 0.0], [1.0, 1.0], [1e6, 2.0]])
    together = lagrangian.velocity(position, momentum, 0.5)
    alone = [lagrangian.velocity(q, p, 0.5) for q, p in zip(position, momentum, strict=True)]
    assert np.array_equal(together, np.array(alone), equal_nan=True)
    assert np.isfinite(together[[0, 2]]).all()
    assert np.isnan(together[1]).all()


def test_what_limits_the_order_is_the_mass_matrix_and_not_the_start() -> None:
    """Order min(2m, m + 4 - gamma) with a start as smooth as t**8; 2m with a constant mass."""
    orders = []
    for lagrangian in ("(1 + x**2/2)*vx**2/2 - x**2/2", "vx**2/2 - x**2/2 - x**4/4"):
        scene = lagrangian_scene(
            final_time=2.0,
            coordinates=("x",),
            lagrangian=lagrangian,
            damping=[FractionalDamping(order=1.5, coefficient=0.5)],
            forcing=Forcing.from_text("t**6"),
        )
        exact = integrate(scene, Method(cq="gauss", degree=4), 1024).position
        errors = [
            np.abs(integrate(scene, Method(cq="gauss", degree=3), n).position - exact[:: 1024 // n])
            for n in (64, 128)
        ]
        orders.append(float(np.log2(errors[0].max() / errors[1].max())))
    assert orders == pytest.approx([5.5, 6.0], abs=0.1)
