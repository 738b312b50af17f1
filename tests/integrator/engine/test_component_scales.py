"""Newton's iteration: every component has a scale of its own, every member an end of its own.

Two motions that are not coupled are what each of them is alone, whatever their sizes; those that
are coupled are held against Dormand and Prince's method.
"""

from unittest.mock import patch

import numpy as np
import pytest
from oracles.ordinary import solve_ordinary
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine import newton
from fvi_cli.integrator.integrate import integrate, integrate_members
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.lagrangian import lagrangian_scene

METHODS = [
    Method(cq="gauss", degree=3),
    Method(cq="gauss", degree=2, start="graded"),
    Method(cq="lobatto-iiic", degree=2),
    Method(cq="bdf2", degree=1, sampling="nodes"),
    Method(cq="bdf3", degree=2),
]
# x is linear or not, and never meets y; what y does depends on its energies or on its mass
LAGRANGIANS = {
    "linear beside a pendulum": ("vx**2/2 - x**2/2", "vy**2/2 + cos(y)"),
    "two pendulums": ("vx**2/2 + 1e18*cos(x/1e9)", "vy**2/2 + cos(y)"),
    "mass": ("vx**2/2 - x**2/2", "vy**2*(1 + sin(y)/10)/2 + cos(y)"),
    "fourth power": ("vx**2/2 - x**2/2", "vy**2/2 + vy**4/4 + cos(y)"),
}
STEPS = {"single": 9, "blocks": 400}


def scene(lagrangian: str, *start: tuple[str, float, float], order: float = 0.5) -> Scene:
    names, positions, velocities = zip(*start, strict=True)
    return lagrangian_scene(
        final_time=8.0,
        coordinates=names,
        lagrangian=lagrangian,
        damping=[FractionalDamping(order=order, coefficient=0.1 * np.eye(len(names)))],
        initial_position=positions,
        initial_velocity=velocities,
    )


def pair(kind: str, ratio: float, *, small_first: bool) -> tuple[Scene, Scene, int]:
    """Both motions together, the second alone, and its place among them."""
    large, small = LAGRANGIANS[kind]
    own = [("x", 2.5 * ratio, 0.0), ("y", 2.5, 0.1)]
    if small_first:
        own.reverse()
    return scene(f"{large} + {small}", *own), scene(small, ("y", 2.5, 0.1)), int(not small_first)


@spread(
    kind=list(LAGRANGIANS),
    ratio=[1e-9, 3e-5, 1.0, 7e6, 1e9],
    method=METHODS,
    small_first=[False, True],
    how=list(STEPS),
)
def test_a_motion_does_not_feel_the_size_of_another(kind, ratio, method, small_first, how):
    both, alone, place = pair(kind, ratio, small_first=small_first)
    found = integrate(both, method, STEPS[how])
    expected = integrate(alone, method, STEPS[how])
    assert found.status == expected.status == "ok"
    assert found.position[:, place] == pytest.approx(expected.position[:, 0], abs=2e-12)


def test_a_scale_for_all_is_seen():
    """The control: one scale for all components."""
    largest = newton.largest

    def joint(values):
        found = largest(values)
        return np.broadcast_to(found.max(axis=1, keepdims=True), found.shape).copy()

    both, alone, _ = pair("linear beside a pendulum", 1e9, small_first=False)
    with patch.object(newton, "largest", joint):
        found = integrate(both, METHODS[0], 400)
        members = integrate_members([both, both], METHODS[0], 9)
    expected = integrate(alone, METHODS[0], 400)
    assert np.abs(found.position[:, 1] - expected.position[:, 0]).max() > 1e-8
    expected = integrate(alone, METHODS[0], 9)
    assert np.abs(members[0].position[:, 1] - expected.position[:, 0]).max() > 1e-8


@spread(small=[1e-12, 1e-9, 1e-4], turned=[False, True], n_steps=[40, 640])
def test_the_broken_symmetry_of_a_spring_pendulum(small, turned, n_steps):
    """The swing grows out of a start of 1e-9 by the coupling alone, each digit of it counts."""
    start = [("x", small, 0.0), ("y", -1.3, 0.0)]
    lagrangian = "(vx**2 + vy**2)/2 - 2*(sqrt(x**2 + y**2) - 1)**2 - y/2"
    damped = scene(lagrangian, *(reversed(start) if turned else start), order=1.0)

    def acceleration(t, x, v, z):
        length = np.hypot(*x)
        return -4 * (length - 1) * x / length - np.array([0, 0.5]) - 0.1 * v

    expected = solve_ordinary(acceleration, [small, -1.3], [0, 0], 8.0)
    found = integrate(damped, Method(cq="gauss", degree=6), n_steps)
    path = found.position[:, ::-1] if turned else found.position
    exact = expected.position(found.time)
    assert np.abs(path[:, 0] / small - exact[:, 0] / small).max() < 1e-6
    assert np.abs(path[:, 1] - exact[:, 1]).max() < 1e-9


@pytest.mark.few(2)
@spread(
    **{
        "lagrangian, rate": [
            ("vx**2/2 + vx**4/4 - x**2/2", lambda x, v: -x / (1 + 3 * v * v)),
            ("-sqrt(1 - vx**2) - x**2/2", lambda x, v: -x * (1 - v * v) ** 1.5),
            ("vx**2/2 + vx**4/4 + cos(3*x)", lambda x, v: -3 * np.sin(3 * x) / (1 + 3 * v * v)),
        ]
    },
    speed=[0.1, 0.7, 0.9, 0.99],
    n_steps=[60, 800],
)
def test_kinetic_energies_that_are_not_quadratic(lagrangian, rate, speed, n_steps):
    moving = lagrangian_scene(
        final_time=4.0,
        coordinates=("x",),
        lagrangian=lagrangian,
        initial_position=[0.2],
        initial_velocity=[speed],
    )
    found = integrate(moving, Method(cq="gauss", degree=5), n_steps)
    expected = solve_ordinary(lambda t, x, v, z: rate(x, v), [0.2], [speed], 4.0)
    assert found.status == "ok"
    assert np.abs(found.position - expected.position(found.time)).max() < 1e-7
    assert found.energy == pytest.approx(np.full(found.time.size, found.energy[0]), rel=1e-7)
