"""Runs that leave the places at which their potential energy is a finite number."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import integrate_batch
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.method_by_name import method_named
from fvi_cli.scenes.data import kepler
from fvi_cli.scenes.lagrangian import lagrangian_scene

GAUSS3 = Method(cq="gauss", degree=3)
METHODS: tuple[AnyMethod, ...] = (
    GAUSS3,
    method_named("radau-iia2"),
    method_named("bdf2-nodes"),
    method_named("bdf4"),
    Baseline(name="explicit-euler"),
    Baseline(name="implicit-euler"),
    Baseline(name="gruenwald-letnikov"),
    Baseline(name="product-integration"),
)
# V in units of U, and the acceleration in units of U / (m L), of s = (a - x) / L
ATTRACTING = {
    "log(s)": lambda s: 1 / s,
    "sqrt(s)": lambda s: 0.5 / np.sqrt(s),
    "-1/s": lambda s: 1 / s**2,
}
REPELLING = {"-log(s)": lambda s: -1 / s, "1/s": lambda s: -1 / s**2}
SEEDS = range(3)


def drawn(seed: int) -> dict[str, float]:
    """Mass, length, time and place of a scene; its motion is the same in these units."""
    rng = np.random.default_rng(seed)
    mass, length, time = 10.0 ** rng.uniform(-9, 9, 3)
    return {"m": mass, "L": length, "tau": time, "x0": length * rng.uniform(-3, 3)}


def towards_wall(
    formula: str, unit: dict[str, float], *, order: float, speed: float, final: float
) -> Scene:
    """A mass two lengths in front of the place s = 0, moving towards it."""
    values = {**unit, "U": unit["m"] * (unit["L"] / unit["tau"]) ** 2}
    wall = unit["x0"] + 2 * unit["L"]
    energy = formula.replace("s)", "(a - x)/L)").replace("/s", "/((a - x)/L)")
    coefficient = 0.05 * unit["m"] * unit["tau"] ** (order - 2)
    return lagrangian_scene(
        coordinates=("x",),
        lagrangian=f"m*vx**2/2 - U*({energy})",
        parameters={"m": values["m"], "U": values["U"], "L": unit["L"], "a": wall},
        initial_position=unit["x0"],
        initial_velocity=speed * unit["L"] / unit["tau"],
        damping=(FractionalDamping(order=order, coefficient=coefficient),),
        final_time=final * unit["tau"],
    )


@functools.cache
def arrival(formula: str, *, speed: float, final: float) -> float:
    """When a motion with damping of order 1 is as near to s = 0 as 1e-3, in units of the time."""

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        return np.array([state[1], ATTRACTING[formula](2 - state[0]) - 0.05 * state[1]])

    def gap(t: float, state: np.ndarray) -> float:
        return float(2 - 1e-3 - state[0])

    gap.terminal = True  # type: ignore[attr-defined]  # SciPy reads it there
    found = solve_ivp(slope, (0, final), [0, speed], "DOP853", events=gap, rtol=1e-11, atol=1e-11)
    return float(found.t_events[0][0])


@pytest.mark.few(20)
@pytest.mark.parametrize("formula", ATTRACTING)
@pytest.mark.parametrize("method", METHODS, ids=lambda one: one.case)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_run_ends_where_its_energy_does(formula: str, method: AnyMethod, seed: int) -> None:
    """Attracted by the place s = 0, no run goes beyond it, however its energy ends there."""
    unit, n_steps = drawn(seed), (7, 40, 160)[seed % 3]
    scene = towards_wall(formula, unit, order=1.0, speed=1.5, final=3.0)
    event = arrival(formula, speed=1.5, final=3.0)
    assert 0.3 < event < 2.0
    run = integrate(scene, method, n_steps, every=1 + seed % 2)
    assert run.status == "failed"
    assert run.failure is not None
    assert run.failure.time is not None
    assert np.isfinite(run.position).all()
    assert run.energy is None or np.isfinite(run.energy).all()
    assert run.position.max() < unit["x0"] + 2 * unit["L"]
    # methods of low order come early or late by a few of their steps
    slack = 2.5 * 3.0 / n_steps + 0.06
    assert run.failure.time / unit["tau"] == pytest.approx(event, abs=slack)


@pytest.mark.few(3)
@pytest.mark.parametrize("formula", REPELLING)
@pytest.mark.parametrize("order", [0.1, 0.6, 1.0, 1.5, 1.9])
def test_no_step_jumps_over_a_wall(formula: str, order: float) -> None:
    """A repelling wall is in the way of every motion: a run stays before it or fails."""
    failed = 0
    for index, method in enumerate(METHODS):
        unit = drawn(100 + index)
        for n_steps in (3, 5, 9, 17):
            scene = towards_wall(formula, unit, order=order, speed=2.5, final=3.0)
            run = integrate(scene, method, n_steps)
            assert run.position.max() < unit["x0"] + 2 * unit["L"]
            assert run.energy is None or np.isfinite(run.energy).all()
            failed += run.status == "failed"
            assert run.status in ("ok", "failed")
    assert failed
    # the control: where steps are short enough the same motion runs to its end
    scene = towards_wall(formula, drawn(7), order=order, speed=2.5, final=3.0)
    assert integrate(scene, GAUSS3, 400).status == "ok"


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", SEEDS)
def test_adaptive_steps_turn_at_a_wall_and_end_at_a_pole(seed: int) -> None:
    """A trial step over a wall is rejected; where the motion itself ends there, the run fails."""
    unit = drawn(seed)
    steps = AdaptiveSteps(tolerance=1e-5 * unit["L"])
    for formula in REPELLING:
        scene = towards_wall(formula, unit, order=0.5, speed=2.5, final=3.0)
        run, fine = integrate(scene, GAUSS3, steps), integrate(scene, GAUSS3, 800)
        assert run.status == fine.status == "ok"
        assert run.position[-1] == pytest.approx(fine.position[-1], abs=1e-2 * unit["L"])
    for formula in ATTRACTING:
        scene = towards_wall(formula, unit, order=1.0, speed=1.5, final=3.0)
        run = integrate(scene, GAUSS3, steps)
        assert run.status == "failed"
        assert run.failure is not None
        event = arrival(formula, speed=1.5, final=3.0)
        assert run.failure.time == pytest.approx(event * unit["tau"], rel=0.02)


def test_batches_say_the_same_as_runs_one_by_one() -> None:
    """Members of a batch that leave the domain fail as alone; the others are done together."""
    unit = {"m": 1.0, "L": 1.0, "tau": 1.0, "x0": 0.0}
    for formula in ("log(s)", "-1/s", "1/s"):
        speeds = np.linspace(-3.0, 4.0, 9)
        scenes = [towards_wall(formula, unit, order=0.5, speed=float(v), final=1.0) for v in speeds]
        for method in (GAUSS3, method_named("bdf2-nodes")):
            found = integrate_batch(scenes, method, 12, every=3)
            alone = [integrate(scene, method, 12, every=3) for scene in scenes]
            assert [one.status for one in found] == [one.status for one in alone]
            assert [one.message for one in found] == [one.message for one in alone]
            assert {one.status for one in alone} >= {"ok"}
    assert any(one.status == "failed" for one in alone) or formula == "1/s"


@pytest.mark.few(4)
@pytest.mark.parametrize(
    "energy",
    [
        # undefined, infinite or with a finite limit at places that are not on the way
        "log(9 - x) + 1/(x + 9)",
        "sqrt(4 - x**2) + 1/(x**2 + 0.1)**0.5",
        "tan(x)",
        "sin(x - 0.3)/(x - 0.3)",
        "sin(x - 0.3)**2/(x - 0.3)",
        "exp(x)/(1 + x**2 - x)",
        "abs(x)**1.5",
    ],
)
@pytest.mark.parametrize("n_steps", [4, 150])
def test_what_the_motion_does_not_reach_does_not_matter(energy: str, n_steps: int) -> None:
    """The control: poles beside the way, and places with a finite limit on it."""
    scene = lagrangian_scene(
        coordinates=("x",),
        lagrangian=f"vx**2/2 - ({energy})",
        initial_position=0.11,
        initial_velocity=0.9,
        damping=(FractionalDamping(order=0.5, coefficient=2.0),),
        final_time=1.0,
    )
    for method in METHODS:
        run = integrate(scene, method, n_steps)
        assert run.status == "ok", (method.case, run.message)


def test_orbits_around_a_centre_run() -> None:
    """Chords of an orbit pass by the centre, however long they are."""
    for n_steps in (5, 6, 40, 1000):
        scene = kepler(
            attraction=1.0,
            initial_position=(1.0, 0.0),
            initial_velocity=(0.0, 1.0),
            final_time=2 * np.pi,
        )
        run = integrate(scene, GAUSS3, n_steps)
        assert run.status == "ok", run.message
