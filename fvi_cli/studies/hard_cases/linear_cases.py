"""Free linear oscillators at the edges of stiffness, damping and order."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.stability.prediction import StabilityPrediction
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.linear_response import linear_response
from fvi_cli.scenes.named import linear_oscillator
from fvi_cli.studies.hard_cases.case import Claim, HardCase, Setting
from fvi_cli.studies.hard_cases.judging import (
    LAPLACE,
    Judge,
    accurate,
    exact_positions,
    largest_energy,
    largest_ratio,
)

EXTREME_ORDERS = (0.01, 0.05, 0.95, 1 - 1e-9, 1 + 1e-9, 1.05, 1.95, 1.99)
BESIDE_ONE = 1e-9


def oscillator(
    order: float,
    coefficient: float,
    final_time: float,
    *,
    stiffness: float = 1.0,
    position: float = 0.0,
    velocity: float = 0.0,
) -> Scene:
    r"""Scene of :math:`x'' + \mu D^\gamma x + k x = 0`."""
    return linear_oscillator(
        final_time=final_time,
        stiffness=stiffness,
        damping=[FractionalDamping(order=order, coefficient=coefficient)],
        initial_position=position,
        initial_velocity=velocity,
    )


def stiff_springs() -> HardCase:
    """Springs far too stiff for the step, alone and beside a slow motion."""
    n_steps, final_time = 128, 16.0
    step_size = final_time / n_steps
    claims = []
    # at h^2 k = 1e8 the entries of the matrix hold the soft spring beside k to 1e-6 only
    for ratio, limit in ((1e4, 1e-8), (1e8, 1e-5)):
        stiffness = ratio / step_size**2
        alone = tuple(
            Setting(oscillator(order, 0.1, final_time, stiffness=stiffness, position=1.0), n_steps)
            for order in (0.5, 1.5)
        )
        claims.append(Claim(f"gain of energy, h^2 k = {ratio:.0e}", 1e-9, alone, largest_energy))
        pair = tuple(
            Setting(_stiff_pair(order, stiffness, final_time), n_steps) for order in (0.5, 1.5)
        )
        claims.append(
            Claim(
                f"error of the slow motion beside it, h^2 k = {ratio:.0e}",
                limit,
                pair,
                _slow_error,
                is_comparable=ratio < 1e8,
            )
        )
    return HardCase(
        name="stiff-springs",
        title="stiff springs, h^2 k up to 1e8",
        description="x'' + D^g x/10 + k x = 0 from x(0) = 1; two masses tied by k that move as "
        "one, x'' + D^g x/10 + x = 0; g = 0.5, 1.5; 128 steps on [0, 16]",
        reference=f"energy law; {LAPLACE}",
        claims=tuple(claims),
    )


def _stiff_pair(order: float, stiffness: float, final_time: float) -> Scene:
    return linear_oscillator(
        final_time=final_time,
        mass=np.eye(2),
        stiffness=np.eye(2) + stiffness * np.array([[1.0, -1.0], [-1.0, 1.0]]),
        damping=[FractionalDamping(order=order, coefficient=0.1 * np.eye(2))],
        initial_position=[1.0, 1.0],
        initial_velocity=[0.5, 0.5],
    )


def _slow_error(*trajectories: Trajectory) -> float:
    """Largest error of both masses; what holds them together does not enter the truth."""
    errors = []
    for trajectory, order in zip(trajectories, (0.5, 1.5), strict=True):
        exact = linear_response(
            mass=1.0, stiffness=1.0, damping=((order, 0.1),), position=1.0, velocity=0.5
        )(trajectory.time)
        errors.append(largest_ratio(trajectory.position - exact[:, None], exact))
    return max(errors)


def huge_damping() -> HardCase:
    """Damping far beyond what a step resolves."""
    n_steps, final_time = 128, 16.0
    step_size = final_time / n_steps
    orders = (0.01, 0.1, 0.5, 1.0, 1.5, 1.9, 1.99)
    claims = []
    # the oscillation inside of a step, which nothing can follow, has the amplitude 2 h^2 k / ratio
    for ratio, limit in ((1e2, 5e-4), (1e4, 5e-6)):
        resting, kicked = (
            [
                Setting(
                    oscillator(
                        order,
                        ratio * step_size ** (order - 2.0),
                        final_time,
                        position=1.0,
                        velocity=velocity,
                    ),
                    n_steps,
                )
                for order in orders
            ]
            for velocity in (0.0, 1.0)
        )
        claims.append(
            accurate(f"relative error from rest, mu h^(2-g) = {ratio:.0e}", limit, *resting)
        )
        claims.append(
            Claim(
                f"error after a kick over v0 h, mu h^(2-g) = {ratio:.0e}",
                0.5,
                kicked,
                _in_steps_of(kicked),
            )
        )
    return HardCase(
        name="huge-damping",
        title="huge damping, mu h^(2-g) up to 1e4",
        description="x'' + mu D^g x + x = 0, x(0) = 1, x'(0) = 0 or 1, g = 0.01, 0.1, 0.5, 1, "
        "1.5, 1.9, 1.99; 128 steps on [0, 16]",
        reference=LAPLACE,
        claims=tuple(claims),
    )


def _in_steps_of(settings: list[Setting]) -> Judge:
    def judge(*trajectories: Trajectory) -> float:
        return max(
            float(np.abs(run.position - exact_positions(setting)).max() / run.step_size)
            for run, setting in zip(trajectories, settings, strict=True)
        )

    return judge


def strong_damping() -> HardCase:
    """An order close to 2 with a coefficient of 100."""
    setting = Setting(oscillator(1.9, 100.0, 8.0, stiffness=2.0, position=1.0, velocity=0.5), 512)
    return HardCase(
        name="order-1-9-coefficient-100",
        title="order 1.9 with mu = 100",
        description="x'' + 100 D^1.9 x + 2 x = 0, x(0) = 1, x'(0) = 1/2; 512 steps on [0, 8]",
        reference=LAPLACE,
        claims=(accurate("relative error", 1e-8, setting),),
    )


def extreme_orders() -> HardCase:
    """Orders at the ends of (0, 2) and beside 1."""
    claims = []
    for order in EXTREME_ORDERS:
        setting = Setting(
            oscillator(order, 1.0, 8.0, stiffness=2.0, position=1.0, velocity=0.5), 256
        )
        claims.append(accurate(f"relative error, g = {order!r}", 1e-9, setting))
    return HardCase(
        name="extreme-orders",
        title="orders near 0, 1 and 2",
        description="x'' + D^g x + 2 x = 0, x(0) = 1, x'(0) = 1/2; 256 steps on [0, 8]",
        reference=LAPLACE,
        claims=tuple(claims),
    )


def through_order_one() -> HardCase:
    """Continuity in the order at 1 without a velocity at the start, the true jump with one."""
    n_steps, final_time = 128, 4.0

    def settings(velocity: float) -> tuple[Setting, ...]:
        return tuple(
            Setting(
                oscillator(order, 1.0, final_time, position=1.0 - velocity, velocity=velocity),
                n_steps,
            )
            for order in (1.0 - BESIDE_ONE, 1.0, 1.0 + BESIDE_ONE)
        )

    def continuity(below: Trajectory, at: Trajectory, above: Trajectory) -> float:
        return max(largest_ratio(run.position - at.position, at.position) for run in (below, above))

    def left_continuity(below: Trajectory, at: Trajectory, above: Trajectory) -> float:
        return largest_ratio(below.position - at.position, at.position)

    def jump(below: Trajectory, at: Trajectory, above: Trajectory) -> float:
        # Caputo's derivative of an order just above 1 is x' - v0: a constant force mu v0 more
        rate, t = math.sqrt(3.0) / 2.0, at.time
        step = 1 - np.exp(-t / 2) * (np.cos(rate * t) + np.sin(rate * t) / (2.0 * rate))
        return largest_ratio((above.position - below.position)[:, 0] - step, step)

    moving = settings(1.0)
    return HardCase(
        name="through-order-one",
        title="order through 1",
        description="x'' + D^g x + x = 0, g = 1 and 1 -+ 1e-9, x(0) = 1 at rest, or x(0) = 0 with "
        "x'(0) = 1; 128 steps on [0, 4]",
        reference="elementary functions",
        claims=(
            Claim("difference beside 1, at rest", 1e-8, settings(0.0), continuity),
            Claim("difference below 1, with a velocity", 1e-8, moving, left_continuity),
            Claim("error of the jump, with a velocity", 1e-8, moving, jump),
        ),
    )


def negative_damping() -> HardCase:
    """A coefficient of the opposite sign: the growth is the truth."""
    settings = [Setting(oscillator(order, -0.2, 50.0, position=1.0), 400) for order in (0.5, 1.5)]

    def called_unstable(*predictions: StabilityPrediction) -> float:
        return float(sum(prediction.verdict == "unstable" for prediction in predictions))

    def growth_error(*predictions: StabilityPrediction) -> float:
        return max(abs(p.growth_per_step / p.exact_growth - 1.0) for p in predictions)

    return HardCase(
        name="negative-damping",
        title="negative damping",
        description="x'' - D^g x/5 + x = 0, x(0) = 1, g = 0.5, 1.5; 400 steps on [0, 50]",
        reference=LAPLACE,
        claims=(
            accurate("relative error", 1e-7, *settings),
            Claim(
                "runs that are called unstable",
                0.0,
                settings,
                called_unstable,
                judged="predictions",
            ),
            Claim(
                "relative error of the predicted growth",
                1e-6,
                settings,
                growth_error,
                judged="predictions",
            ),
        ),
    )
