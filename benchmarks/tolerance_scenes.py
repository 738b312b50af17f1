"""Random scenes of ten kinds, with what is known of their motion from elsewhere."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.truth.judging import UnjudgedError
from benchmarks.truth.others import draw_relaxing
from benchmarks.truth.scenes import Scene as Made
from benchmarks.truth.scenes import draw_general, draw_linear, draw_nonlinear
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.scenes.data import kepler, pendulum
from fvi_cli.scenes.lagrangian import lagrangian_scene
from fvi_cli.scenes.registry import build_scene
from fvi_cli.scenes.structures import linear_oscillator
from tests.oracles.linear_response import match_scene
from tests.oracles.ordinary import Acceleration, solve_ordinary

Array = NDArray[np.float64]
Random = np.random.Generator
TIMES = 200


class Known(NamedTuple):
    """Positions ``(n, d)`` at times ``(n,)``, and how far they may be off."""

    times: Array
    positions: Array
    error: float


class Drawn(NamedTuple):
    """A random scene; `known` is made when it is asked for."""

    kind: str
    scene: Scene
    known: Callable[[], Known]


def _damping(random: Random, low: float, high: float) -> list[FractionalDamping]:
    """A term of any order and a coefficient between two powers of ten."""
    order = float(random.choice([random.uniform(0.1, 0.95), random.uniform(1.05, 1.9)]))
    return [FractionalDamping(order=order, coefficient=10 ** random.uniform(low, high))]


def _times(scene: Scene) -> Array:
    begin = scene.final_time * np.geomspace(1e-5, 0.015, 20)
    inside = scene.final_time * np.linspace(0.02, 1.0, TIMES - 20)
    return np.concatenate([begin, inside])


def _closed(kind: str, scene: Scene) -> Drawn:
    """A linear scene with a closed form."""

    def known() -> Known:
        times = _times(scene)
        values = match_scene(scene).position(times)
        return Known(times, values, 3e-13 * float(np.abs(values).max()))

    return Drawn(kind, scene, known)


def _classical(
    kind: str, scene: Scene, acceleration: Acceleration, longest_step: float = math.inf
) -> Drawn:
    """An undamped scene with its motion by Dormand and Prince's method of order 8."""

    def known() -> Known:
        start = scene.initial_position, scene.initial_velocity
        found = solve_ordinary(acceleration, *start, scene.final_time, longest_step=longest_step)
        times = _times(scene)
        return Known(times, found.position(times), float(found.error.max()))

    return Drawn(kind, scene, known)


def of_battery(draw: Callable[[Random], Made], random: Random) -> Drawn:
    """A scene of the battery of truths; where its reference does not converge, another one."""
    made = draw(random)
    try:
        error = float(made.error.max())
    except UnjudgedError:
        return of_battery(draw, random)
    scene = build_scene(made.problem)
    times = _times(scene)
    kind = draw.__name__.removeprefix("draw_")
    return Drawn(kind, scene, lambda: Known(times, made.position(times), error))


def strongly_damped(random: Random) -> Drawn:
    """Linear oscillators whose damping is larger than their stiffness may be."""
    scene = linear_oscillator(
        stiffness=10 ** random.uniform(0, 4),
        damping=_damping(random, 1, 4),
        initial_position=1.0,
        initial_velocity=random.uniform(-1, 1),
        final_time=random.uniform(1, 10),
    )
    return _closed("strongly damped", scene)


def singular_force(random: Random) -> Drawn:
    """Linear oscillators at rest under a power of t."""
    power = float(random.choice([-0.5, -0.3, -0.7, 0.5, 0.25, 1.5]))
    scene = linear_oscillator(
        stiffness=10 ** random.uniform(-0.5, 1),
        damping=_damping(random, -2, 0.5),
        forcing=Forcing.from_text(f"t**({power!r})"),
        final_time=random.uniform(1, 20),
    )
    return _closed("singular force", scene)


def sampled_record(random: Random) -> Drawn:
    """Linear oscillators under straight lines through random samples."""
    final_time = random.uniform(2, 10)
    knots = np.linspace(0.0, final_time, int(random.integers(20, 60)))
    if random.random() < 0.3:
        inside = np.sort(random.uniform(0, final_time, knots.size - 2))
        knots = np.concatenate([[0.0], inside, [final_time]])
    values = random.standard_normal(knots.size)
    damping, stiffness = _damping(random, -2, 0.5), 10 ** random.uniform(0, 2)

    def scene(forcing: Forcing) -> Scene:
        return linear_oscillator(
            stiffness=stiffness, damping=damping, forcing=forcing, final_time=final_time
        )

    def known() -> Known:
        # a record of straight lines is a sum of ramps, each of which has a closed form
        times = final_time * np.linspace(0.05, 1.0, 20)
        ramp, step = (match_scene(scene(Forcing.from_text(text))) for text in ("t", "1"))
        slopes = np.diff(values) / np.diff(knots)
        total = values[0] * step.position(times)
        for begin, change in zip(knots[:-1], np.diff(slopes, prepend=0.0), strict=True):
            later = times > begin
            total[later] += change * ramp.position(times[later] - begin)
        return Known(times, total, 1e-12 * float(np.abs(total).max()))

    force = SampledForce.through(knots, values, "linear")
    record = Forcing(pieces=(ForcingPiece(components=(force,)),))
    return Drawn("sampled record", scene(record), known)


def near_separatrix(random: Random) -> Drawn:
    """Undamped pendulums that nearly reach the top."""
    velocity = 2.0 * (1.0 + float(random.choice([0.0, -1.0, 1.0])) * 10 ** random.uniform(-6, -1))
    scene = pendulum(initial_velocity=velocity, final_time=random.uniform(3, 12))

    def known() -> Known:
        times = _times(scene)
        return Known(times, 2.0 * np.arctan(np.sinh(times))[:, None], 1e-15)

    drawn = _classical("near the separatrix", scene, lambda t, x, v, z: -np.sin(x), 0.05)
    return drawn if velocity != 2.0 else drawn._replace(known=known)


def kepler_scene(random: Random) -> Drawn:
    """Orbits with eccentricities up to 0.99, from the apocentre."""
    eccentricity = float(random.choice([random.uniform(0, 0.9), random.uniform(0.9, 0.99)]))
    scene = kepler(
        initial_position=(1 + eccentricity, 0.0),
        initial_velocity=(0.0, math.sqrt((1 - eccentricity) / (1 + eccentricity))),
        final_time=random.uniform(2, 12),
    )
    return _classical("Kepler", scene, lambda t, x, v, z: -x / np.linalg.norm(x) ** 3)


def kink_or_wall(random: Random) -> Drawn:
    """Balls between two slopes, and balls that meet a narrow wall."""
    if random.random() < 0.5:
        return _kink(random)
    width, height = 10 ** random.uniform(-2.7, -0.5), random.uniform(0.6, 5)
    scene = lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"0.5*vx**2 - {height!r}*exp(-((x-2)/{width!r})**2)",
        initial_position=0.0,
        initial_velocity=1.0,
        final_time=random.uniform(3, 5),
    )

    def push(time: float, x: Array, v: Array, z: Array) -> Array:
        u = (x - 2.0) / width
        return np.asarray(2.0 * height / width * u * np.exp(-(u**2)))

    return _classical("kinks and walls", scene, push, 0.2 * width)


def _kink(random: Random) -> Drawn:
    """Between two slopes of unlike steepness: parabolas."""
    left, right = random.uniform(0.5, 3), random.uniform(0.5, 3)
    half, middle = 0.5 * (left + right), 0.5 * (right - left)
    scene = lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"0.5*vx**2 - {half!r}*abs(x) - {middle!r}*x",
        initial_position=random.uniform(0.5, 2),
        initial_velocity=random.uniform(-1, 1),
        final_time=random.uniform(3, 20),
    )

    def known() -> Known:
        times = _times(scene)
        values = np.empty(times.size)
        begin, x, v, pull = 0.0, *scene.initial_position, *scene.initial_velocity, -right
        while begin < scene.final_time:
            # the other root of x + v s + pull s^2 / 2 on this side
            root = math.sqrt(v * v - 2 * pull * x)
            length = (-v - root) / pull if pull < 0 else (-v + root) / pull
            inside = (times >= begin) & (times <= begin + length)
            late = times[inside] - begin
            values[inside] = x + v * late + 0.5 * pull * late**2
            begin, x, v, pull = begin + length, 0.0, v + pull * length, left if pull < 0 else -right
        return Known(times, values[:, None], 1e-13)

    return Drawn("kinks and walls", scene, known)


KINDS: tuple[Callable[[Random], Drawn], ...] = (
    *(functools.partial(of_battery, draw) for draw in (draw_linear, draw_nonlinear)),
    *(functools.partial(of_battery, draw) for draw in (draw_general, draw_relaxing)),
    strongly_damped,
    singular_force,
    sampled_record,
    near_separatrix,
    kepler_scene,
    kink_or_wall,
)
