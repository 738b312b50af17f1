"""Meshes as values: points, shares, and equal steps that are halved towards singular points."""

import math

import numpy as np
import pytest
from letters import spring
from oracles.linear_response import match_scene
from spread import spread

from fvi_cli.effects.forcing import Forcing
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.graded import (
    WINDOW_SHARE,
    graded_start_mesh,
    start_power,
)
from fvi_cli.integrator.meshes.mesh import (
    Mesh,
    graded_mesh,
    mesh_of,
    misplaced_break_point,
    share_steps,
    uniform_mesh,
)
from fvi_cli.integrator.method import Method


def fresh(mesh: Mesh) -> list[float]:
    """Times at which the motion may be singular."""
    return [one.begin for one in mesh.stretches if one.is_fresh]


def test_break_points_on_the_grid_leave_the_steps_equal():
    # 0.1 * 3 is not 0.3 in binary numbers
    mesh = uniform_mesh(1.0, 10, (0.1 * 3, 0.7))
    assert {one.step_size for one in mesh.stretches} == {0.1}
    assert [one.n_steps for one in mesh.stretches] == [3, 4, 3]
    assert fresh(mesh) == [0.0, 0.1 * 3, 0.7]
    assert not misplaced_break_point((0.1 * 3, 0.7), 1.0, 10)
    assert not misplaced_break_point((0.1 * 3,), 1.0, 10**6)  # number 300,000 but for round-off
    assert "t = 0.7 inside a step" in misplaced_break_point((0.5, 0.7), 1.0, 8)


@spread(breaks=[(0.333,), (0.25, 0.26), (1e-9,), (0.1, 0.2, 0.999)], grading=[1.0, 2.0, 3.5])
def test_break_points_off_the_grid_are_points(breaks, grading):
    mesh = graded_mesh(1.0, 40, grading, breaks)
    assert mesh.n_steps == mesh.times.size - 1 == 40
    assert mesh.times[0] == 0.0
    assert mesh.times[-1] == 1.0
    assert (np.diff(mesh.times) > 0).all()
    assert fresh(mesh) == [0.0, *breaks]
    assert set(breaks) <= set(mesh.times)


@pytest.mark.parametrize("grading", [1.0, 1.5, 2.0, 7.0])
def test_graded_points_are_powers_behind_every_break_point(grading):
    mesh = graded_mesh(5.0, 32, grading, (1.0,))
    counts = share_steps((0.0, 1.0, 5.0), 32)
    first, second = ((np.arange(n + 1) / n) ** grading for n in counts)
    assert np.allclose(mesh.times, [*first[:-1], *(1.0 + 4.0 * second)], rtol=1e-14, atol=0)


def test_a_mesh_goes_through_given_points():
    times = np.array([0.0, 1e-6, 0.3, 0.30001, 2.0])
    mesh = mesh_of(times, (0.3,))
    assert np.array_equal(mesh.times, times)
    assert mesh.shortest_step == 1e-6
    assert fresh(mesh) == [0.0, 0.3]


Array = np.ndarray


def graded(n_steps: int, power: float | None, m: int = 4, breaks: tuple[float, ...] = ()) -> Mesh:
    return graded_start_mesh(uniform_mesh(3.0, n_steps, breaks), stages=m, exponent=lambda _: power)


@spread(n_steps=[1, 2, 3, 8, 17, 100, 1000, 6000], m=[1, 2, 4, 8], power=[1.1, 2.5, 3.5, 3.95])
def test_the_reported_points_are_the_uniform_grid(n_steps, m, power):
    mesh = graded(n_steps, power, m)
    at = mesh.times[mesh.reported]
    assert mesh.n_reported == n_steps == at.size - 1
    assert np.allclose(at, 3.0 / n_steps * np.arange(n_steps + 1), rtol=1e-13, atol=1e-15)
    every = mesh.times
    assert (np.diff(every) > 0).all()
    assert every.size - 1 == mesh.n_steps
    # sizes are halves of halves to the last bit, so that tables are shared
    halvings = [math.log2(3.0 / n_steps / one.step_size) for one in mesh.stretches]
    several = [k for k, one in zip(halvings, mesh.stretches, strict=True) if one.n_steps > 1]
    assert all(k == round(k) for k in several)
    assert fresh(mesh) == [0.0]


@pytest.mark.parametrize(("m", "power"), [(2, 2.5), (3, 2.5), (4, 2.1), (4, 3.7)])
def test_steps_grow_like_those_of_a_graded_mesh(m, power):
    """Behind the first grid point no step is longer than the law of the grading has it."""
    n_steps = 2048
    at, h = graded(n_steps, power, m).times, 3.0 / n_steps
    r = (2 * m + 0.5) / power
    begin, sizes = at[:-1], np.diff(at)
    window = n_steps // WINDOW_SHARE
    inside = (begin >= h) & (begin < window * h * (1 - 1e-9))
    law = h * (begin[inside] / (window * h)) ** (1 - 1 / r)
    assert (sizes[inside] <= 1.01 * law).all()
    # halving: never shorter than a quarter of it
    assert (sizes[inside] >= 0.24 * law).all()
    assert np.allclose(sizes[begin >= window * h * (1 - 1e-9)], h, rtol=1e-9)
    # a control: the first steps of the uniform grid break that law
    assert h > 2 * law[0]


def oscillator(order: float, *, position: float, velocity: float, **more):
    return spring((order, 1.0), T=1.0, x=position, v=velocity, **more)


@pytest.mark.parametrize(
    ("order", "position", "velocity", "derivative", "power"),
    [
        (0.3, 1.0, 0.5, "caputo", 2.7),
        (0.3, 1.0, 0.0, "caputo", 3.7),
        (1.5, 1.0, 0.5, "caputo", 2.5),
        (0.3, 1.0, 0.5, "riemann-liouville", 1.7),
        (0.3, 0.0, 0.5, "riemann-liouville", 2.7),
        (1.5, 0.0, 0.5, "riemann-liouville", 1.5),
        (1.0, 1.0, 0.5, "caputo", None),
    ],
)
def test_the_power_with_which_a_motion_begins(order, position, velocity, derivative, power):
    scene = oscillator(order, position=position, velocity=velocity, derivative=derivative)
    assert start_power(scene, at_start=True) == (
        None if power is None else pytest.approx(power, abs=1e-12)
    )
    if power is not None:
        assert start_power(scene, at_start=False) == pytest.approx(4.0 - order)


@spread(few=1, power=[-0.9, -0.86, -0.8, -0.6], order=[0.5, 1.5])
def test_steep_forces_keep_the_order(power, order):
    force = Forcing.from_text(f"t**({power})")
    scene = oscillator(order, position=0.3, velocity=0.0, forcing=force)
    exact = match_scene(scene).position
    runs = [integrate(scene, Method(cq="gauss", degree=3, start="graded"), n) for n in (50, 100)]
    coarse, fine = (np.abs(one.position - exact(one.time)).max() for one in runs)
    assert coarse < 1e-5
    assert fine < max(coarse / 30, 2e-9)
