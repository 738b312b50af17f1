"""Structure on random linear scenes: what holds exactly, and controls that must break it.

A few examples each time, many with ``-m slow``.
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, assume, given, settings
from hypothesis import strategies as st
from runge_kutta_symbol import tableau
from written_out import left_operator_rk

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.prediction import predict_stability

Array = np.ndarray

ORDERS = st.sampled_from([0.07, 0.3, 0.5, 0.8, 0.95, 1.0, 1.1, 1.25, 1.5, 1.75, 1.9])
SEEDS = st.integers(0, 2**32 - 1)

METHODS = (
    Method(cq="gauss", degree=1),
    Method(cq="gauss", degree=2),
    Method(cq="gauss", degree=3),
    Method(cq="gauss", degree=3, start="graded"),
    Method(cq="lobatto-iiic", degree=2),
    Method(cq="bdf2", degree=1, forcing_quadrature="exact"),
    Method(cq="bdf4", degree=2, forcing_quadrature="exact"),
    Method(cq="bdf1", degree=1, sampling="nodes"),
)


@dataclass(frozen=True)
class Property:
    """A law: what is drawn, and the check of one example."""

    drawn: dict[str, st.SearchStrategy[object]]
    check: Callable[..., None]


def positive(rng: np.random.Generator, d: int, least: float, most: float) -> Array:
    """A random symmetric matrix with eigenvalues between `least` and `most`."""
    rotation = np.linalg.qr(rng.normal(size=(d, d)))[0]
    matrix = rotation @ np.diag(rng.uniform(least, most, d)) @ rotation.T
    return 0.5 * (matrix + matrix.T)


def random_scene(seed: int, d: int, orders: tuple[float, ...], *, velocity: bool = True) -> Scene:
    """Matrices that do not commute, and start values of order 1."""
    rng = np.random.default_rng(seed)
    return Scene(
        inertia=Inertia(mass=positive(rng, d, 0.5, 2.0)),
        potential=QuadraticPotential(stiffness=positive(rng, d, 0.2, 5.0)),
        damping=tuple(
            FractionalDamping(order=order, coefficient=positive(rng, d, 0.1, 0.8))
            for order in orders
        ),
        initial_position=rng.normal(size=d),
        initial_velocity=rng.normal(size=d) if velocity else np.zeros(d),
        final_time=float(rng.uniform(2.0, 6.0)),
    )


def undamped(scene: Scene) -> Scene:
    return dataclasses.replace(scene, damping=())


# 1. the energy that is lost is the work of the damping


def check_dissipation(
    seed: int, d: int, orders: list[float], stages: int, n_steps: int, velocity: bool
) -> None:
    scene = random_scene(seed, d, tuple(orders), velocity=velocity)
    found = integrate(scene, Method(cq="gauss", degree=stages), n_steps, with_steps=True)
    assert found.momentum is not None
    h, method = scene.final_time / n_steps, tableau("gauss", stages)
    rate = found.steps.velocity

    def work(shift: float) -> float:
        total = 0.0
        for term in scene.damping:
            moving = rate - (scene.initial_velocity if term.order > 1 else 0.0)
            force = left_operator_rk(method, term.order - 1.0 + shift, h, moving)
            power = np.einsum("kid,de,kie->ki", rate, term.coefficient, force)
            total += h * float((power @ method.b).sum())
        return total

    energy = scene.energy(found.position, found.momentum)
    size = float(energy.max()) + abs(work(0.0))
    assert abs(energy[-1] - energy[0] + work(0.0)) <= 1e-11 * size
    if not velocity or max(orders) <= 1:
        assert work(0.0) >= -1e-13 * size
    assert abs(energy[-1] - energy[0] + work(1e-4)) > 1e-9 * size


# 2. without damping the flow keeps areas: S^T J S = J


def flow(scene: Scene, method: Method, n_steps: int) -> Callable[[Array], Array]:
    """Position and momentum at the start to those at the end."""
    d = scene.dimension

    def end(state: Array) -> Array:
        rate = np.linalg.solve(scene.inertia.mass, state[d:])
        moved = dataclasses.replace(scene, initial_position=state[:d], initial_velocity=rate)
        trajectory = integrate(moved, method, n_steps)
        return np.concatenate([trajectory.position[-1], trajectory.momentum[-1]])

    return end


def area_defect(jacobian: Array) -> float:
    d = jacobian.shape[0] // 2
    zero, one = np.zeros((d, d)), np.eye(d)
    form = np.block([[zero, one], [-one, zero]])
    return float(np.abs(jacobian.T @ form @ jacobian - form).max())


def check_symplectic(seed: int, d: int, index: int, n_steps: int) -> None:
    scene = random_scene(seed, d, (0.6,))
    method = METHODS[index]
    columns = np.eye(2 * d)
    free = np.stack([flow(undamped(scene), method, n_steps)(e) for e in columns], axis=1)
    assert area_defect(free) <= 1e-11 * max(1.0, np.abs(free).max() ** 2)
    damped = np.stack([flow(scene, method, n_steps)(e) for e in columns], axis=1)
    assert area_defect(damped) > 1e-3


# 3. without damping the way back is the way there


def way_back(scene: Scene, method: Method, n_steps: int) -> float:
    there = integrate(scene, method, n_steps)
    rate = np.linalg.solve(scene.inertia.mass, there.momentum[-1])
    start = dataclasses.replace(scene, initial_position=there.position[-1], initial_velocity=-rate)
    back = integrate(start, method, n_steps)
    return float(
        max(
            np.abs(back.position[::-1] - there.position).max() / np.abs(there.position).max(),
            np.abs(back.momentum[::-1] + there.momentum).max() / np.abs(there.momentum).max(),
        )
    )


def check_reversal(seed: int, d: int, index: int, n_steps: int) -> None:
    scene = random_scene(seed, d, (0.6,))
    free = way_back(undamped(scene), METHODS[index], n_steps)
    assert free < 1e-11
    assert way_back(scene, METHODS[index], n_steps) > 1e-3


# 4. units


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


# 5. the order of the coordinates


def check_permutation(seed: int, d: int, orders: list[float], index: int, n_steps: int) -> None:
    scene, method = random_scene(seed, d, tuple(orders)), METHODS[index]
    # a method that blows up amplifies round-off
    assume(predict_stability(scene, method, n_steps).verdict == "stable")
    new = np.random.default_rng(seed).permutation(d)
    new = np.roll(np.arange(d), 1) if np.array_equal(new, np.arange(d)) else new

    def permuted(matrix: Array) -> Array:
        return matrix[np.ix_(new, new)]

    others = dataclasses.replace(
        scene,
        inertia=Inertia(mass=permuted(scene.inertia.mass)),
        damping=tuple(
            FractionalDamping(order=t.order, coefficient=permuted(t.coefficient))
            for t in scene.damping
        ),
        initial_position=scene.initial_position[new],
        initial_velocity=scene.initial_velocity[new],
    )
    whole = dataclasses.replace(
        others, potential=QuadraticPotential(stiffness=permuted(scene.potential.stiffness))
    )
    plain = integrate(scene, method, n_steps).position
    size = np.abs(plain).max()
    assert np.abs(integrate(whole, method, n_steps).position - plain[:, new]).max() <= 1e-11 * size
    assert np.abs(integrate(others, method, n_steps).position - plain[:, new]).max() > 1e-6 * size


N_STEPS = st.integers(12, 48)
DIMENSIONS = st.integers(1, 3)
STAGES = st.integers(1, 4)
SEVERAL = st.lists(ORDERS, min_size=1, max_size=2, unique=True)
INDICES = st.integers(0, len(METHODS) - 1)

PROPERTIES = {
    "dissipation": Property(
        {
            "seed": SEEDS,
            "d": DIMENSIONS,
            "orders": SEVERAL,
            "stages": STAGES,
            "n_steps": N_STEPS,
            "velocity": st.booleans(),
        },
        check_dissipation,
    ),
    "symplecticity": Property(
        {"seed": SEEDS, "d": DIMENSIONS, "index": INDICES, "n_steps": N_STEPS}, check_symplectic
    ),
    "time reversal": Property(
        {"seed": SEEDS, "d": DIMENSIONS, "index": INDICES, "n_steps": N_STEPS}, check_reversal
    ),
    "units": Property(
        {
            "seed": SEEDS,
            "d": DIMENSIONS,
            "orders": SEVERAL,
            "index": INDICES,
            "n_steps": N_STEPS,
            "power": st.integers(-60, 60),
            "other": st.integers(-20, 20),
        },
        check_units,
    ),
    "permutation of coordinates": Property(
        {
            "seed": SEEDS,
            "d": st.integers(2, 4),
            "orders": SEVERAL,
            "index": INDICES,
            "n_steps": N_STEPS,
        },
        check_permutation,
    ),
}


def run(law: Property, examples: int) -> None:
    limited = settings(
        max_examples=examples,
        derandomize=True,
        database=None,
        deadline=None,
        phases=(Phase.explicit, Phase.generate),
        report_multiple_bugs=False,
        suppress_health_check=list(HealthCheck),
    )
    limited(given(**law.drawn)(law.check))()


@pytest.mark.parametrize("name", PROPERTIES)
def test_law(name):
    run(PROPERTIES[name], 6)


@pytest.mark.slow
@pytest.mark.parametrize("name", PROPERTIES)
def test_law_on_many_scenes(name):
    run(PROPERTIES[name], 150)
