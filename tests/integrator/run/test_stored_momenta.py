"""Momenta and energies at mesh points against the motion, for all orders above 1: a class."""

import numpy as np
import pytest
from letters import spring, swing
from numpy.typing import NDArray
from oracles.volterra import solve_volterra
from spread import spread

import fvi_cli as fvi
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import uniform_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.steps import RunSteps

Array = NDArray[np.float64]

FINAL_TIME, SPEED = 1.2, 0.3
ORDERS = (1.05, 1.2, 1.4, 1.6, 1.75, 1.9, 1.99)
GRADED, EQUAL = "gauss4-graded", Method(cq="gauss", degree=4, start="none")


def scene_of(derivative: str, *terms: tuple[float, float]) -> Scene:
    place = -1.375 if derivative == "caputo" else 0.0
    return swing(*terms, T=FINAL_TIME, x=place, v=SPEED, derivative=derivative)


def errors(scene: Scene, terms: tuple[tuple[float, float], ...], run: fvi.Trajectory) -> Array:
    """Of stored momenta and energies, relative, away from the start; shape ``(2,)``."""
    late = run.time > 0.1 * FINAL_TIME
    x0, v0 = scene.initial_position, scene.initial_velocity
    known = solve_volterra(
        1.0,
        terms,
        np.sin,
        lambda x: np.cos(x)[..., None],
        None,
        x0,
        v0,
        FINAL_TIME,
        derivative=scene.derivative,
    )
    x, v = known.position(run.time[late])[:, 0], known.velocity(run.time[late])[:, 0]
    energy = v**2 / 2 + 1 - np.cos(x)
    momentum = np.abs(run.momentum[late, 0] - v).max() / np.abs(v).max()
    return np.array([momentum, np.abs(run.energy[late] - energy).max() / energy.max()])


@spread(few=1, derivative=["caputo", "riemann-liouville"], order=ORDERS)
def test_stored_momenta_and_energies_are_those_of_the_motion(derivative, order):
    terms = ((order, 0.4), (0.6, 0.1)) if order in ORDERS[::2] else ((order, 0.4),)
    scene = scene_of(derivative, *terms)
    most = 1e-10 if derivative == "caputo" else 3e-8
    assert errors(scene, terms, fvi.integrate(scene, GRADED, 64)).max() < most
    thinned = fvi.integrate(scene, GRADED, 64, every=3)
    assert errors(scene, terms, thinned).max() < most
    adaptive = fvi.integrate(scene, "gauss4", fvi.AdaptiveSteps(tolerance=1e-9))
    assert errors(scene, terms, adaptive).max() < 1e-7


@pytest.mark.few(1)
@pytest.mark.parametrize("order", [1.6, 1.9])
def test_the_error_is_seen_without(order, monkeypatch):
    """The control: the momenta of the recursion."""
    monkeypatch.setattr(RunSteps, "momenta_of_polynomials", lambda self, _: self.momentum)
    run = fvi.integrate(scene_of("riemann-liouville", (order, 0.4)), GRADED, 64)
    assert errors(scene_of("riemann-liouville", (order, 0.4)), ((order, 0.4),), run).max() > 3e-8


@pytest.mark.parametrize("order", [1.3, pytest.param(1.95, marks=pytest.mark.slow)])
def test_members_of_a_sweep_have_the_momenta_of_single_runs(order):
    scenes = [scene_of("riemann-liouville", (order, c)) for c in np.linspace(0.1, 0.5, 20)]
    for scene, run in zip(scenes, fvi.integrate_members(scenes, GRADED, 32), strict=True):
        alone = fvi.integrate(scene, GRADED, 32)
        assert np.abs(run.momentum - alone.momentum).max() < 1e-13


@pytest.mark.parametrize("count", [2, 3])
def test_components_that_nothing_joins_have_the_momenta_of_single_runs(count):
    stiffness, damping, speed = np.random.default_rng(count).uniform(0.5, 2.0, (3, count))
    data = {"T": FINAL_TIME, "derivative": "riemann-liouville"}
    unit, rest = np.eye(count), np.zeros(count)
    every = spring((1.6, np.diag(damping)), m=unit, k=np.diag(stiffness), x=rest, v=speed, **data)
    run = fvi.integrate(every, GRADED, 32)
    for place, momentum in enumerate(run.momentum.T):
        one = spring((1.6, damping[place]), k=stiffness[place], x=0.0, v=speed[place], **data)
        alone = fvi.integrate(one, GRADED, 32).momentum[:, 0]
        assert np.abs(momentum - alone).max() < 1e-13


def test_other_motions_keep_the_momenta_of_the_recursion(monkeypatch):
    rest = swing((1.75, 0.4), T=FINAL_TIME, derivative="riemann-liouville", forcing="sin(t)")
    several = [scene_of("caputo", (1.75, 0.4)), scene_of("riemann-liouville", (0.7, 0.4)), rest]
    runs = [fvi.integrate(scene, GRADED, 32) for scene in several]
    monkeypatch.setattr(RunSteps, "momenta_of_polynomials", lambda self, _: self.momentum)
    for scene, run in zip(several, runs, strict=True):
        assert np.array_equal(fvi.integrate(scene, GRADED, 32).momentum, run.momentum)
        assert not run.remarks


def test_equal_steps_have_errors_of_their_order():
    scene = scene_of("riemann-liouville", (1.5, 0.4))
    found = [
        errors(scene, ((1.5, 0.4),), integrate(scene, EQUAL, uniform_mesh(FINAL_TIME, n)))[0]
        for n in (40, 80)
    ]
    # positions have h**(3 - order) of the first step; the recursion has h**(2 - order)
    assert found[1] < 0.45 * found[0]
