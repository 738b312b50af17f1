"""Bouncing bodies wherever the surface is, in any unit, into corners, with memory: a class."""

import math
import re

import numpy as np
import pytest
from letters import spring
from numpy.typing import NDArray
from oracles.impacts import Bounced, LinearBounces, Wall, free_fall, ordinary_bounces
from spread import few_of

import fvi_cli as fvi

Array = NDArray[np.float64]

PLACES = (0.0, 1.0, -3.7, math.pi * 1e5, 1e-9, 0.1 + 0.2, -7.0 / 3.0)
SCALES = (1.0, 1e-9, 1e9, 1e-3)
RESTITUTIONS = (0.5, 0.9, 0.0, 1.0, 0.25)
HEIGHT, GRAVITY, TIME = 1.0, 10.0, 10.0


def _fall(place: float, length: float, second: float, restitution: float) -> fvi.Trajectory:
    """A ball that falls on a floor, in units of length and time."""
    floor, gravity = place * length, GRAVITY * length / second**2
    scene = fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"vx**2/2 - {gravity!r}*x",
        initial_position=[floor + HEIGHT * length],
        initial_velocity=[0.0],
        final_time=TIME * second,
    )
    return fvi.integrate(
        scene,
        "gauss3",
        97,
        impacts={"floor": {"when": f"x - ({floor!r})", "restitution": restitution}},
        quantities={"gap": f"x - ({floor!r})"},
    )


DRAWN = [
    (place, SCALES[i % 4], SCALES[(2 * i + 1) % 4], RESTITUTIONS[(i + j) % 5])
    for j in range(3)
    for i, place in enumerate(PLACES)
]


@pytest.mark.few(3)
@pytest.mark.parametrize(("place", "length", "second", "restitution"), DRAWN)
def test_a_ball_stays_above_a_floor_anywhere_in_any_unit(place, length, second, restitution):
    run = _fall(place, length, second, restitution)
    assert run.status == "ok", run.message
    found = run.observed.events["floor"].time / second
    exact, rest = free_fall(HEIGHT, GRAVITY, restitution, found.size)
    round_off = 1e-13 * max(abs(place), 1.0)
    assert run.observed.extents["gap"].least / length > -round_off
    # flights that are far above round-off have their exact times
    heights = HEIGHT * restitution ** (2 * np.arange(found.size))
    clear = heights > 1e5 * round_off
    assert clear.any()
    assert np.abs(found - exact)[clear].max() < 1e-8
    if restitution == 1.0:
        assert run.time[-1] == TIME * second
        assert found.size == int((TIME / math.sqrt(2 * HEIGHT / GRAVITY) + 1) / 2)
        return
    (said,) = [re.search(r"at rest from t = (\S+)", one) for one in run.remarks]
    # flights lower than the round-off of the gap are lost, and those after them
    lost = 64 * 2.0**-52 * max(abs(place), 1.0)
    slack = 2 * math.sqrt(2 * lost / GRAVITY) / (1 - restitution)
    assert float(said[1]) / second == pytest.approx(rest, abs=slack)


ORDERS = ((1.8, 0.31), (0.3, 0.0), (0.8, 1.3), (1.2, 0.0), (1.5, 0.7), (1.7, -2.2), (1.97, 0.0))


def _with_memory(order: float, floor: float, **more: float) -> LinearBounces:
    return LinearBounces(
        order=order,
        coefficient=0.2,
        stiffness=0.5,
        gravity=10.0 + 0.5 * floor,
        start=floor + 1.0,
        speed=0.3,
        final_time=2.2,
        floor=floor,
        lift=0.05,
        rate=3.0,
        restitution=0.9,
        **more,
    )


def _run_with_memory(case: LinearBounces, n_steps: int, final_time: float) -> fvi.Trajectory:
    scene = spring(
        (case.order, case.coefficient),
        T=final_time,
        m=1.0,
        k=case.stiffness,
        x=case.start,
        v=case.speed,
        forcing=f"-({case.gravity!r})",
    )
    when = f"x - ({case.floor!r}) - {case.lift}*sin({case.rate}*t)"
    return fvi.integrate(
        scene,
        "gauss5",
        n_steps,
        output=np.linspace(0.0, final_time, 60),
        impacts={"floor": {"when": when, "restitution": case.restitution}},
    )


@pytest.mark.few(1)
@pytest.mark.parametrize(("order", "floor"), ORDERS)
def test_flights_remember_all_impacts_before(order, floor):
    case = _with_memory(order, floor)
    times, speeds = case.bounce(3, 0.01)
    final_time = min(times[-1] + 0.05, case.final_time)
    errors = []
    for n_steps in (20, 60):
        run = _run_with_memory(case, n_steps, final_time)
        found = run.observed.events["floor"]
        assert run.status == "ok"
        assert found.time.size == 3
        off = np.abs(run.position[:, 0] - case.motion(run.time)[0]).max()
        wrong = np.abs(found.velocity[:, 0] - speeds).max()
        errors.append(max(off, wrong, np.abs(found.time - times).max()))
    assert errors[1] < 1e-7
    assert errors[1] < max(0.3 * errors[0], 1e-8)


@pytest.mark.parametrize("order", [0.5, 1.5])
def test_output_works_events_and_impacts_together(order):
    """The balance is that of all points of the mesh, with what the impacts take."""
    scene = spring((order, 0.3), T=1.6, x=1.0, forcing="-10")
    asked = {
        "output": np.linspace(0.0, 1.6, 31),
        "quantities": {"v": "vx"},
        "events": {"top": {"when": "vx", "direction": "falling"}},
        "impacts": {"floor": {"when": "x", "restitution": 0.8}},
    }
    run = fvi.integrate(scene, "gauss4", 120, diagnostics=True, **asked)
    alone = fvi.integrate(scene, "gauss4", 120, **asked)
    assert np.array_equal(run.position, alone.position)
    works = run.diagnostics
    assert np.array_equal(works.time, run.on_mesh.time)
    assert works.time.size > 120
    assert run.observed.events["floor"].time.size > 1
    if order < 1:
        assert np.abs(works.energy_defect).max() < 1e-9
    # the control: impacts take energy
    assert works.dissipated_work[-1] > 0.1


def _draw(seed: int) -> tuple[list[Wall], Array, Array, Array, float, float, float]:
    """Walls around the origin, and what moves between them: x0, v0, force, stiffness, ..."""
    rng = np.random.default_rng(seed)
    walls = []
    for _ in range(int(rng.integers(1, 4))):
        angle = float(rng.uniform(0, 2 * math.pi))
        walls.append(
            Wall(
                normal=(math.cos(angle), math.sin(angle)),
                distance=float(rng.uniform(0.6, 1.2)),
                lift=float(rng.choice([0.0, 0.1])),
                rate=float(rng.uniform(1, 6)),
                restitution=float(rng.choice([1.0, 0.9, 0.7, 0.5])),
            )
        )
    if rng.random() < 0.4:
        walls.append(Wall(radius=1.5, restitution=0.9))
    stiffness, damping = float(rng.uniform(0, 2)), float(rng.choice([0.0, 0.1, 0.5]))
    force, x0, v0 = rng.uniform(-3, 3, 2), rng.uniform(-0.4, 0.4, 2), rng.normal(0, 1, 2)
    return walls, x0, v0, force, stiffness, damping, float(rng.uniform(2, 6))


def _both(seed: int, **control: bool) -> tuple[fvi.Trajectory, Bounced, float, Array]:
    walls, x0, v0, force, k, c, final_time = _draw(seed)
    place = PLACES[seed % 4] * (1e-2 if seed % 4 == 3 else 1.0)

    def acceleration(t: float, q: Array, v: Array) -> Array:
        return np.asarray(force - k * q - c * v)

    exact = ordinary_bounces(
        acceleration, walls, x0, v0, final_time, shortest=1e-4 * final_time, **control
    )
    a, b = f"(x - ({place!r}))", f"(y - ({place!r}))"
    pull = " + ".join(f"({f!r})*{q}" for f, q in zip(force.tolist(), (a, b), strict=True))
    scene = fvi.lagrangian_scene(
        coordinates=["x", "y"],
        lagrangian=f"(vx**2 + vy**2)/2 - {k!r}*({a}**2 + {b}**2)/2 + {pull}",
        initial_position=(x0 + place).tolist(),
        initial_velocity=v0.tolist(),
        final_time=final_time,
        damping=[fvi.FractionalDamping(order=1.0, coefficient=c * np.eye(2))] if c else [],
    )
    run = fvi.integrate(
        scene,
        "gauss5",
        60,
        impacts={
            f"w{i}": {"when": wall.text((a, b)), "restitution": wall.restitution}
            for i, wall in enumerate(walls)
        },
        quantities={f"gap{i}": wall.text((a, b)) for i, wall in enumerate(walls)},
    )
    return run, exact, final_time, np.array([place, place])


def _disagreement(run: fvi.Trajectory, exact: Bounced, final_time: float, place: Array) -> float:
    """Largest difference of impact times and of the position at the end; inf: other impacts."""
    worst = 0.0
    is_whole = exact.end == final_time
    # the last flight before the end took at least 1e-4 of the time
    until = final_time if is_whole else exact.end - 5e-5 * final_time
    for found, times in zip(run.observed.events.values(), exact.times, strict=True):
        seen, wanted = found.time[found.time < until], [t for t in times if t < until]
        if len(wanted) != seen.size:
            return math.inf
        worst = max(worst, float(np.abs(seen - wanted).max(initial=0.0)))
    if is_whole:
        worst = max(worst, float(np.abs(run.position[-1] - place - exact.position).max()))
    return worst


@few_of(2, 304)
def test_walls_anywhere_at_any_angle_that_move(seed):
    run, exact, final_time, place = _both(seed)
    assert run.status == "ok", run.message
    assert _disagreement(run, exact, final_time, place) < 1e-7
    assert all(one.least > -1e-9 for one in run.observed.extents.values())


def test_other_restitutions_disagree():
    """The control: the same scenes with elastic walls are other motions."""
    assert any(_disagreement(*_both(seed, forgets=True)) > 1e-3 for seed in range(4))


@pytest.mark.parametrize("seed", range(8))
def test_in_a_corner_both_walls_push(seed):
    """Between walls at pi/2 the velocity is reversed, at pi/3 its part along the bisector."""
    rng = np.random.default_rng(seed)
    sides = 2 + seed % 2
    restitution = float(rng.uniform(0.2, 1.0)) if sides == 2 else 1.0
    turn, along = rng.uniform(0, 2 * math.pi), rng.uniform(-0.3, 0.3)
    corner = rng.normal(0, 10.0 ** rng.integers(-3, 4), 2)
    half = 0.5 * math.pi / sides
    bisector = np.array([math.cos(turn), math.sin(turn)])
    velocity = -np.array([math.cos(turn + along), math.sin(turn + along)])
    walls = {}
    for side in (-1, 1):
        a = turn + side * (half - 0.5 * math.pi)
        n = np.array([math.cos(a), math.sin(a)])
        text = f"({n[0].item()!r})*(x - ({corner[0].item()!r})) + "
        text += f"({n[1].item()!r})*(y - ({corner[1].item()!r}))"
        walls[f"w{side + 1}"] = {"when": text, "restitution": restitution}
    scene = fvi.lagrangian_scene(
        coordinates=["x", "y"],
        lagrangian="(vx**2 + vy**2)/2",
        initial_position=(corner - velocity).tolist(),
        initial_velocity=velocity.tolist(),
        final_time=2.5,
    )
    run = fvi.integrate(scene, "gauss3", 10, impacts=walls)
    assert run.status == "ok", run.message
    back = -restitution * velocity
    if sides == 3:
        back = velocity - 2 * (velocity @ bisector) * bisector
    size = max(1.0, float(np.abs(corner).max()))
    assert np.abs(run.position[-1] - corner - 1.5 * back).max() < 1e-9 * size
    assert all(run.observed.events[name].time.size >= 1 for name in walls)


def test_what_does_not_bounce_is_lifted_off_again():
    """On a table that is struck upwards: no rest where the table pushes the ball away."""
    scene = spring(T=1.0, m=1.0, k=0.0, x=1.0, v=-4.0, forcing="10")
    run = fvi.integrate(scene, "gauss3", 20, impacts={"f": {"when": "x - 0.3", "restitution": 0.0}})
    at = float(run.observed.events["f"].time[0])
    assert run.remarks == ()
    assert run.position[-1, 0] == pytest.approx(0.3 + 5.0 * (1.0 - at) ** 2, abs=1e-12)


def test_a_frictionless_wall_turns_the_normal_velocity_only():
    scene = fvi.lagrangian_scene(
        coordinates=["x", "y"],
        lagrangian="(vx**2 + 2*vy**2)/2",
        initial_position=[0.0, 0.0],
        initial_velocity=[1.0, 0.25],
        final_time=4.0,
    )
    run = fvi.integrate(
        scene,
        "gauss3",
        8,
        impacts={"wall": {"when": "1 - x - y", "restitution": 1.0}},
    )
    assert run.observed.events["wall"].time == pytest.approx([0.8])
    assert run.energy == pytest.approx(np.full(run.time.size, run.energy[0]))
    assert run.momentum is not None
    along = run.momentum @ [1.0, -1.0]
    assert along == pytest.approx(np.full(run.time.size, along[0]))


def test_a_surface_may_have_kinks_where_it_is_not_met_and_needs_a_normal_where_it_is():
    ball = spring(T=4.0, m=1.0, k=0.0, x=0.0, v=2.0)
    both = fvi.integrate(ball, "gauss3", 16, impacts={"walls": {"when": "1 - abs(x)"}})
    assert both.observed.events["walls"].time == pytest.approx([0.5, 1.5, 2.5, 3.5])
    none = fvi.integrate(ball, "gauss3", 16, impacts={"clock": {"when": "1 - t"}})
    assert none.status == "failed"
