"""Steps in which times of output lie are solved by themselves, as well as by a second run."""

from dataclasses import replace

import numpy as np
import pytest
from letters import spring, swing
from numpy.typing import NDArray
from spread import spread

import fvi_cli as fvi
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations import second_runs
from fvi_cli.integrator.observations.observe import observe_members
from fvi_cli.integrator.observations.request import Observations
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.chains import frame
from fvi_cli.scenes.data import duffing

Array = NDArray[np.float64]
FINAL_TIME, REFERENCE = 10.0, Method(cq="gauss", degree=8, start="graded")
SPEED = {"v": Expression.parse("vx", ("vx",))}


def drawn(rng: np.random.Generator) -> Scene:
    """A scene with one or two dampers up to order 1, some of them forced or Riemann-Liouville."""
    terms = [(rng.uniform(0.1, 0.95), 10.0 ** rng.uniform(-1.5, 0.5))]
    if rng.random() < 0.5:
        terms.append((1.0, rng.uniform(0.05, 0.5)))
    rest = {"x": rng.uniform(0.3, 1.5), "v": rng.uniform(-1.0, 1.0), "T": FINAL_TIME}
    rest["derivative"] = rng.choice(["caputo", "riemann-liouville"])
    if rng.random() < 0.5:
        rest["forcing"] = fvi.Forcing.from_text(f"0.5*cos({rng.uniform(0.5, 2.0):.3f}*t)")
    if rng.random() < 0.3:
        return swing(*terms, **rest)
    if rng.random() < 0.5:
        return spring(*terms, m=rng.uniform(0.5, 2.0), k=rng.uniform(0.5, 4.0), **rest)
    place, speed = [rest.pop("x")], [rest.pop("v")]
    dampers = [FractionalDamping(order=g, coefficient=[[mu]]) for g, mu in terms]
    return duffing(
        stiffness=rng.uniform(0.5, 4.0),
        damping=dampers,
        initial_position=place,
        initial_velocity=speed,
        final_time=rest.pop("T"),
        **rest,
    )


def observed(
    scene: Scene, method: Method, run: Trajectory, asked: Observations, further: bool = False
) -> Trajectory:
    """At times of output; with `further` along all steps as well."""
    request = replace(asked, quantities=SPEED) if further else asked
    return observe_members([scene], method, [run], [request])[0][1]


def largest(found: Trajectory, exact: Trajectory) -> Array:
    """Largest errors of position and momentum, beside round-off."""
    pairs = (found.position, exact.position), (found.momentum, exact.momentum)
    return np.array([np.abs(a - b).max() + 1e-12 * np.abs(b).max() for a, b in pairs])


@spread(few=2, seed=range(12))
def test_they_are_as_good_as_a_second_run_and_the_steps_of_the_run_are_not(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    scene, start = drawn(rng), str(rng.choice(["none", "graded"]))
    method = Method(cq="gauss", degree=2 + seed % 4, start=start)
    run = integrate(scene, method, int(rng.integers(60, 200)), with_steps=True)
    times = np.sort(rng.uniform(0.05 * FINAL_TIME, FINAL_TIME, 9))
    asked = Observations(coordinates=("x",), times=times)
    fine = integrate(scene, REFERENCE, 400, with_steps=True)
    exact = observed(scene, REFERENCE, fine, asked, further=True)
    second = largest(observed(scene, method, run, asked, further=True), exact)
    # behind a singular start momenta swing from step to step, and such a step begins with them
    late = run.time > times[0]
    points = replace(asked, times=run.time[late])
    swing = run.momentum[late] - observed(scene, REFERENCE, fine, points).momentum
    kept = 0.05 * np.abs(swing).max() * np.array([run.step_size, 1.0])
    assert (largest(observed(scene, method, run, asked), exact) < 1.25 * second + kept).all()
    if start == "none":
        # steps behind the start are as far off at their points
        return
    # the control: nothing is solved again
    monkeypatch.setattr(second_runs, "MOST_STAGES", method.degree)
    assert (largest(observed(scene, method, run, asked), exact) > 2.0 * second).any()


def test_no_other_step_is_solved(monkeypatch):
    scene, method = swing((0.5, 0.4), T=FINAL_TIME, x=1.0, v=0.3), Method(cq="gauss", degree=3)
    run = integrate(scene, method, 400, with_steps=True)
    asked = Observations(coordinates=("x",), times=np.linspace(0.1, FINAL_TIME, 23))
    by_run, by_step = [], []
    in_blocks, alone = Engine.solve, Engine.solve_after

    def solve(engine, state, h, count, *rest):
        by_run.append(count)
        return in_blocks(engine, state, h, count, *rest)

    def solve_after(engine, state, *rest):
        by_step.append(len(state.x))
        return alone(engine, state, *rest)

    monkeypatch.setattr(Engine, "solve", solve)
    monkeypatch.setattr(Engine, "solve_after", solve_after)
    observed(scene, method, run, asked)
    assert (sum(by_run), sum(by_step)) == (0, 23)
    # the control: with an extent, and with times in most of the steps, there is a second run
    observed(scene, method, run, asked, further=True)
    assert (sum(by_run), sum(by_step)) == (400, 23)
    observed(scene, method, run, replace(asked, times=np.linspace(0.01, FINAL_TIME, 201)))
    assert (sum(by_run), sum(by_step)) == (800, 23)


@pytest.mark.few(1)
@pytest.mark.parametrize("kind", ["spring", "swing", "frame"])
def test_a_member_has_the_same_bits_whatever_stands_beside_it(kind):
    rng, count, method = np.random.default_rng(len(kind)), 70, Method(cq="gauss", degree=2)
    scenes, requests = [], []
    for _ in range(count):
        damper = (rng.uniform(0.2, 0.9), rng.uniform(0.1, 0.6))
        start = {"T": FINAL_TIME, "x": rng.uniform(0.2, 1.5), "v": rng.uniform(-1.0, 1.0)}
        if kind == "spring":
            scenes.append(spring(damper, k=rng.uniform(0.5, 4.0), **start))
        elif kind == "swing":
            scenes.append(swing(damper, **start))
        else:
            # coupled: a damper in one storey
            pair = frame(storeys=2, stiffness=rng.uniform(5.0, 9.0), final_time=FINAL_TIME)
            matrix = np.diag([damper[1], 0.0])
            terms = (FractionalDamping(order=damper[0], coefficient=matrix),)
            scenes.append(replace(pair, damping=terms, initial_position=rng.normal(size=2)))
        times = np.sort(rng.uniform(0.0, FINAL_TIME, int(rng.integers(1, 40))))
        requests.append(Observations(coordinates=("x",) * scenes[0].dimension, times=times))
    runs = integrate_members(scenes, method, 130, with_steps=True)
    whole = observe_members(scenes, method, runs, requests)
    for index in (0, 1, 33, count - 1):
        part = [index, *rng.permutation(count)[: int(rng.integers(0, 5))].tolist()]
        one = observe_members(
            *([own[k] for k in part] for own in (scenes,)),
            method,
            *([own[k] for k in part] for own in (runs, requests)),
        )[0][1]
        for name in ("position", "momentum", "energy"):
            assert np.array_equal(getattr(one, name), getattr(whole[index][1], name)), name
    # the control: members differ
    assert whole[0][1].position[0, 0] != whole[1][1].position[0, 0]


def test_a_step_without_a_solution_leaves_its_run_to_a_second_one(monkeypatch):
    scenes = [swing((0.5, 0.4), T=FINAL_TIME, x=one, v=0.3) for one in (1.0, 0.5)]
    method, alone = Method(cq="gauss", degree=3), Engine.solve_after
    runs = [integrate(scene, method, 100, with_steps=True) for scene in scenes]
    asked = Observations(coordinates=("x",), times=np.linspace(0.1, FINAL_TIME, 23))
    good = observe_members(scenes, method, runs, [asked] * 2)

    def failing(engine, *rest):
        found, failed = alone(engine, *rest)
        failed[7] = True
        return found, failed

    monkeypatch.setattr(Engine, "solve_after", failing)
    (_, first), (_, other) = observe_members(scenes, method, runs, [asked] * 2)
    second = observed(scenes[0], method, runs[0], asked, further=True)
    assert np.array_equal(first.position, second.position)
    assert not np.array_equal(first.position, good[0][1].position)
    assert np.array_equal(other.position, good[1][1].position)


@spread(few=1, seed=range(6))
def test_impacts_are_found_where_no_time_of_output_lies(seed):
    rng = np.random.default_rng([26, 9, seed])
    scene = fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"vx**2/2 - {rng.uniform(1.0, 10.0)}*x",
        initial_position=[rng.uniform(0.5, 2.0)],
        initial_velocity=[rng.uniform(-1.0, 1.0)],
        damping=[FractionalDamping(order=rng.uniform(0.1, 1.9), coefficient=0.1)],
        final_time=4.0,
    )
    impacts = {"floor": {"when": "x", "restitution": rng.uniform(0.4, 0.9)}}
    degree = f"gauss{rng.integers(2, 7)}"
    times = np.linspace(0.0, 3.9, 5)
    plain = fvi.integrate(scene, degree, 80, impacts=impacts)
    asked = fvi.integrate(scene, degree, 80, impacts=impacts, output=times)
    found, same = (one.observed.events["floor"].time for one in (plain, asked))
    assert found.size
    assert np.array_equal(found, same)
    assert asked.time.size == times[times <= plain.time[-1]].size
