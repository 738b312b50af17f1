"""Structure on random linear scenes: what holds exactly, and controls that must break it.

A few examples each time, many with ``-m slow``.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from letters import spring
from written_out import left_operator_rk

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.prediction import predict_stability
from fvi_cli.mathematics.runge_kutta import gauss_tableau

Array = np.ndarray

ORDERS = st.sampled_from([0.07, 0.3, 0.5, 0.8, 0.95, 1.0, 1.1, 1.25, 1.5, 1.75, 1.9])
SEEDS = st.integers(0, 2**32 - 1)

METHODS = (
    Method(cq="gauss", degree=1),
    Method(cq="gauss", degree=2),
    Method(cq="gauss", degree=3),
    Method(cq="gauss", degree=3, start="graded"),
    Method(cq="lobatto-iiic", degree=2),
    Method(cq="radau-iia", degree=2),
    Method(cq="bdf2", degree=1, forcing_quadrature="exact"),
    Method(cq="bdf4", degree=2, forcing_quadrature="exact"),
    Method(cq="bdf1", degree=1, sampling="nodes"),
)


def positive(rng: np.random.Generator, d: int, least: float, most: float) -> Array:
    """A random symmetric matrix with eigenvalues between `least` and `most`."""
    rotation = np.linalg.qr(rng.normal(size=(d, d)))[0]
    matrix = rotation @ np.diag(rng.uniform(least, most, d)) @ rotation.T
    return 0.5 * (matrix + matrix.T)


def random_scene(seed: int, d: int, orders: tuple[float, ...], *, velocity: bool = True) -> Scene:
    """Matrices that do not commute, and start values of order 1."""
    rng = np.random.default_rng(seed)
    mass, stiffness = positive(rng, d, 0.5, 2.0), positive(rng, d, 0.2, 5.0)
    damping = [(order, positive(rng, d, 0.1, 0.8)) for order in orders]
    start = {"x": rng.normal(size=d), "v": rng.normal(size=d) if velocity else np.zeros(d)}
    return spring(*damping, T=float(rng.uniform(2.0, 6.0)), m=mass, k=stiffness, **start)


# 1. the energy that is lost is the work of the damping


def check_dissipation(
    seed: int, d: int, orders: list[float], stages: int, n_steps: int, velocity: bool
) -> None:
    scene = random_scene(seed, d, tuple(orders), velocity=velocity)
    found = integrate(scene, Method(cq="gauss", degree=stages), n_steps, with_steps=True)
    assert found.momentum is not None
    h, tableau = scene.final_time / n_steps, gauss_tableau(stages)
    rate = found.steps.velocity

    def work(shift: float) -> float:
        total = 0.0
        for term in scene.damping:
            moving = rate - (scene.initial_velocity if term.order > 1 else 0.0)
            force = left_operator_rk(tableau, term.order - 1.0 + shift, h, moving)
            power = np.einsum("kid,de,kie->ki", rate, term.coefficient, force)
            total += h * float((power @ tableau.b).sum())
        return total

    energy = scene.energy(found.position, found.momentum)
    size = float(energy.max()) + abs(work(0.0))
    assert abs(energy[-1] - energy[0] + work(0.0)) <= 1e-11 * size
    if not velocity or max(orders) <= 1:
        assert work(0.0) >= -1e-13 * size
    assert abs(energy[-1] - energy[0] + work(1e-4)) > 1e-9 * size


def flow(scene: Scene, method: Method, n_steps: int) -> Callable[[Array], Array]:
    """Position and momentum at the start to those at the end."""
    d = scene.dimension

    def end(state: Array) -> Array:
        rate = np.linalg.solve(scene.inertia.mass, state[d:])
        moved = dataclasses.replace(scene, initial_position=state[:d], initial_velocity=rate)
        trajectory = integrate(moved, method, n_steps)
        return np.concatenate([trajectory.position[-1], trajectory.momentum[-1]])

    return end


# 2. units


def in_units(scene: Scene, *, second: float = 1.0, metre: float = 1.0, gram: float = 1.0) -> Scene:
    """The same scene by other measures: t second, x metre, m gram."""
    potential = scene.potential
    return dataclasses.replace(
        scene,
        inertia=Inertia(mass=gram * scene.inertia.mass),
        potential=QuadraticPotential(stiffness=gram * second**-2 * potential.stiffness),
        damping=tuple(
            FractionalDamping(
                order=term.order, coefficient=gram * second ** (term.order - 2) * term.coefficient
            )
            for term in scene.damping
        ),
        initial_position=metre * scene.initial_position,
        initial_velocity=metre / second * scene.initial_velocity,
        final_time=second * scene.final_time,
    )


def check_units(
    seed: int, d: int, orders: list[float], index: int, n_steps: int, power: int, other: int
) -> None:
    scene, method = random_scene(seed, d, tuple(orders)), METHODS[index]
    assume(predict_stability(scene, method, n_steps).verdict == "stable")
    plain = integrate(scene, method, n_steps)
    assert plain.momentum is not None
    size = np.abs(plain.position).max()
    # powers of two change no digit but those that a power h^-gamma or a logarithm rounds
    metre, gram = 2.0**power, 4.0**other
    same = integrate(in_units(scene, metre=metre, gram=gram), method, n_steps)
    assert np.abs(same.position / metre - plain.position).max() <= 1e-12 * size
    if method.start == "none":
        assert np.array_equal(
            integrate(in_units(scene, metre=metre), method, n_steps).position,
            metre * plain.position,
        )
    second = 4.0**other
    slow = in_units(scene, second=second)
    found = integrate(slow, method, n_steps)
    assert found.momentum is not None
    assert np.abs(found.position - plain.position).max() <= 1e-11 * size
    momentum = found.momentum * second - plain.momentum
    assert np.abs(momentum).max() <= 1e-11 * np.abs(plain.momentum).max()
    # any measure, up to round-off of its own
    everything = in_units(scene, second=3.7, metre=1e-9, gram=1e5)
    found = integrate(everything, method, n_steps)
    assert np.abs(found.position / 1e-9 - plain.position).max() <= 1e-10 * size
    first, *others = everything.damping
    wrong = FractionalDamping(order=first.order, coefficient=1.001 * first.coefficient)
    found = integrate(dataclasses.replace(everything, damping=(wrong, *others)), method, n_steps)
    assert np.abs(found.position / 1e-9 - plain.position).max() > 1e-7 * size


SHARED = {
    "seed": SEEDS,
    "d": st.integers(1, 3),
    "orders": st.lists(ORDERS, min_size=1, max_size=2, unique=True),
    "n_steps": st.integers(12, 48),
}
OF_UNITS = {
    "index": st.integers(0, len(METHODS) - 1),
    "power": st.integers(-60, 60),
    "other": st.integers(-20, 20),
}
PROPERTIES = {
    "dissipation": (
        {**SHARED, "stages": st.integers(1, 4), "velocity": st.booleans()},
        check_dissipation,
    ),
    "units": ({**SHARED, **OF_UNITS}, check_units),
}
"""What is drawn for every law, and the check of one example."""


def run(name: str, examples: int) -> None:
    limited = settings(
        max_examples=examples,
        derandomize=True,
        database=None,
        deadline=None,
        phases=(Phase.explicit, Phase.generate),
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
    )
    drawn, check = PROPERTIES[name]
    limited(given(**drawn)(check))()


@pytest.mark.parametrize("name", PROPERTIES)
def test_law(name):
    run(name, 6)


@pytest.mark.slow
@pytest.mark.parametrize("name", PROPERTIES)
def test_law_on_many_scenes(name):
    run(name, 150)
