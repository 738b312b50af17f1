"""What runs met on their way, and what their methods make of it, is said with numbers that hold."""

import math
import re

import numpy as np
import pytest
from letters import spring
from scipy.integrate import solve_ivp
from spread import spread

import fvi_cli as fvi
from fvi_cli.integrator.stability.patterns import has_patterns
from fvi_cli.planning import path_resolution
from fvi_cli.planning.one_step import rate_errors
from fvi_cli.planning.path_resolution import path_remarks
from fvi_cli.planning.resolution import resolution_remarks


@pytest.mark.parametrize("seed", range(6))
def test_fast_sines_of_the_time_in_lagrangians(seed: int) -> None:
    random = np.random.default_rng([25, 2, seed])
    second = float(10 ** random.uniform(-6, 6))
    count, shift = int(random.integers(20, 500)), float(random.uniform(-3, 3))
    shape = ["(1 + w*sin(w*t + s))*cos(q)", "q**2*cos(w*t)", "vq*q**2*sin(s - w*t)"][seed % 3]
    rate, final_time = 2 * math.pi * count / (10 * second), 10 * second
    scene = fvi.lagrangian_scene(
        coordinates=["q"],
        lagrangian=f"vq**2/2 + (1e-3*{shape})/u**2 - q**4/u**2*1e-3",
        parameters={"w": rate, "s": shift, "u": second},
        initial_position=[0.7],
        final_time=final_time,
    )
    assert scene.lagrangian is not None
    (said,) = resolution_remarks(scene, 4 * count - 1)
    assert f"quarter of the shortest period {2 * math.pi / rate:.4g} of the Lagrangian" in said
    assert f"take {4 * count} steps or more" in said
    # the control
    assert resolution_remarks(scene, 4 * count + 1) == ()


def test_fast_displacements_of_materials() -> None:
    problem = {
        "kind": "material",
        "displacement": "sin(200*t)",
        "law": {"law": "springpot", "order": 0.5, "coefficient": 1.0},
        "final_time": 10.0,
    }
    for n_steps, is_said in ((100, True), (1300, False)):
        (outcome,) = fvi.run({"name": "fast", "problem": problem, "ladder": {"steps": [n_steps]}})
        remarks = outcome.finished[0].trajectory.remarks
        assert any("0.03142 of the displacement" in one for one in remarks) == is_said


@pytest.mark.parametrize("seed", range(6))
def test_steep_walls_that_a_motion_meets_behind_its_start(seed: int) -> None:
    """A body thrown at an exponential wall turns where its potential is as large as its energy."""
    random = np.random.default_rng([25, 3, seed])
    length, second = (float(10 ** random.uniform(-6, 6)) for _ in range(2))
    steepness, place = float(random.uniform(20, 80)), float(random.uniform(-5, 5))
    speed = float(random.uniform(0.7, 1.4))
    scene = fvi.lagrangian_scene(
        coordinates=["q"],
        lagrangian="vq**2/2 - (l/u)**2*exp(-k*(q/l - p))",
        parameters={"k": steepness, "p": place, "l": length, "u": second},
        initial_position=[(place + 1.0) * length],
        initial_velocity=[-speed * length / second],
        final_time=3 * second,
    )
    # where it turns: exp(-k (q - p)) = speed^2 / 2
    period = 2 * math.pi / (steepness * speed / math.sqrt(2))
    fewest = math.ceil(4 * 3 / period)
    coarse, fine = (fvi.integrate(scene, "gauss3", n) for n in (fewest // 4, 3 * fewest))
    (said,) = path_remarks(scene, fvi.method_named("gauss3"), coarse)
    found = re.search(
        r"h = (\S+) .*period (\S+) of the motion, met near t = (\S+) at q = (\S+);", said
    )
    assert found is not None
    step, met, time, at = (float(one) for one in found.groups())
    assert step == pytest.approx(3 * second / (fewest // 4), rel=1e-3)
    assert 0.3 * period < met / second < 3 * period
    assert time / second == pytest.approx(1 / speed, abs=0.2)
    assert at / length == pytest.approx(place, abs=0.2)
    assert resolution_remarks(scene, fewest // 4) == ()
    # the control
    assert path_remarks(scene, fvi.method_named("gauss3"), fine) == ()


METHODS = ("gauss1", "gauss2", "gauss3", "bdf2", "bdf2-nodes", "explicit-euler")


@pytest.mark.parametrize("name", METHODS)
def test_errors_of_one_step_of_an_oscillator(name: str) -> None:
    """Against powers of a run: after n steps the phase is off by n times as much."""
    method = fvi.method_named(name)
    assert has_patterns(method)
    turned = np.array([0.05, 0.3, 0.9])
    for angle, error in zip(turned, abs(rate_errors(method, (), turned)[0]), strict=True):
        n_steps = 4
        run = fvi.integrate(
            spring((0.5, 0.0), k=1.0, T=n_steps * float(angle), x=1.0), name, n_steps
        )
        # the exact motion is cos t: what is left after n steps is Re exp(i n (angle + error))
        off = abs(run.position[-1, 0] - math.cos(n_steps * angle))
        assert off <= 1.5 * n_steps * error * math.exp(n_steps * error) + 1e-12
        assert error <= 20 * angle


@pytest.mark.parametrize("seed", range(12))
def test_errors_that_are_said_of_phases_are_those_of_the_run(seed: int) -> None:
    random = np.random.default_rng([25, 4, seed])
    name = ["gauss1", "gauss2", "bdf2"][seed % 3]
    period, length = (float(10 ** random.uniform(-5, 5)) for _ in range(2))
    turns, per_turn = int(random.integers(5, 60)), float(random.uniform(4.1, 30))
    rate, final_time = 2 * math.pi / period, turns * period
    decay = float(random.choice([0.0, 0.02])) * rate
    n_steps = math.ceil(turns * per_turn)
    scene = spring((1.0, 2 * decay), k=rate**2, T=final_time, x=length)
    run = fvi.integrate(scene, name, n_steps)
    damped = math.sqrt(rate**2 - decay**2)
    exact = np.exp(-decay * run.time) * (
        np.cos(damped * run.time) + decay / damped * np.sin(damped * run.time)
    )
    error = np.abs(run.position[:, 0] / length - exact).max()
    said = path_remarks(scene, fvi.method_named(name), run)
    if error > 0.25:
        assert said
    if error < 0.04:
        assert not said
    for one in said:
        found = re.search(r"error is some (\S+) %", one)
        assert found is not None
        assert 0.3 * min(error, 1) < float(found[1]) / 100 < 3 * error
        finer = re.search(r"take (\d+) steps", one)
        assert finer is not None
        assert not path_remarks(
            scene,
            fvi.method_named(name),
            fvi.integrate(scene, name, math.ceil(1.4 * int(finer[1]))),
        )


def test_a_pendulum_by_gauss2() -> None:
    """A quarter of its period is enough for none of these words, and not for its phase."""
    final_time, n_steps = 150.0, 120
    scene = fvi.pendulum(initial_position=0.8, final_time=final_time)
    run = fvi.integrate(scene, "gauss2", n_steps)
    exact = solve_ivp(
        lambda t, y: [y[1], -math.sin(y[0])], (0, final_time), [0.8, 0], rtol=1e-10, t_eval=run.time
    )
    error = np.abs(run.position[:, 0] - exact.y[0]).max() / 0.8
    assert error > 0.25
    assert resolution_remarks(scene, n_steps) == ()
    (said,) = path_remarks(scene, fvi.method_named("gauss2"), run)
    assert "Gauss2" in said
    # the control
    assert (
        path_remarks(scene, fvi.method_named("gauss3"), fvi.integrate(scene, "gauss3", 400)) == ()
    )


def test_phases_are_remarked_on_where_no_error_is_known() -> None:
    problem = {
        "kind": "damped-oscillator",
        "stiffness": 1.0,
        "damping": [{"order": 0.5, "coefficient": 0.001}],
        "initial": {"position": 1.0},
        "final_time": 60.0,
    }
    for exact, n_steps, is_said in (("none", 45, True), ("auto", 45, False), ("none", 90, False)):
        config = {"name": "known", "problem": {**problem, "exact": exact}, "method": "gauss2"}
        (outcome,) = fvi.run({**config, "ladder": {"steps": [n_steps]}})
        remarks = outcome.finished[0].trajectory.remarks
        assert any("by Gauss2, graded the error is some" in one for one in remarks) == is_said


@pytest.mark.few(2)
@pytest.mark.parametrize("potential", ["q**4/4", "q**6", "cosh(q)", "exp(q)", "q**4*(1 + t)"])
def test_a_potential_of_the_wrong_sign_is_asked_about(potential: str) -> None:
    said = {}
    for sign in "+-":
        problem = {
            "kind": "lagrangian",
            "coordinates": ["q"],
            "lagrangian": f"vq**2/2 {sign} {potential}",
            "damping": [{"order": 0.6, "coefficient": 0.2}],
            "initial": {"position": 1.0},
            "final_time": 10.0,
            "exact": "none",
        }
        (outcome,) = fvi.run({"name": "sign", "problem": problem, "ladder": {"steps": [400]}})
        run = outcome.finished[0]
        said[sign] = [one for one in run.trajectory.remarks if "is the sign of V meant?" in one]
        assert (run.status == "ok") is (sign == "-")
    (words,) = said["+"]
    assert "grows without bound from t = " in words
    # the control
    assert said["-"] == []


def distance_behind_a_wall(steepness: float, speed: float, time: float) -> float:
    """Of a body thrown from 1 at the wall exp(-k x): exp(-k x) = E / cosh(k (E/2)^(1/2) (t - s))^2.

    At distances where the wall is not felt: the logarithm of cosh z is |z| - log 2.
    """
    energy = speed**2 / 2 + math.exp(-steepness)
    rate = steepness * math.sqrt(energy / 2)
    shift = (math.log(2) + 0.5 * (math.log(energy) + steepness)) / rate
    return (2 * (rate * abs(time - shift) - math.log(2)) - math.log(energy)) / steepness


@pytest.mark.few(1)
@pytest.mark.parametrize("is_long", [False, True])
def test_walls_that_are_met_inside_of_one_step(
    monkeypatch: pytest.MonkeyPatch, is_long: bool
) -> None:
    """No state at the ends of steps is in the wall, and the equations are solved all the same."""
    random = np.random.default_rng([25, 8])
    wrong, silent, missed = 0, 0, 0
    for number in range(10 if is_long else 20):
        length, second = (float(10 ** random.uniform(-6, 6)) for _ in range(2))
        steepness, speed = float(10 ** random.uniform(1.8, 2.7)), float(random.uniform(0.6, 1.4))
        time, n_steps = float(random.uniform(2, 3)), int(random.integers(20, 60))
        if is_long:
            steepness, n_steps = 80 * steepness, 80 * n_steps
        kinds = [("gauss", 3), ("gauss", 4), ("gauss", 5), ("bdf2", 6), ("bdf3", 5), ("bdf4", 3)]
        cq, degree = kinds[random.integers(len(kinds))]
        scene = fvi.lagrangian_scene(
            coordinates=["q"],
            lagrangian="vq**2/2 - (l/u)**2*exp(-k*q/l)",
            parameters={"k": steepness, "l": length, "u": second},
            initial_position=[length],
            initial_velocity=[-speed * length / second],
            final_time=time * second,
        )
        end = distance_behind_a_wall(steepness, speed, time)
        method = fvi.Method(cq=cq, degree=degree)
        run = fvi.integrate(scene, method, n_steps)
        if run.status == "ok" and abs(run.position[-1, 0] / length - end) > 0.1 * max(end, 1.0):
            missed += not any(one.startswith("steps: ") for one in run.remarks)
            wrong += 1
            with monkeypatch.context() as patch:
                patch.setattr(path_resolution, "UNEXPLAINED", math.inf)
                silent += not fvi.integrate(scene, method, n_steps).remarks
        if number % 10 or is_long:
            continue
        fine = fvi.integrate(scene, "gauss4", 20 * math.ceil(steepness))
        assert fine.position[-1, 0] / length == pytest.approx(end, abs=1e-3)
        # the control
        assert fine.remarks == ()
    # of short runs the errors of all steps are added up; of long ones they are not, and without the
    # look at momenta most are silent: with it 3 of 35
    assert wrong > 0
    assert (silent > 0) == is_long
    assert missed <= 0.3 * silent


@spread(few=1, name=["gauss2", "gauss3", "bdf2-nodes"], n_steps=[6, 60, 4000])
def test_integrate_says_what_run_says(name: str, n_steps: int) -> None:
    problems = [
        {"kind": "pendulum", "initial": {"position": 2.0}},
        {"kind": "duffing", "initial": {"position": 2.0}, "forcing": "sin(9*t)"},
        {"kind": "pendulum", "forcing": "300*exp(-((t - 3)/0.01)**2)"},
        {
            "kind": "lagrangian",
            "coordinates": ["q"],
            "lagrangian": "vq**2/2 - (1 + 800*exp(-((t - 3)/0.01)**2))*q**2/2",
            "initial": {"position": 1.0},
        },
    ]
    for problem in problems:
        ladder = {"method": name, "ladder": {"steps": [n_steps]}}
        known = {**problem, "final_time": 30.0, "exact": "none"}
        config = fvi.load({"name": "same", "problem": known, **ladder})
        ((outcome,), scene) = fvi.run(config), config.experiments[0].problem.scene
        words = [
            one for one in outcome.finished[0].trajectory.remarks if not one.startswith("stability")
        ]
        run = fvi.integrate(scene, name, n_steps)
        assert list(run.remarks) == words
        assert words or n_steps > 6 or run.status != "ok"
        assert not words or n_steps < 4000
        assert ("remark" in repr(run)) is bool(words)
