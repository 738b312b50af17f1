"""A wall that a motion never meets changes nothing in what is said of its run."""

import re
from dataclasses import replace

import numpy as np
import pytest
from drawn_scenes import KINDS, STRUCTURES, scene_of, shape_of
from letters import spring
from spread import spread

import fvi_cli as fvi
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.observe.request import names_of

FAR = {"when": "{0}**2 + 1", "restitution": 0.5}
LAGRANGIANS = {
    "singular mass": "(1 - x**2)*vx**2/2 + 0.3*vx**4 - x**2/2",
    "mass that changes its sign": "(cos(x) + 0.2)*vx**2/2 + {a}*x**2",
    "pole": "vx**2/2 + {a}/x**2",
    "edge": "vx**2/2 - {a}*sqrt(1.5 + x)",
    "unbounded": "vx**2/2 + {a}*x**2",
    "wall": "vx**2/2 - {a}*x**2/2 - 0.3/cosh((x - 0.05)/2e-3)",
    "pulse": "vx**2/2 - {a}*x**2/2 + 10*x*exp(-((t - 1.3)/1e-3)**2)",
    "waves": "vx**2/2 - (1 + {a}*sin(70*t))*x**2/2",
    "coarse": "vx**2/2 - 60*{a}*x**2/2 - x**4",
}
FORCES = ("jump", "pulse", "waves", "longer")


def drawn_lagrangian(kind: str, rng: np.random.Generator) -> Scene:
    return fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian=LAGRANGIANS[kind].format(a=rng.uniform(0.2, 2.0)),
        initial_position=[rng.choice([0.1, 0.3, 0.6])],
        initial_velocity=[rng.normal()],
        damping=[FractionalDamping(order=rng.uniform(0.1, 1.9), coefficient=rng.uniform(0.1, 0.5))],
        final_time=rng.uniform(2.0, 8.0),
    )


def drawn_force(what: str, size: float, T: float, d: int, rng: np.random.Generator) -> Forcing:
    at = rng.uniform(0.2, 0.8) * T
    if what == "jump":
        return Forcing.from_functions(*[lambda t: np.where(t > at, size, 0.0)] * d)
    text = f"20*{size!r}*exp(-((t - {at!r})/{1e-3 * T!r})**2)"
    if what == "waves":
        text = f"{size!r}*cos({10 ** rng.uniform(0.5, 3)!r}*t)"
    return Forcing.from_text(*[text] * d)


def said(run: fvi.Trajectory) -> tuple[str, str, bool, list[str]]:
    """Status and reason, and remarks without their numbers."""
    reason = run.failure.reason if run.failure else ""
    words = sorted(re.sub(r"-?\d[\d.]*(e[+-]?\d+)?|inf|nan", "#", one)[:60] for one in run.remarks)
    return run.status, reason, "mass matrix" in run.message, words


def looked_at(scene: Scene, method: str, n_steps: int, *, has_wall: bool) -> fvi.Trajectory:
    """A run without or with a wall, looked at between its points."""
    name = names_of(scene)[0]
    wall = {**FAR, "when": str(FAR["when"]).format(name)} if has_wall else None
    impacts = {"far": wall} if wall else None
    return fvi.integrate(scene, method, n_steps, quantities={"own": name}, impacts=impacts)


def twice(scene: Scene, method: str, n_steps: int) -> tuple[fvi.Trajectory, ...]:
    return tuple(looked_at(scene, method, n_steps, has_wall=has) for has in (False, True))


@pytest.mark.few(8)
@spread(few=4, seed=range(6), method=["gauss2", "gauss3", "gauss4"])
@pytest.mark.parametrize("kind", list(LAGRANGIANS))
def test_the_same_is_said_of_lagrangians(seed, method, kind):
    rng = np.random.default_rng([seed, len(kind), len(method)])
    without, with_wall = twice(drawn_lagrangian(kind, rng), method, int(rng.integers(25, 120)))
    assert said(with_wall) == said(without)
    assert with_wall.time[-1] == pytest.approx(without.time[-1], abs=2.0 * without.step_size)


@spread(few=2, seed=range(3), kind=[one for one in KINDS if one not in STRUCTURES], what=FORCES)
def test_the_same_is_said_of_scenes_of_every_kind(seed, kind, what):
    rng = np.random.default_rng([seed, len(kind), len(what)])
    n_steps = int(rng.integers(30, 150))
    shape = shape_of(kind, rng, n_steps)
    scene = scene_of(kind, shape, rng)
    T = scene.final_time
    if what == "longer":
        changed = {"final_time": T if shape.breaks else 6.0 * T}
    else:
        changed = {"forcing": drawn_force(what, shape.scale, T, scene.dimension, rng)}
    without, with_wall = twice(replace(scene, **changed), "gauss3", n_steps)
    assert said(with_wall) == said(without)


def test_each_failure_is_met():
    """The control: of the scenes that are drawn some end before their time."""
    rng = np.random.default_rng(3)
    found = {
        kind: [
            said(looked_at(drawn_lagrangian(kind, rng), "gauss2", 40, has_wall=False))
            for _ in range(3)
        ]
        for kind in LAGRANGIANS
    }
    reasons = {one[1] for every in found.values() for one in every}
    assert {"irregular", "step failed"} <= reasons


@pytest.mark.parametrize("speed", [4.0, 0.5])
def test_a_surface_that_moves_may_take_a_body_anywhere(speed):
    scene = spring((0.5, 0.1), k=0.0, T=3.0, x=1e-9, v=0.0)
    wall = {"when": f"x + 1 - {speed}*t", "restitution": 0.8}
    assert fvi.integrate(scene, "gauss3", 60, impacts={"racket": wall}).status == "ok"
