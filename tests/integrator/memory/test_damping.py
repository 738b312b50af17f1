"""The damping of many members: alone and together, by direction and by damper."""

from dataclasses import replace

import numpy as np
import pytest
from letters import spring, swing
from spread import spread

from fvi_cli.effects.laws.cole_cole import fractional_zener
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances import DampingAlong
from fvi_cli.integrator.integrate import integrate_members
from fvi_cli.integrator.memory.damping import Damping, damping_of, pattern_of
from fvi_cli.integrator.meshes.mesh import uniform_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import integrate_scenes

COUPLING = np.array([[1.0, 0.2, 0.0], [0.2, 0.5, 0.1], [0.0, 0.1, 0.3]])
OTHER = np.diag([0.2, 0.0, 0.4])


def chain(*terms: tuple[float, float | np.ndarray], v: float = 0.4, **more: object) -> Scene:
    stiffness = 2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
    start = {"x": [1.0, 0.0, -0.3], "v": [v, 0.0, -v]}
    return spring(*terms, T=8.0, m=np.eye(3), k=stiffness, **start, **more)


def pendulum(*terms: tuple[float, float], v: float = 0.4) -> Scene:
    return swing(*terms, T=8.0, x=1.0, v=v)


def number(*terms: tuple[float, float], v: float = 0.4) -> Scene:
    return spring(*terms, T=8.0, k=2.0, x=1.0, v=v)


BUILDERS = {"number": number, "pendulum": pendulum, "chain": chain}
SWEEPS = {
    "orders below 1": [((order, 0.3), (0.5, 0.1)) for order in (0.05, 0.77, 1.0)],
    "orders above 1": [((order, 0.3), (1.5, 0.1)) for order in (1.02, 1.6, 1.97)],
    "orders on both sides": [((order, 0.3), (1.5, 0.1)) for order in (0.3, 0.9, 1.0)],
    "coefficients": [((0.5, 0.3), (1.0, size)) for size in (0.1, 0.2, -0.05)],
}


def scenes_of(kind: str, sweep: str, v: float) -> list[Scene]:
    members = SWEEPS[sweep]
    if kind == "chain":
        members = [tuple((order, size * COUPLING) for order, size in one) for one in members]
    return [BUILDERS[kind](*terms, v=v) for terms in members]


@spread(kind=BUILDERS, sweep=SWEEPS, v=[0.0, 0.4], degree=[1, 3])
def test_members_of_different_orders_are_the_runs_of_their_own(kind, sweep, v, degree):
    scenes, method = scenes_of(kind, sweep, v), Method(cq="gauss", degree=degree)
    assert len({pattern_of(one) for one in scenes}) == 1
    mesh = uniform_mesh(8.0, 100)
    together = integrate_scenes(scenes, method, mesh)
    for scene, own in zip(scenes, together, strict=True):
        (alone,) = integrate_scenes([scene], method, mesh)
        assert np.abs(alone.position - own.position).max() <= 1e-12
    assert np.abs(together[0].position - together[1].position).max() > 1e-4


def test_what_may_not_stand_in_one_batch_has_another_pattern():
    below, above = number((0.5, 0.3)), number((1.5, 0.3))
    assert pattern_of(below) != pattern_of(above)
    # at rest nothing is subtracted
    assert pattern_of(number((0.5, 0.3), v=0.0)) == pattern_of(number((1.5, 0.3), v=0.0))
    shared = chain((0.5, COUPLING), (0.7, 2.0 * COUPLING))
    assert pattern_of(shared) != pattern_of(chain((0.5, COUPLING), (0.7, OTHER)))
    assert [len(places) for places, _ in pattern_of(shared)] == [2]


@pytest.mark.parametrize("method", [Method(cq="bdf2", degree=1), Method(cq="gauss", degree=2)])
def test_terms_in_any_order_make_the_same_motion(method):
    terms = (1.5, 0.3), (0.5, 0.1)
    scenes = [number(*(terms if k % 2 else terms[::-1])) for k in range(8)]
    runs = integrate_members(scenes, method, 64)
    assert np.abs(runs[0].position - runs[1].position).max() < 1e-13
    np.testing.assert_array_equal(runs[0].position, runs[2].position)


METHODS = {
    "gauss2": Method(cq="gauss", degree=2),
    "lobatto3": Method(cq="lobatto-iiic", degree=2),
    "bdf2": Method(cq="bdf2", degree=1, sampling="nodes"),
    "bdf4": Method(cq="bdf4", degree=2),
}
LAW = fractional_zener(order=0.6, time=0.4, relaxed=0.0, unrelaxed=3.0, coefficient=OTHER)
DAMPED = {
    "mixed": chain((0.5, COUPLING), (1.5, 0.3 * COUPLING), (1.0, 0.2 * COUPLING), (0.3, OTHER)),
    "above": chain((1.5, COUPLING), (1.2, OTHER)),
    "at rest": chain((1.5, COUPLING), (0.7, OTHER), v=0.0),
    "laws": chain((1.5, COUPLING), laws=(LAW,)),
    "plain": replace(chain((0.5, COUPLING), (1.0, OTHER)), derivative="riemann-liouville"),
}


def step_sizes(method: Method, n: int, equal: int = 10) -> np.ndarray:
    """Of so many equal steps each, where a method takes others."""
    if not method.is_runge_kutta:
        return np.full(n, 8.0 / n)
    sizes = np.repeat(10.0 ** np.random.default_rng(n).uniform(-2, 0, n // equal), equal)
    return sizes * (8.0 / sizes.sum())


def alone(scene: Scene) -> list[Scene]:
    """A scene with each of the dampers."""
    terms = [replace(scene, damping=(one,), laws=()) for one in scene.active_damping]
    return terms + [replace(scene, damping=(), laws=(one,)) for one in scene.active_laws]


def damping_on(scene: Scene, method: Method, sizes: np.ndarray) -> Damping:
    shortest = float(sizes.min())
    found = damping_of(
        [scene],
        method,
        shortest_step=shortest,
        steps=float((shortest / sizes).sum()),
        n_steps=None if method.is_runge_kutta else len(sizes),
    )
    assert found is not None
    return found


@spread(name=DAMPED, case=METHODS, n=[70, 200], equal=[1, 10])
def test_forces_of_dampers_add_up_and_their_work_is_stored_or_lost(name, case, n, equal):
    scene, method = DAMPED[name], METHODS[case]
    sizes = step_sizes(method, n, equal)
    if name == "laws" and not method.is_runge_kutta:
        with pytest.raises(ValueError, match="backward differences take powers only"):
            damping_on(scene, method, sizes)
        return
    rng = np.random.default_rng(n)
    whole = damping_on(scene, method, sizes)
    inputs = rng.normal(size=(1, n, whole.tables(sizes[0], 1).kernels.n_inputs, 3))
    total = DampingAlong(damping=whole, step_sizes=sizes, inputs=inputs).forces()
    apart = [
        DampingAlong(damping=damping_on(one, method, sizes), step_sizes=sizes, inputs=inputs)
        for one in alone(scene)
    ]
    forces = np.stack([one.forces() for one in apart])
    assert len(forces) == len(scene.active_forces) == len(apart)
    assert np.abs(forces.sum(axis=0) - total).max() < 1e-13 * np.abs(forces).max()
    each = [one.stored() for one in apart]
    assert [one is None for one in each] == [not method.is_runge_kutta] * len(apart)
    if not method.is_runge_kutta:
        return
    stored = np.concatenate(each)
    assert stored.min() >= 0.0
    if case == "gauss2" and not scene.initial_velocity.any():
        # h sum b v.F is the increase of what is stored and what is lost
        work = 0.5 * sizes * np.einsum("fqnme,qnme->fqn", forces, inputs)
        assert (work - np.diff(stored)).min() > -1e-12 * np.abs(work).max()


def test_a_force_of_order_1_is_the_velocity():
    sizes = step_sizes(METHODS["gauss2"], 70)
    damping = damping_on(chain((1.0, COUPLING)), METHODS["gauss2"], sizes)
    assert damping.n_states == 0
    inputs = np.random.default_rng(0).normal(size=(1, 70, 2, 3))
    force = DampingAlong(damping=damping, step_sizes=sizes, inputs=inputs).forces()
    np.testing.assert_allclose(force, inputs @ COUPLING, rtol=1e-15)
