"""Without damping: symplectic, reversible, energy without drift, momenta kept; with it, its work.

Flows are differentiated by central differences of order 8, whose truncation and rounding are both
below 1e-12 for the distance that is taken.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from drawn_scenes import scene_of, shape_of
from letters import swing
from numpy.typing import NDArray
from runge_kutta_symbol import tableau
from spread import spread
from written_out import left_operator_rk

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.scenes.data import duffing, kepler
from fvi_cli.scenes.lagrangian import double_pendulum

Array = NDArray[np.float64]

STENCIL = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
PENDULUM_PERIOD = 6.699975664370452  # 4 K(sin(1/2)), amplitude 1

EULER = Baseline(name="implicit-euler")
METHODS = [
    Method(cq="gauss", degree=1, start="none"),
    Method(cq="gauss", degree=2, start="none"),
    Method(cq="gauss", degree=3, start="none"),
    Method(cq="bdf2", degree=1, sampling="nodes"),
    Method(cq="bdf4", degree=2, sampling="points"),
]


# scene and number of steps
FLOWS: dict[str, tuple[Scene, int]] = {
    "pendulum": (swing(T=3.0, x=1.0, v=0.3), 24),
    "duffing": (
        duffing(stiffness=-1.0, final_time=3.0, initial_position=0.5, initial_velocity=0.3),
        24,
    ),
    "kepler": (
        kepler(final_time=0.5, initial_position=[1.0, 0.0], initial_velocity=[0.0, 1.1]),
        8,
    ),
    "double pendulum": (
        double_pendulum(final_time=3.0, initial_position=[1.0, -0.5], initial_velocity=[0.1, 0.2]),
        24,
    ),
}
DISTANCE = 6e-3
"""Of the differences."""


def start_of(scene: Scene) -> Array:
    position, velocity = scene.initial_position, scene.initial_velocity
    if scene.lagrangian is not None:
        return np.concatenate([position, scene.lagrangian.forces(position, velocity, 0.0)[0]])
    return np.concatenate([position, scene.inertia.mass @ velocity])


def flow(scene: Scene, method: AnyMethod, n_steps: int, state: Array) -> Array:
    """Positions and momenta at the end from those at the start."""
    position, momentum = np.split(state, 2)
    if scene.lagrangian is not None:
        velocity = scene.lagrangian.velocity(position, momentum, 0.0)
    else:
        velocity = np.linalg.solve(scene.inertia.mass, momentum)
    begun = replace(scene, initial_position=position, initial_velocity=velocity)
    trajectory = integrate(begun, method, n_steps)
    assert trajectory.status == "ok"
    return np.concatenate([trajectory.position[-1], trajectory.momentum[-1]])


def jacobian(function: Callable[[Array], Array], state: Array) -> Array:
    columns = [
        sum(
            weight * (function(state + k * unit) - function(state - k * unit))
            for k, weight in enumerate(STENCIL, start=1)
        )
        / DISTANCE
        for unit in DISTANCE * np.eye(state.size)
    ]
    return np.array(columns).T


def symplecticity_defect(scene: Scene, n_steps: int, method: AnyMethod) -> float:
    d = scene.dimension
    zero, one = np.zeros((d, d)), np.eye(d)
    structure = np.block([[zero, one], [-one, zero]])
    derivative = jacobian(lambda z: flow(scene, method, n_steps, z), start_of(scene))
    return float(np.abs(derivative.T @ structure @ derivative - structure).max())


@spread(few=2, name=FLOWS, method=METHODS)
def test_flow_is_symplectic(name, method):
    assert symplecticity_defect(*FLOWS[name], method) < 1e-12


def test_other_flows_are_not_symplectic():
    scene, n_steps = FLOWS["pendulum"]
    assert symplecticity_defect(scene, n_steps, EULER) > 1e-2
    damped = swing((0.5, 1e-6), T=3.0, x=1.0, v=0.3)
    assert symplecticity_defect(damped, n_steps, METHODS[1]) > 1e-7


def way_back(scene: Scene, n_steps: int, method: AnyMethod) -> float:
    """How far from the start one comes back with the momentum turned round."""
    turn, start = np.repeat([1.0, -1.0], scene.dimension), start_of(scene)
    end = flow(scene, method, n_steps, start)
    assert np.abs(end - start).max() > 0.1
    return float(np.abs(turn * flow(scene, method, n_steps, turn * end) - start).max())


@spread(name=FLOWS, method=METHODS)
def test_backwards_in_time_leads_to_the_start(name, method):
    assert way_back(*FLOWS[name], method) < 1e-12
    assert way_back(*FLOWS["pendulum"], EULER) > 1e-2


def energy_slope(method: AnyMethod, n_steps: int) -> tuple[float, float]:
    """Least-squares slope of the energy error per period, and the largest error."""
    step_size = 0.1
    scene = swing(T=n_steps * step_size, x=1.0)
    trajectory = integrate(scene, method, n_steps)
    assert trajectory.status == "ok"
    error = trajectory.energy - trajectory.energy[0]
    periods = trajectory.time / PENDULUM_PERIOD
    slope = np.polyfit(periods - periods.mean(), error, 1)[0]
    return float(slope), float(np.abs(error).max())


@pytest.mark.parametrize("n_steps", [30_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_energy_of_the_pendulum_does_not_drift(n_steps):
    slope, largest = energy_slope(METHODS[1], n_steps)
    assert abs(slope) < 1e-13
    # it is not exact either: of order 4 in h = 0.1
    assert 1e-8 < largest < 1e-7


def test_energy_of_implicit_euler_drifts():
    slope, _ = energy_slope(EULER, 500)
    assert slope < -1e-3


@pytest.mark.few(2)
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.case)
def test_angular_momentum_of_kepler_is_kept(method):
    """Twenty times round an ellipse of eccentricity 0.36."""
    scene = kepler(final_time=100.0, initial_position=[1.0, 0.0], initial_velocity=[0.0, 0.8])
    trajectory = integrate(scene, method, 3000)
    (x, y), (px, py) = trajectory.position.T, trajectory.momentum.T
    assert np.abs(x * py - y * px - 0.8).max() < 1e-12
    assert np.ptp(px) > 1.0


@pytest.mark.parametrize("n_steps", [512, 1024])
def test_newton_on_blocks_goes_on_to_round_off(n_steps):
    """x'' + sin x = 0, x(0) = 0, x'(0) = 2: x = 2 asin(tanh t). e^12 units of round-off: 4e-11.

    Single steps leave 2e-11 on any mesh. Blocks lose a few units more, in products of up to 512
    terms; those that stop a digit earlier leave 8.6e-10.
    """
    scene, singly = swing(T=12.0, x=0.0, v=2.0), mesh_of(np.linspace(0.0, 12.0, n_steps + 1))
    for steps, units in ((n_steps, 6), (singly, 1)):
        trajectory = integrate(scene, Method(cq="gauss", degree=4), steps)
        exact = 2 * np.arcsin(np.tanh(trajectory.time))
        error = np.abs(trajectory.position[:, 0] - exact).max()
        assert error < units * np.exp(12.0) * np.finfo(float).eps


@spread(few=4, seed=range(40), stages=[1, 2, 3, 4])
def test_the_energy_that_is_lost_is_the_work_of_the_damping(seed, stages):
    """With the force written out; at rest the work of any past is not negative."""
    rng, n_steps = np.random.default_rng(seed), 32
    shape = replace(shape_of("coupled", rng, n_steps), breaks=None, derivative="caputo")
    scene = scene_of("coupled", replace(shape, orders=shape.orders or (0.7,)), rng)
    if seed % 2:
        scene = replace(scene, initial_velocity=np.zeros(scene.dimension))
    found = integrate(scene, Method(cq="gauss", degree=stages), n_steps, with_steps=True)
    h, method, rate = scene.final_time / n_steps, tableau("gauss", stages), found.steps.velocity

    def work(shift: float) -> float:
        total = 0.0
        for term in scene.damping:
            moving = rate - (scene.initial_velocity if term.order > 1 else 0.0)
            force = left_operator_rk(method, term.order - 1.0 + shift, h, moving)
            power = np.einsum("kid,de,kie->ki", rate, term.matrix, force)
            total += h * float((power @ method.b).sum())
        return total

    lost = found.energy[0] - found.energy[-1]
    size = float(found.energy.max()) + abs(work(0.0))
    assert abs(lost - work(0.0)) <= 1e-11 * size
    assert not seed % 2 or work(0.0) >= -1e-13 * size
    # the control: another order
    assert abs(lost - work(1e-4)) > 1e-9 * size
