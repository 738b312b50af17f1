"""Equal steps that are halved towards singular points."""

import itertools
import math

import numpy as np
import pytest
from letters import spring
from oracles.linear_response import match_scene
from spread import spread
from test_mesh import fresh

from fvi_cli.effects.forcing import Forcing
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.graded import (
    WINDOW_MOST,
    WINDOW_SHARE,
    graded_start_mesh,
    start_power,
)
from fvi_cli.integrator.meshes.mesh import Mesh, uniform_mesh
from fvi_cli.integrator.method import ForcingQuadrature, Method

Array = np.ndarray


def graded(n_steps: int, power: float | None, m: int = 4, breaks: tuple[float, ...] = ()) -> Mesh:
    return graded_start_mesh(uniform_mesh(3.0, n_steps, breaks), stages=m, exponent=lambda _: power)


def reported(mesh: Mesh) -> Array:
    ends = np.cumsum([one.n_steps for one in mesh.stretches])
    kept = [end - one.n_steps + one.reported for end, one in zip(ends, mesh.stretches, strict=True)]
    return mesh.times[np.concatenate([[0], *kept]).astype(int)]


@spread(n_steps=[1, 2, 3, 8, 17, 100, 1000, 6000], m=[1, 2, 4, 8], power=[1.1, 2.5, 3.5, 3.95])
def test_the_reported_points_are_the_uniform_grid(n_steps, m, power):
    mesh = graded(n_steps, power, m)
    at = reported(mesh)
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


def test_a_smooth_start_has_equal_steps():
    assert graded(40, None).stretches == uniform_mesh(3.0, 40).stretches


@pytest.mark.parametrize("breaks", [(1.0,), (0.7123, 2.2), (0.01,)])
def test_steps_are_halved_behind_break_points_too(breaks):
    for n_steps in (12, 96, 1000):
        mesh = graded(n_steps, 2.5, 3, breaks)
        at = mesh.times
        assert mesh.n_reported == n_steps
        assert fresh(mesh) == [0.0, *breaks]
        for begin, end in itertools.pairwise((0.0, *breaks, 3.0)):
            part = at[(at >= begin) & (at <= end)]
            longest, sizes = np.diff(part).max(), np.diff(part)
            assert sizes[0] < 1e-3 * longest
            first = int((part - begin < 0.1 * longest).sum())
            assert first > 4
            # halved steps fill what the one above them left over, so sizes never fall
            assert (sizes[1:first] >= sizes[: first - 1] * (1 - 1e-6)).all()


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


@pytest.mark.parametrize("n_steps", [64, 4096, 2**17])
def test_the_steps_added_are_few(n_steps):
    for m, power in ((2, 3.5), (4, 2.1), (8, 1.1)):
        added = graded(n_steps, power, m).n_steps - n_steps
        window = max(1, min(n_steps // WINDOW_SHARE, WINDOW_MOST))
        grading = (2 * m + 0.5) / power
        # each level halves that share of the steps of the one above
        share = 2.0 ** (-1.0 / (grading - 1.0))
        levels = math.log(window) / -math.log(share) + 1
        assert added <= window / (1.0 - share) + levels + 60


@pytest.mark.parametrize("power", [1.1, 2.5, 3.95])
def test_steps_are_cut_until_the_power_of_t_is_round_off(power):
    mesh = graded(1000, power)
    finest = next(one.step_size for one in mesh.stretches if one.reported_every)
    first, second = (mesh.times[1:3] / finest) ** power
    assert first <= 1e-16 < second


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


def test_forces_may_begin_like_a_power():
    def power(force: str, quadrature: ForcingQuadrature = "galerkin") -> float | None:
        scene = oscillator(1.0, position=0.0, velocity=0.0, forcing=Forcing.from_text(force))
        return start_power(scene, at_start=True, forcing_quadrature=quadrature)

    # the rule of the action errs on the force itself
    assert power("sqrt(t)") == 1.5
    assert power("sqrt(t)", "exact") == 2.5
    assert power("sin(t) + t**2.25") == 3.25
    assert power("sin(t)") is None
    # a force that oscillates ever quicker has no powers: the lowest usual one is taken
    assert power("sin(log(t))") == 1.5
    scene = oscillator(1.9, position=1.0, velocity=0.0, forcing=Forcing.from_text("sqrt(t)"))
    assert start_power(scene, at_start=True) == 1.5


def test_few_steps_before_a_break_are_all_halved():
    """Where a part of the run has a few steps of the grid, all of them are short against t."""
    at = graded(200, 2.5, 3, (0.12,)).times
    first = at[at <= 0.12 * (1 + 1e-12)]
    assert (np.diff(first)[1:] <= 0.5 * 0.015 * (1 + 1e-9)).all()


@spread(few=1, power=[-0.9, -0.86, -0.8, -0.6], order=[0.5, 1.5])
def test_steep_forces_keep_the_order(power, order):
    force = Forcing.from_text(f"t**({power})")
    scene = oscillator(order, position=0.3, velocity=0.0, forcing=force)
    exact = match_scene(scene).position
    runs = [integrate(scene, Method(cq="gauss", degree=3, start="graded"), n) for n in (50, 100)]
    coarse, fine = (np.abs(one.position - exact(one.time)).max() for one in runs)
    assert coarse < 1e-5
    assert fine < max(coarse / 30, 2e-9)
