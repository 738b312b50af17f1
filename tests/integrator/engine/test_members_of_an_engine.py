"""Members of an engine: what each is alone, to the last bit by blocks of the same length."""

import numpy as np
import pytest
from drawn_scenes import chain, oscillator, pendulum, two_joints

import fvi_cli.api as fvi
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import integrate_scenes, mesh_for

METHODS = [Method(cq="gauss", degree=3), Method(cq="bdf2", degree=2)]


BATCHES = {
    "linear": [oscillator(seed, (0.5, 1.5)) for seed in range(11)],
    "pendulums": [pendulum(seed) for seed in range(11)],
    "chains": [chain(seed, 4, decouples=False) for seed in range(11)],
    "general": [two_joints(seed) for seed in range(11)],
}


@pytest.mark.parametrize("name", BATCHES)
@pytest.mark.parametrize("method", METHODS, ids=lambda one: one.case)
def test_each_is_what_it_is_alone(name: str, method: Method) -> None:
    scenes, mesh = BATCHES[name], mesh_for(BATCHES[name][0], method, 300)
    for scene, one in zip(scenes, integrate_scenes(scenes, method, mesh), strict=True):
        alone = integrate(scene, method, 300)
        assert one.status == alone.status == "ok"
        for field in ("position", "momentum"):
            a, b = getattr(one, field), getattr(alone, field)
            assert np.abs(a - b).max() < 1e-11 * np.abs(b).max()


@pytest.mark.parametrize("name", BATCHES)
@pytest.mark.parametrize("method", METHODS, ids=lambda one: one.case)
@pytest.mark.parametrize("most", [1, 8])
def test_a_member_has_the_same_bits_alone_and_among_others(
    name: str, method: Method, most: int
) -> None:
    scenes, mesh = BATCHES[name], mesh_for(BATCHES[name][0], method, 300)
    together = integrate_scenes(scenes, method, mesh, most=most)
    for group in ([0], [3, 7], list(range(5, 11))):
        own = integrate_scenes([scenes[one] for one in group], method, mesh, most=most)
        for one, place in zip(own, group, strict=True):
            assert np.array_equal(one.position, together[place].position)


@pytest.mark.parametrize("name", BATCHES)
def test_polynomials_of_all_members_are_kept(name: str) -> None:
    scenes, mesh = BATCHES[name], mesh_for(BATCHES[name][0], METHODS[0], 60)
    times = np.linspace(0.0, scenes[0].final_time, 101)
    for scene, one in zip(
        scenes, integrate_scenes(scenes, METHODS[0], mesh, with_steps=True), strict=True
    ):
        alone = integrate(scene, METHODS[0], mesh, with_steps=True)
        for of, size in ((lambda run: run(times), 1.0), (lambda run: run.velocity(times), 30.0)):
            assert np.abs(of(one) - of(alone)).max() < 1e-11 * size * np.abs(of(alone)).max()


@pytest.mark.parametrize("ratio", [1e-6, 1.0, 7e6])
@pytest.mark.parametrize("most", [None, 1, 8])
def test_a_component_is_as_accurate_beside_a_large_one(ratio: float, most: int | None) -> None:
    """V = x^2/2 + 1 - cos y: the pendulum does not know how far the oscillator swings."""
    pair = _uncoupled(ratio)
    single = fvi.pendulum(
        damping=(fvi.FractionalDamping(order=0.5, coefficient=0.1),),
        initial_position=2.5,
        final_time=20.0,
    )
    method = METHODS[0]
    for steps in (200, 1000):
        mesh = mesh_for(pair, method, steps)
        (found,) = integrate_scenes([pair], method, mesh, most=most)
        known = integrate(single, method, mesh)
        assert np.abs(found.position[:, 1] - known.position[:, 0]).max() < 1e-12


def _uncoupled(first: float) -> Scene:
    from fvi_cli.mathematics.expressions import Expression
    from fvi_cli.scenes.data import make_scene

    energy = Expression.parse("x*x/2 + 1 - cos(y)", variables=("x", "y"))
    potential = fvi.ExpressionPotential(coordinates=("x", "y"), energy_expression=energy)
    damping = (fvi.FractionalDamping(order=0.5, coefficient=0.1 * np.eye(2)),)
    return make_scene(
        np.eye(2), potential, damping=damping, initial_position=[first, 2.5], final_time=20.0
    )
