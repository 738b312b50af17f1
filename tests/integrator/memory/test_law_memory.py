"""Relaxation laws on any mesh, against functions of the mesh's matrix and exact solutions."""

from dataclasses import replace
from functools import cache

import mpmath as mp
import numpy as np
import pytest
from letters import spring, swing
from mesh_powers import Array, mesh_function, meshes
from oracles.contour import talbot_inverse
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws import ColeCole, PronyKernel, RelaxationKernel, fractional_zener, prony
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.memory.exponentials import Exponentials as ExponentialMemory
from fvi_cli.integrator.memory.interface import Direction
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.lagrangian import lagrangian_scene


def cole_cole(s: mp.mpc, order: float, time: float) -> mp.mpc:
    power = (s * mp.mpf(time)) ** mp.mpf(order)
    return power / (s * (1 + power))


def exact_transform(kernel: RelaxationKernel, s: mp.mpc) -> mp.mpc:
    if isinstance(kernel, ColeCole):
        return cole_cole(s, kernel.order, kernel.time)
    return mp.fsum(mp.mpf(weight) / (s + mp.mpf(rate)) for rate, weight in kernel.masses)


def every_block(kernel: RelaxationKernel, beside: float, steps: Array, m: int) -> Array:
    """The matrix of a law on a mesh, from tables that it shares with a power."""
    n = len(steps)
    memory = ExponentialMemory(
        Method(cq="gauss", degree=m),
        [beside, kernel],
        shortest_step=float(steps.min()),
        final_time=float(steps.sum()),
        steps=n,
    )
    law = Direction(places=np.array([[1]]), factors=np.ones((1, 1)), matrix=np.ones((1, 1, 1)))
    whole = np.zeros((n, m, n, m))
    tables = [memory.kernels(float(h), 1, (law,)) for h in steps]
    for first in range(n):
        whole[first, :, first] = tables[first].sequences[0][0, 0]
        inputs = np.eye(m)[:, :, None]
        states = tables[first].push(np.zeros((m, memory.n_states, 1)), inputs, 1)
        for later in range(first + 1, n):
            whole[later, :, first] = tables[later].past([states], 1)[..., 0].T
            states = tables[later].push(states, np.zeros((m, m, 1)), 1)
    return whole


@spread(
    kind=["uniform", "random", "geometric"],
    m=[2, 5],
    kernel=[
        ColeCole(order=0.05, time=0.3),
        ColeCole(order=0.675, time=0.3),
        ColeCole(order=0.9, time=1e-9),
        ColeCole(order=0.97, time=50.0),
        ColeCole(order=0.5, time=1e7),
        PronyKernel(masses=((10.0, 1.0), (1.0, 0.5))),
    ],
)
def test_every_block_of_a_law_is_that_function_of_the_mesh(kernel, m, kind):
    n = 7 if m == 2 else 3
    steps = meshes(n)[kind]
    exact = mesh_function(steps, m, lambda value: exact_transform(kernel, 1 / value))
    whole = every_block(kernel, 0.5, steps, m)
    errors = np.abs(whole - exact.reshape(whole.shape)).max(axis=(1, 3))
    sizes = np.abs(exact.reshape(whole.shape)).max(axis=(1, 3))
    # what a law has forgotten counts against what it began with
    sizes = np.maximum(sizes, 1e-8 * sizes.max())
    lower = np.tril_indices(n)
    assert (errors[lower] / sizes[lower]).max() < 2e-12


SCENE = Scene(
    inertia=Inertia(mass=1.0),
    initial_position=1.0,
    initial_velocity=0.5,
    final_time=6.0,
    laws=(fractional_zener(order=0.675, time=0.3, relaxed=2.0, unrelaxed=7.0, coefficient=1.0),),
)
PLACES = np.linspace(0.5, 6.0, 12)


@cache
def oracle() -> Array:
    """By the contour of Talbot, 60 terms and more."""

    def transform(s: mp.mpc) -> mp.mpc:
        law = 5 * s * cole_cole(s, 0.675, 0.3)
        return (s + 0.5 + law / s) / (s * s + 2 + law)

    return talbot_inverse(transform, list(PLACES), largest_frequency=3.0)


def largest_error(n_steps: int, degree: int) -> float:
    run = integrate(SCENE, Method(cq="gauss", degree=degree, start="graded"), n_steps)
    at = [int(np.abs(run.time - time).argmin()) for time in PLACES]
    return float(np.abs(run.position[at, 0] - oracle()).max())


@pytest.mark.parametrize(("degree", "n_steps"), [(2, 24), (3, 24), (4, 24)])
def test_a_fractional_zener_oscillator_has_full_order(degree, n_steps):
    errors = [largest_error(n_steps * factor, degree) for factor in (1, 2)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * degree, abs=0.1)


LAWS = (
    fractional_zener(order=0.6, time=0.4, relaxed=1.0, unrelaxed=4.0, coefficient=1.0),
    prony(moduli=[1.0, 0.5], times=[0.5, 1.0], coefficient=1.0, relaxed=0.5),
)
MATRIX = np.array([[1.0, -1.0], [-1.0, 1.0]])
ZENER = fractional_zener(order=0.6, time=0.4, relaxed=1.0, unrelaxed=4.0, coefficient=MATRIX)
SCENES = {
    "pendulum": swing(T=8.0, x=1.0, v=0.3, laws=LAWS),
    "general": lagrangian_scene(
        coordinates=("x", "y"),
        lagrangian="(1 + x**2/4)*vx**2/2 + vy**2/2 - x**2 - y**2/2",
        initial_position=[1.0, 0.0],
        initial_velocity=[0.0, 0.5],
        final_time=6.0,
        laws=(ZENER,),
        damping=[FractionalDamping(order=0.5, coefficient=0.2 * np.eye(2))],
    ),
    # a column carries the start velocity for the derivative of order 3/2, and not for the law
    "beside orders above 1": spring(
        (1.5, 0.3 * np.eye(2)),
        T=10.0,
        m=np.eye(2),
        k=2.0 * np.eye(2),
        x=[1.0, 0.5],
        v=[0.3, 0.0],
        laws=(ZENER,),
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_laws_have_full_order_in_every_kind_of_scene(name):
    scene, errors = SCENES[name], []
    fine = integrate(scene, Method(cq="gauss", degree=7, start="graded"), 96)
    for n_steps in (24, 48):
        run = integrate(scene, Method(cq="gauss", degree=3, start="graded"), n_steps)
        errors.append(float(np.abs(run.position - fine.position[:: 96 // n_steps]).max()))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6.0, abs=0.15)


def test_few_adaptive_steps_reach_the_oracle():
    method = Method(cq="gauss", degree=5, start="graded")
    run = integrate(SCENE, method, AdaptiveSteps(tolerance=1e-7))
    assert run.n_steps <= 52
    assert run.position[-1, 0] == pytest.approx(oracle()[-1], abs=4e-13)


@pytest.mark.parametrize("steps", [40, AdaptiveSteps(tolerance=1e-4)])
def test_energy_with_what_the_law_stores_falls_in_every_step(steps):
    method = Method(cq="gauss", degree=3, start="graded")
    run = integrate(SCENE, method, steps, diagnostics=True)
    stored = run.diagnostics.stored_energy
    assert stored.max() > 0.1
    total = run.energy + stored
    assert np.diff(total).max() < 1e-14
    # the mechanical energy alone gets back what was stored
    assert np.diff(run.energy).max() > 1e-3


@pytest.mark.parametrize("power", [-300, -60, -4, 20, 150, 300])
def test_laws_of_any_time_have_rates_that_numbers_hold(power):
    """Against the Laplace transform of the motion, inverted in extended precision."""
    order = (0.05, 0.5, 0.95)[power % 3]
    law = fractional_zener(
        order=order, time=10.0**power, relaxed=0.0, unrelaxed=3.0, coefficient=1.0
    )
    scene = replace(spring(k=6.0, x=1.0, v=0.0, T=5.0), laws=(law,))
    done = integrate(
        scene, Method(cq="gauss", degree=8, start="none"), AdaptiveSteps(tolerance=1e-9)
    )

    def transform(s: mp.mpc) -> mp.mpc:
        modulus = 3 * s * cole_cole(s, order, mp.mpf(10) ** power)
        return (s + modulus / s) / (s**2 + modulus + 6)

    with mp.workdps(60):
        exact = float(mp.invertlaplace(transform, 5.0, method="talbot", degree=60))
    assert done.position[-1, 0] == pytest.approx(exact, abs=1e-11)
