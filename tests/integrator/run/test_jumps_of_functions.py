"""Forces from functions that jump where no break point is given are remarked on, others are not."""

import os
import random
import re
from collections.abc import Callable

import numpy as np
import pytest
from letters import spring
from scipy.interpolate import CubicSpline
from spread import SEED, spread

import fvi_cli as fvi
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.loads.jumps import jump_remarks
from fvi_cli.integrator.meshes.mesh import graded_mesh
from fvi_cli.integrator.method import Baseline, Method

Function = Callable[[np.ndarray], np.ndarray]
METHODS = {
    "gauss": (Method(cq="gauss", degree=3, start="graded"), 60),
    "graded": (Method(cq="gauss", degree=2), graded_mesh(1.0, 50, 2.0)),
    "adaptive": (Method(cq="gauss", degree=4), fvi.AdaptiveSteps(tolerance=1e-6)),
    "bdf": (Method(cq="bdf2", degree=1), 77),
    "baseline": (Baseline(name="gruenwald-letnikov"), 100),
}


def drawn(place: int) -> tuple[Function, list[float], random.Random]:
    """A smooth function with one or two jumps of either sign, and where these are."""
    chance = random.Random(f"{os.environ[SEED]} jumps {place}")
    rate, phase, slope = chance.uniform(0.1, 60.0), chance.uniform(0, 6), chance.uniform(-2, 2)
    places = sorted(chance.uniform(0.03, 0.97) for _ in range(1 + place % 2))
    heights = [chance.choice([-1, 1]) * 10 ** chance.uniform(-1.0, 1.0) for _ in places]
    side, scale = chance.choice(["left", "right"]), 10 ** chance.uniform(-6, 6)

    def force(time: np.ndarray) -> np.ndarray:
        passed = np.searchsorted(places, time, side=side)
        steps = np.concatenate([[0.0], np.cumsum(heights)])[passed]
        return scale * (np.sin(rate * time + phase) + slope * time + steps)

    return force, places, chance


def named(remarks: tuple[str, ...]) -> list[float]:
    """Break points that remarks on jumps tell to write."""
    (found,) = [one for one in remarks if "jumps" in one] or [""]
    listed = re.search(r"break_points=\[(.*)\]", found)
    return [float(one) for one in listed[1].split(",")] if listed else []


def scene_of(force: Function, break_points: tuple[float, ...] = ()) -> fvi.Scene:
    forcing = fvi.Forcing.from_functions(force, break_points=break_points)
    return spring((0.5, 0.3), T=1.0, k=20.0, forcing=forcing)


@spread(place=range(4), method=list(METHODS))
def test_every_jump_is_named_by_every_method(place, method):
    force, places, _ = drawn(place)
    chosen, steps = METHODS[method]
    scene = scene_of(force)
    run = integrate(scene, chosen, steps)
    assert named(run.remarks) == pytest.approx(places, abs=1e-12)
    # what is written silences it, also where it is written for some of them
    assert not jump_remarks(scene_of(force, tuple(named(run.remarks))), run.time)
    some = named(jump_remarks(scene_of(force, tuple(places[1:])), run.time))
    assert some == pytest.approx(places, abs=1e-12)


def test_the_break_points_that_are_named_restore_the_order():
    """The control: without them the error is some 1e4 times larger."""
    force, _, _ = drawn(0)
    method = Method(cq="gauss", degree=3, start="graded")
    run = integrate(scene_of(force), method, 101)
    mended = scene_of(force, tuple(named(run.remarks)))
    exact = integrate(mended, Method(cq="gauss", degree=8, start="graded"), 60).position[-1]
    better = integrate(mended, method, 101)
    assert not named(better.remarks)
    assert abs(run.position[-1] - exact) > 1e3 * abs(better.position[-1] - exact)


def quiet(chance: random.Random) -> dict[str, Function]:
    """Functions that are smooth, fast, bent, steep or noisy, and never jump."""
    at, size = chance.uniform(0.1, 0.9), 10 ** chance.uniform(-9, 9)
    grid = np.linspace(0, 1, chance.randint(50, 5000))
    noise = np.array([chance.gauss(0, 1) for _ in grid])
    rate = 10 ** chance.uniform(0, 7)
    return {
        "smooth": lambda t: size * np.exp(-3 * t) * np.cos(5 * t),
        "fast": lambda t: size * np.sin(rate * t),
        "beside a constant": lambda t: 1e3 + np.sin(rate * t),
        "kink": lambda t: size * np.abs(t - at),
        "root": lambda t: np.sqrt(np.abs(t - at)),
        "cusp": lambda t: np.abs(t - at) ** 0.15,
        "pulse": lambda t: np.exp(-(((t - at) * 3e3) ** 2)),
        "steep": lambda t: np.tanh((t - at) * 1e7),
        "record": lambda t: np.interp(t, grid, size * noise),
        "spline": CubicSpline(grid, noise),
        "triangles": lambda t: size * np.abs((9 * t + at) % 1.0 - 0.5),
        "constant": lambda t: size * np.ones_like(t),
        "number": lambda t: 2.0,
        "zero": lambda t: 0.0 * t,
        "growth": lambda t: np.exp(40 * t),
    }


@pytest.mark.few(5)
@pytest.mark.parametrize("name", list(quiet(random.Random(0))))
def test_what_does_not_jump_is_not_remarked_on(name):
    for seed in range(8):
        chance = random.Random(f"{os.environ[SEED]} {name} {seed}")
        force = quiet(chance)[name]
        for n_steps in (3, 40, 3000):
            times = np.linspace(0.0, 1.0, n_steps + 1)
            assert not jump_remarks(scene_of(force), times), (name, seed, n_steps)


def test_one_component_of_several_is_named():
    forcing = fvi.Forcing.from_functions(np.sin, lambda t: np.where(t > 0.25, 1.0, 0.0))
    scene = fvi.chain(masses=2, mass=1.0, stiffness=1.0, forcing=forcing, final_time=1.0)
    (remark,) = jump_remarks(scene, np.linspace(0, 1, 11))
    assert remark.startswith("forcing: component 2 jumps at t = 0.25,")


def test_a_record_that_is_held_between_its_samples_has_many():
    values = np.random.default_rng(4).standard_normal(201)
    scene = scene_of(lambda t: values[np.minimum(t * 200, 200).astype(int)])
    (remark,) = jump_remarks(scene, np.linspace(0, 1, 101))
    assert "and perhaps at others" in remark
    assert all(abs(t * 200 - round(t * 200)) < 1e-9 for t in named((remark,)))
