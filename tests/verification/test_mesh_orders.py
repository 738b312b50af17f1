"""Orders of Gauss methods on meshes that are graded, over all points of the mesh or of the grid.

Slopes are fitted through four errors or more and are neither less nor more than 2m. (With m = 4 and
orders of damping above 1 a second part of the error, of order m + 5 - gamma, shows below 1e-11; the
scenes here stay above that.)
"""

import functools
import math
from collections.abc import Callable, Sequence

import mpmath
import numpy as np
import pytest
from letters import spring, swing
from oracles.contour import talbot_inverse
from oracles.linear_response import match_scene
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import Mesh, graded_mesh, mesh_of
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.data import duffing

Array = np.ndarray
Exact = Callable[[Array], Array]

ORDERS = [0.3, 0.5, 1.25, 1.5, 1.9]
STAGES = [1, 2, 3, 4]


def damping(order: float, coefficient: float) -> list[FractionalDamping]:
    return [FractionalDamping(order=order, coefficient=coefficient)]


def singular(order: float, final_time: float, mu: float) -> tuple[Scene, Exact]:
    """A motion that begins with t^(3 - gamma) or t^(4 - gamma)."""
    scene = spring(T=final_time, k=2.0, x=1.0, v=0.5, damping=damping(order, mu))
    found = match_scene(scene)
    return scene, found.position


@functools.cache
def smooth(order: float) -> tuple[Scene, Array, Array]:
    """A motion from rest under t^9 exp(-t), with its values at T / 4 and 9 T / 16."""
    scene = spring(T=30.0, k=2.0, damping=damping(order, 0.7), forcing="t**9*exp(-t)/1e5")
    times = 30.0 * np.array([1 / 4, 9 / 16])

    def transform(s: mpmath.mpc) -> mpmath.mpc:
        force = mpmath.factorial(9) / mpmath.mpf(10) ** 5 / (s + 1) ** 10
        return force / (s**2 + mpmath.mpf("0.7") * s ** mpmath.mpf(order) + 2)

    return scene, times, talbot_inverse(transform, times.tolist(), largest_frequency=2.0)


@functools.cache
def nonlinear(name: str, order: float) -> tuple[Scene, Exact]:
    """A pendulum or Duffing oscillator, with a run of 12 stages on an unrelated mesh."""
    data = {
        "final_time": 16.0,
        "damping": damping(order, 0.1),
        "initial_position": 1.0,
        "initial_velocity": 0.5,
    }
    scene = duffing(**data) if name == "duffing" else swing(omega=1.5, **data)
    method = Method(cq="gauss", degree=12)
    found = integrate(scene, method, AdaptiveSteps(tolerance=1e-11), with_steps=True)
    return scene, found.steps


def error(scene: Scene, exact: Exact, method: Method, steps: Mesh | int) -> float:
    found = integrate(scene, method, steps)
    assert found.status == "ok"
    return float(np.abs(found.position - exact(found.time)).max())


def slope(numbers: Sequence[int], errors: Sequence[float]) -> float:
    assert len(numbers) >= 4
    return float(-np.polyfit(np.log(numbers), np.log(errors), 1)[0])


def grading(order: float, m: int) -> float:
    """r with r sigma > 2m, sigma the power with which the motion begins."""
    return max(1.2, (2 * m + 0.5) / ((3 if order < 1 else 4) - order))


NUMBERS = (48, 64, 96, 128)


@spread(few=2, order=ORDERS, m=STAGES)
def test_singular_motions_on_graded_meshes(order, m):
    scene, exact = singular(order, 8.0, 0.7)
    method, r = Method(cq="gauss", degree=m), grading(order, m)
    errors = [error(scene, exact, method, graded_mesh(8.0, n, r)) for n in NUMBERS]
    assert slope(NUMBERS, errors) == pytest.approx(2 * m, abs=0.1)


@spread(few=2, order=ORDERS, m=STAGES)
def test_smooth_motions_on_graded_meshes(order, m):
    scene, times, values = smooth(order)
    numbers = (240, 300, 360, 480) if m == 1 else (96, 128, 160, 192)
    errors = []
    for n in numbers:
        found = integrate(scene, Method(cq="gauss", degree=m), graded_mesh(30.0, n, 2.0))
        places = [n // 2, 3 * n // 4]
        assert np.allclose(found.time[places], times, rtol=1e-14)
        errors.append(float(np.abs(found.position[places, 0] - values).max()))
    assert slope(numbers, errors) == pytest.approx(2 * m, abs=0.15)


@spread(few=2, order=ORDERS, m=[3, 4])
def test_finer_steps_inside_the_first_one_alone_are_not_enough(order, m):
    """The control: the step after them is as long as its distance from the singular point."""
    scene, exact = singular(order, 8.0, 0.7)
    errors = []
    for n in (48, 96, 192, 384):
        h = 8.0 / n
        inside = h * 2.0 ** np.arange(-40.0, 0.0)
        mesh = mesh_of(np.concatenate([[0.0], inside, h * np.arange(1, n + 1)]))
        found = integrate(scene, Method(cq="gauss", degree=m), mesh)
        whole = found.position[-n:] - exact(found.time[-n:])
        errors.append(float(np.abs(whole).max()))
    late = slope((48, 96, 192, 384), errors)
    assert late < 2 * m - 1
    assert math.log2(errors[-2] / errors[-1]) == pytest.approx(
        (3 if order < 1 else 4) - order, abs=0.3
    )


QUICK = (("pendulum", 0.5, 2), ("pendulum", 1.9, 4), ("duffing", 0.3, 4), ("duffing", 1.25, 2))
NONLINEAR = [
    pytest.param(name, order, m, marks=() if quick else pytest.mark.slow)
    for name in ("pendulum", "duffing")
    for order in ORDERS
    for m in STAGES
    for quick in [(name, order, m) in QUICK]
]


@pytest.mark.few(1)
@pytest.mark.parametrize(("name", "order", "m"), NONLINEAR)
def test_nonlinear_motions(name, order, m):
    scene, exact = nonlinear(name, order)
    r = grading(order, m)
    numbers = (128, 160, 192, 224)
    method = Method(cq="gauss", degree=m)
    errors = [error(scene, exact, method, graded_mesh(16.0, n, r)) for n in numbers]
    # long last steps of a strong grading, and not yet as small as they should be
    assert slope(numbers, errors) == pytest.approx(2 * m, abs=0.4 if r > 4 else 0.15)
    numbers = (48, 64, 80, 96)
    method = Method(cq="gauss", degree=m, start="graded")
    errors = [error(scene, exact, method, n) for n in numbers]
    assert slope(numbers, errors) == pytest.approx(2 * m, abs=0.15)
