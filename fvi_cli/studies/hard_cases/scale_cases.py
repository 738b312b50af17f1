"""Units far from 1."""

from __future__ import annotations

import itertools

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.named import pendulum
from fvi_cli.scenes.nonlinear import duffing
from fvi_cli.studies.hard_cases.case import Claim, HardCase, Setting
from fvi_cli.studies.hard_cases.judging import accurate, largest_ratio
from fvi_cli.studies.hard_cases.linear_cases import oscillator

LENGTHS = (1e-150, 1.0, 1e150)
STEPS = (1e-12, 0.125, 1e6)
N_STEPS = 128
ORDERS = (0.5, 1.5)


def tiny_and_huge_scales() -> HardCase:
    """The same motion in units in which its numbers are hardly in range."""
    claims = []
    for order in ORDERS:
        settings = [
            _in_units(order, length, 8.0 * step)
            for length, step in itertools.product(LENGTHS, STEPS)
        ]
        claims.append(accurate(f"relative error, g = {order:g}", 1e-9, *settings))
    for order in ORDERS:
        scaled = [_swinging(order, 8.0 * step) for step in STEPS]
        claims.append(_the_same(f"pendulum in units of time, g = {order:g}", scaled, (1.0,) * 3))
        scaled = [_bistable(order, length) for length in LENGTHS]
        claims.append(_the_same(f"Duffing in units of length, g = {order:g}", scaled, LENGTHS))
    return HardCase(
        name="tiny-and-huge-scales",
        title="x from 1e-150 to 1e150, h from 1e-12 to 1e6",
        description="x'' + 0.3 D^g x + x = 0, x(0) = 1, x'(0) = 1/2, g = 0.5, 1.5; the pendulum "
        "and x'' + 0.3 D^g x + x + x^3 = 0 with the same data; 128 steps of 1/8, all in other "
        "units",
        reference="residues and branch-cut integral of the Laplace transform; nonlinear: the same "
        "run in plain units",
        claims=tuple(claims),
    )


def _in_units(order: float, length: float, second: float) -> Setting:
    coefficient, speed = 0.3 * second ** (order - 2.0), 0.5 * length / second
    scene = oscillator(
        order, coefficient, 16.0 * second, stiffness=second**-2, position=length, velocity=speed
    )
    return Setting(scene, N_STEPS)


def _swinging(order: float, second: float) -> Setting:
    scene: Scene = pendulum(
        final_time=16.0 * second,
        omega=1.0 / second,
        damping=[_damping(order, second)],
        initial_position=1.0,
        initial_velocity=0.5 / second,
    )
    return Setting(scene, N_STEPS)


def _bistable(order: float, length: float) -> Setting:
    scene = duffing(
        final_time=16.0,
        cubic_stiffness=length**-2,
        damping=[_damping(order, 1.0)],
        initial_position=length,
        initial_velocity=0.5 * length,
    )
    return Setting(scene, N_STEPS)


def _damping(order: float, second: float) -> FractionalDamping:
    return FractionalDamping(order=order, coefficient=0.3 * second ** (order - 2.0))


def _the_same(quantity: str, settings: list[Setting], lengths: tuple[float, ...]) -> Claim:
    """The claim that all are multiples of one another, up to round-off; the second is plain."""

    def judge(*trajectories: Trajectory) -> float:
        plain = trajectories[1].position / lengths[1]
        return max(
            largest_ratio(run.position / length - plain, plain)
            for run, length in zip(trajectories, lengths, strict=True)
        )

    return Claim(quantity, 1e-11, settings, judge)
