"""Walls in space that are thinner than a step: a tolerance that is met is met behind them."""

import math

import numpy as np
from spread import few_of

import fvi_cli as fvi
from fvi_cli.effects.scene import Scene
from fvi_cli.studies.tolerance import search

SHAPES = {"tanh({u})": (np.tanh, 20.0), "exp(-{u}**2)": (lambda u: np.exp(-(u**2)), 8.0)}
DRAWN = 4


def through_a_wall(rng: np.random.Generator) -> tuple[Scene, float]:
    """A free body that passes a wall, and where it is at the end, by its energy."""
    text = str(rng.choice(list(SHAPES)))
    shape, reach = SHAPES[text]
    place, speed = float(rng.uniform(0.2, 1.0)), float(10 ** rng.uniform(-0.3, 0.7))
    width = float(10 ** rng.uniform(-2.3, -1))
    height = float(rng.choice([-1, 1]) * 10 ** rng.uniform(-5, -1) * speed**2)
    T = float(rng.uniform(2.0, 8.0)) / speed
    edges = place + width * np.linspace(-reach, reach, 401)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    x = edges[:-1, None] + 0.5 * np.diff(edges)[:, None] * (nodes + 1.0)
    start = shape(np.array(-place / width))
    taken = 0.5 * np.diff(edges)[:, None] * weights
    inside = taken / np.sqrt(speed**2 - 2 * height * (shape((x - place) / width) - start))
    behind = math.sqrt(speed**2 - 2 * height * (shape(np.array(reach)) - start))
    end = edges[-1] + behind * (T - edges[0] / speed - inside.sum())
    u = f"((x - {place!r})/{width!r})"
    scene = fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"vx**2/2 - ({height!r})*{text.format(u=u)}",
        initial_position=0.0,
        initial_velocity=speed,
        final_time=T,
    )
    return scene, float(end)


def wrong_in_silence(seed: int) -> int:
    """How many of some scenes with drawn tolerances are said to be met and are not."""
    rng, wrong = np.random.default_rng(seed), 0
    for _ in range(DRAWN):
        scene, exact = through_a_wall(rng)
        tolerance = float(10 ** rng.uniform(-9, -2.5))
        run = fvi.solve(scene, tolerance=tolerance)
        error = abs(run.position[-1, 0] - exact)
        wrong += run.met and error > tolerance + 1e-11
    return wrong


@few_of(2, 8)
def test_what_is_met_is_met_behind_a_wall(seed):
    assert wrong_in_silence(seed) == 0


def test_without_the_tolerance_of_the_whole_it_is_not(monkeypatch):
    """The control: what a step does not see is held against its local tolerance alone."""
    monkeypatch.setattr(search, "MAY_MISS", math.inf)
    assert sum(map(wrong_in_silence, range(3))) > 0
