"""Gradients of drawn scenes by all their numbers, against central differences with two steps."""

import random

import numpy as np
import pytest
from against_differences import misses
from spread import few_of

import fvi_cli as fvi
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.gradient import run_steps
from fvi_cli.integrator.gradients.linearised import Disturbance, LinearisedRun, Maps
from fvi_cli.integrator.gradients.parameters import entries_of
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import Mesh, graded_mesh, uniform_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.request import names_of
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.lagrangian import lagrangian_scene

KINDS = ("one", "coupled", "potential", "lagrangian")
POTENTIALS = ("k*cos(x1)*cos(x2) + x1**2*x2**2/a", "a*(x1 - x2)**4 + k*(x1**2 + exp(x2/3))")
LAGRANGIANS = ("(a + cos(x1 - x2))*vx2**2/2 + vx1**2 + vx1*vx2/3 - k*x1**2*x2**2 - x2**2",)


def matrix(chance: random.Random, size: int) -> np.ndarray:
    """Symmetric, positive definite, of any scale."""
    rows = np.array([[chance.gauss(0, 1) for _ in range(size)] for _ in range(size)])
    return (rows @ rows.T / size + np.eye(size)) * chance.uniform(0.3, 3.0)


def laws(chance: random.Random, size: int) -> tuple:
    made = {
        "zener": lambda c: fvi.fractional_zener(
            order=chance.uniform(0.2, 0.9),
            time=chance.uniform(0.2, 3.0),
            relaxed=0.0,
            unrelaxed=chance.uniform(0.5, 2.0),
            coefficient=c,
        ),
        "prony": lambda c: fvi.prony(
            moduli=[chance.uniform(0.2, 1.0), 0.5],
            times=[0.3, chance.uniform(1.0, 4.0)],
            coefficient=c,
        ),
    }
    return tuple(made[name](0.3 * matrix(chance, size)) for name in chance.sample(list(made), 1))


def drawn(seed: int) -> tuple[Scene, Method, Mesh]:
    chance = random.Random(seed)
    kind = KINDS[seed % len(KINDS)]
    size = 1 if kind == "one" else 2
    jumps = chance.random() < 0.3
    orders = [chance.uniform(0.05, 0.9 if jumps else 1.9) for _ in range(chance.randint(0, 2))]
    # with a start velocity there is no derivative across order 1
    orders = [order + 0.05 * (abs(order - 1) < 0.05) for order in orders]
    speed = chance.choice([0.0, 1.0])
    if not jumps and not speed:
        orders.append(1.0)
    given = {
        "damping": tuple(
            FractionalDamping(
                order=order, coefficient=chance.uniform(0.0, 0.5) * matrix(chance, size)
            )
            for order in orders
        ),
        "derivative": "riemann-liouville" if jumps else "caputo",
        "initial_position": np.array([chance.uniform(0.3, 1.2) for _ in range(size)]),
        "initial_velocity": speed * np.ones(size),
        "final_time": chance.uniform(1.0, 3.0),
    }
    if not jumps and chance.random() < 0.6:
        given["laws"] = laws(chance, size)
    numbers = {"k": chance.uniform(0.5, 3.0), "a": chance.uniform(1.5, 2.5)}
    if kind == "lagrangian":
        given.pop("laws", None)
        text = chance.choice(LAGRANGIANS)
        scene = lagrangian_scene(
            coordinates=["x1", "x2"], lagrangian=text, parameters=numbers, **given
        )
    else:
        potential: object = fvi.QuadraticPotential(stiffness=matrix(chance, size))
        if kind == "potential":
            text = chance.choice(POTENTIALS)
            potential = fvi.ExpressionPotential(
                coordinates=("x1", "x2"),
                energy_expression=Expression.parse(text, ("x1", "x2", *numbers)),
                parameters=numbers,
            )
        scene = Scene(inertia=fvi.Inertia(mass=matrix(chance, size)), potential=potential, **given)
    family = chance.choice(["gauss", "gauss", "lobatto-iiic"])
    method = Method(cq=family, degree=chance.randint(2, 4), start="none")
    time = scene.final_time
    mesh = {
        "uniform": lambda: uniform_mesh(time, chance.choice([7, 40, 150])),
        "graded": lambda: graded_mesh(time, chance.randint(8, 30), chance.uniform(1.5, 4.0)),
        "adaptive": lambda: found_mesh(scene),
    }[chance.choice(["uniform", "graded", "adaptive"])]()
    return scene, method, mesh


def found_mesh(scene: Scene) -> Mesh:
    steps = AdaptiveSteps(tolerance=1e-4)
    return run_steps(scene, Method(cq="gauss", degree=3, start="none"), steps).mesh(())


@few_of(2, 16)
def test_drawn_scenes(seed):
    scene, method, mesh = drawn(seed)
    times = np.array([0.31, 0.77]) * scene.final_time
    weights = np.random.default_rng(seed).normal(size=(2, scene.dimension))

    def of(beside: Scene) -> float:
        steps = run_steps(beside, method, mesh)
        values = steps(times) @ weights[0] + np.sin(steps.velocity_at(times)) @ weights[1]
        return float(0.5 * values @ values)

    terms = [
        f"{a!r}*{name} + {b!r}*sin(v{name})"
        for name, a, b in zip(names_of(scene), *weights.tolist(), strict=True)
    ]
    quantity = fvi.misfit(times, np.zeros(2), of=" + ".join(terms))
    entries = entries_of(scene)
    names = [name for name, one in entries.items() if np.any(one.value) or "initial" in name]
    assert misses(scene, method, mesh, quantity, of, names).max() < 1.0


@pytest.mark.parametrize("seed", [seed for seed in range(8) if drawn(seed)[0].active_forces])
def test_without_the_past_it_would_fail(seed, monkeypatch):
    """The control: the tangent with states that forget what drove them."""
    scene, method, mesh = drawn(seed)
    run = LinearisedRun(scene, method, run_steps(scene, method, mesh))
    n, d = mesh.n_steps, scene.dimension
    pushed = Disturbance(np.zeros((1, n, method.degree + 1, d)), np.zeros((1, d)), np.ones((1, d)))
    found = run.tangent(pushed).position[1:]
    original = LinearisedRun._maps

    def forgetful(run: LinearisedRun, own: slice) -> Maps:
        maps = original(run, own)
        return maps._replace(intake=0.0 * maps.intake)

    monkeypatch.setattr(LinearisedRun, "_maps", forgetful)
    assert np.abs(run.tangent(pushed).position[1:] / found - 1.0).max() > 1e-5
