"""Paths of nonlinear motions at break points, from the points before."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.continuation import asks_for_paths, paths_of, uniform_paths
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.named import linear_oscillator, pendulum


def pieces(*parts: tuple[str, float]) -> Forcing:
    return Forcing(
        pieces=tuple(
            ForcingPiece(components=(Expression.parse(text, variables=("t",)),), until=until)
            for text, until in parts
        )
    )


def pushed(order: float = 0.5) -> Scene:
    return pendulum(
        final_time=4.0,
        damping=[FractionalDamping(order=order, coefficient=0.5)],
        forcing=pieces(("2", 1.0), ("0", 3.0), ("1", math.inf)),
        initial_position=0.5,
        initial_velocity=0.25,
    )


def along_a_sine(n_steps: int, reached: int) -> Trajectory:
    time = 4.0 / n_steps * np.arange(reached + 1)
    return Trajectory(
        time=time,
        position=np.sin(2 * time)[:, None],
        momentum=2 * np.cos(2 * time)[:, None],
        energy=np.zeros(time.size),
        n_steps=n_steps,
        step_size=4.0 / n_steps,
        history_operations=0,
    )


@pytest.mark.parametrize("n_steps", [64, 512, 4096, 2**16])
def test_paths_are_those_of_the_motion_at_any_step(n_steps: int) -> None:
    paths = paths_of(pushed(), along_a_sine(n_steps, n_steps), n_steps, cutoff=10.0)
    for break_point in (1.0, 3.0):
        path = paths.at(break_point)
        assert path is not None
        exact = [
            2.0**k * math.sin(2 * break_point + k * math.pi / 2) / math.factorial(k)
            for k in range(6)
        ]
        # the smallest spacing alone would lose the last to round-off altogether
        assert path[0].coefficients == pytest.approx(exact, abs=2e-4)
        assert path[0].coefficients[:3] == pytest.approx(exact[:3], abs=1e-7)


def test_paths_that_are_not_known() -> None:
    assert paths_of(pushed(), along_a_sine(16, 16), 16, cutoff=8.0).at(1.0) is None
    short = paths_of(pushed(), along_a_sine(64, 20), 64, cutoff=8.0)
    assert short.at(1.0) is not None
    assert short.at(3.0) is None


def test_plans_take_uniform_motion() -> None:
    path = uniform_paths(pushed(), 8.0).at(1.0)
    assert path is not None
    assert [path[0].coefficient(power) for power in (0.0, 1.0, 2.0)] == [0.5, 0.25, 0.0]


def test_only_nonlinear_scenes_with_memory_ask() -> None:
    assert asks_for_paths(pushed())
    assert not asks_for_paths(pushed(order=1.0))
    linear = linear_oscillator(
        final_time=4.0,
        damping=[FractionalDamping(order=0.5, coefficient=0.5)],
        forcing=pieces(("2", 1.0), ("0", math.inf)),
    )
    assert not asks_for_paths(linear)
