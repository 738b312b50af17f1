"""Without damping: symplectic, reversible, energy without drift, momenta kept.

Flows are differentiated by central differences of order 8, whose truncation and rounding are both
below 1e-12 for the distance that is taken.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from letters import swing
from numpy.typing import NDArray
from spread import spread

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.scenes.registry import build_problem

Array = NDArray[np.float64]

STENCIL = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
PENDULUM_PERIOD = 6.699975664370452  # 4 K(sin(1/2)), amplitude 1

METHODS = [
    Method(cq="gauss", degree=1, start="none"),
    Method(cq="gauss", degree=2, start="none"),
    Method(cq="gauss", degree=3, start="none"),
    Method(cq="bdf2", degree=1, sampling="nodes"),
    Method(cq="bdf4", degree=2, sampling="points"),
]


def scene_of(**specification: Any) -> Scene:
    problem = build_problem(specification)
    return problem.scene


# scene, number of steps, distance of the differences
FLOWS: dict[str, tuple[Scene, int, float]] = {
    "pendulum": (
        scene_of(kind="pendulum", initial={"position": 1.0, "velocity": 0.3}, final_time=3.0),
        24,
        6e-3,
    ),
    "duffing": (
        scene_of(
            kind="duffing",
            stiffness=-1.0,
            initial={"position": 0.5, "velocity": 0.3},
            final_time=3.0,
        ),
        24,
        6e-3,
    ),
    "kepler": (
        scene_of(
            kind="kepler", initial={"position": [1.0, 0.0], "velocity": [0.0, 1.1]}, final_time=0.5
        ),
        8,
        6e-3,
    ),
    "double-pendulum": (
        scene_of(
            kind="double-pendulum",
            initial={"position": [1.0, -0.5], "velocity": [0.1, 0.2]},
            final_time=3.0,
        ),
        24,
        6e-3,
    ),
}


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


def jacobian(function: Callable[[Array], Array], state: Array, distance: float) -> Array:
    columns = [
        sum(
            weight * (function(state + k * unit) - function(state - k * unit))
            for k, weight in enumerate(STENCIL, start=1)
        )
        / distance
        for unit in distance * np.eye(state.size)
    ]
    return np.array(columns).T


def symplecticity_defect(scene: Scene, method: AnyMethod, n_steps: int, distance: float) -> float:
    d = scene.dimension
    zero, one = np.zeros((d, d)), np.eye(d)
    structure = np.block([[zero, one], [-one, zero]])
    derivative = jacobian(lambda z: flow(scene, method, n_steps, z), start_of(scene), distance)
    return float(np.abs(derivative.T @ structure @ derivative - structure).max())


@spread(few=2, name=FLOWS, method=METHODS)
def test_flow_is_symplectic(name, method):
    assert symplecticity_defect(FLOWS[name][0], method, *FLOWS[name][1:]) < 1e-12


def test_other_flows_are_not_symplectic():
    scene, n_steps, distance = FLOWS["pendulum"]
    euler = Baseline(name="implicit-euler")
    assert symplecticity_defect(scene, euler, n_steps, distance) > 1e-2
    damped = scene_of(
        kind="pendulum",
        damping=[{"order": 0.5, "coefficient": 1e-6}],
        initial={"position": 1.0, "velocity": 0.3},
        final_time=3.0,
    )
    assert symplecticity_defect(damped, METHODS[1], n_steps, distance) > 1e-7


@spread(name=FLOWS, method=METHODS)
def test_backwards_in_time_leads_to_the_start(name, method):
    scene, n_steps, _ = FLOWS[name]
    turn = np.repeat([1.0, -1.0], scene.dimension)
    start = start_of(scene)
    end = flow(scene, method, n_steps, start)
    assert np.abs(turn * flow(scene, method, n_steps, turn * end) - start).max() < 1e-12
    assert np.abs(end - start).max() > 0.1


def test_implicit_euler_does_not_lead_back():
    scene, n_steps, _ = FLOWS["pendulum"]
    euler, turn = Baseline(name="implicit-euler"), np.array([1.0, -1.0])
    start = start_of(scene)
    end = flow(scene, euler, n_steps, start)
    assert np.abs(turn * flow(scene, euler, n_steps, turn * end) - start).max() > 1e-2


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
    slope, _ = energy_slope(Baseline(name="implicit-euler"), 500)
    assert slope < -1e-3


@pytest.mark.few(2)
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.case)
def test_angular_momentum_of_kepler_is_kept(method):
    """Twenty times round an ellipse of eccentricity 0.36."""
    scene = scene_of(
        kind="kepler", initial={"position": [1.0, 0.0], "velocity": [0.0, 0.8]}, final_time=100.0
    )
    trajectory = integrate(scene, method, 3000)
    (x, y), (px, py) = trajectory.position.T, trajectory.momentum.T
    assert np.abs(x * py - y * px - 0.8).max() < 1e-12
    assert np.ptp(px) > 1.0
