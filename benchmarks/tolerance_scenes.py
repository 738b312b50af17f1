"""Random scenes of ten kinds, with what is known of their motion from elsewhere."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.data import duffing, kepler, pendulum
from fvi_cli.scenes.lagrangian import lagrangian_scene
from fvi_cli.scenes.structures import linear_oscillator
from tests.oracles.contour import talbot_inverse
from tests.oracles.linear_response import match_scene

Array = NDArray[np.float64]
Random = np.random.Generator
TIMES = 200


class Known(NamedTuple):
    """Positions ``(n, d)`` at times ``(n,)``, how far they may be off, and where they come from."""

    times: Array
    positions: Array
    error: float
    source: str


class Drawn(NamedTuple):
    """A random scene; `known` is made when it is asked for."""

    kind: str
    scene: Scene
    known: Callable[[], Known]


def _damping(order: float, coefficient: float, dimension: int = 1) -> list[FractionalDamping]:
    return [FractionalDamping(order=order, coefficient=coefficient * np.eye(dimension))]


def _order(random: Random) -> float:
    return float(random.choice([random.uniform(0.1, 0.95), random.uniform(1.05, 1.9)]))


def _times(scene: Scene) -> Array:
    begin = scene.final_time * np.geomspace(1e-5, 0.015, 20)
    inside = scene.final_time * np.linspace(0.02, 1.0, TIMES - 20)
    return np.concatenate([begin, inside])


def _closed(scene: Scene) -> Known:
    found = match_scene(scene)
    if found is None:
        raise ValueError("no closed form")
    times = _times(scene)
    values = found.position(times).reshape(times.size, -1)
    scale = float(np.abs(values).max())
    return Known(times, values, 3e-13 * scale, "residues and branch cut")


def _two_runs(scene: Scene) -> Known:
    """Two runs of unrelated degrees and meshes, far finer than any tolerance asks for."""

    def run(degree: int, tolerance: float) -> Trajectory:
        method = Method(cq="gauss", degree=degree, start="none")
        return integrate(scene, method, AdaptiveSteps(tolerance=tolerance), with_steps=True)

    size = float(np.abs(run(6, 1e-6).position).max())
    one, other = run(12, 1e-13 * size), run(9, 1e-14 * size)
    times = _times(scene)
    apart = float(np.abs(one(times) - other(times)).max())
    return Known(times, one(times), 2 * apart, "two fine runs")


def _classical(
    scene: Scene, acceleration: Callable[[float, Array], Array], longest_step: float
) -> Known:
    """An undamped motion by Dormand and Prince's method of order 8, with two tolerances."""
    times, d = _times(scene), scene.dimension
    start = np.concatenate([scene.initial_position, scene.initial_velocity])

    def rate(time: float, state: Array) -> Array:
        return np.concatenate([state[d:], acceleration(time, state[:d])])

    def run(tolerance: float) -> Array:
        found = solve_ivp(
            rate,
            (0.0, scene.final_time),
            start,
            method="DOP853",
            t_eval=times,
            rtol=tolerance,
            atol=tolerance,
            max_step=longest_step,
        )
        return np.asarray(found.y[:d].T, dtype=float)

    fine, coarse = run(3e-14), run(1e-12)
    apart = float(np.abs(fine - coarse).max())
    return Known(times, fine, apart, "DOP853")


def linear(random: Random) -> Drawn:
    """Free linear oscillators."""
    scene = linear_oscillator(
        stiffness=float(10 ** random.uniform(-0.5, 1.5)),
        damping=_damping(_order(random), float(10 ** random.uniform(-2, 1))),
        initial_position=float(random.uniform(-1, 1)),
        initial_velocity=float(random.uniform(-1, 1)),
        final_time=float(random.uniform(1, 30)),
    )
    return Drawn("linear", scene, lambda: _closed(scene))


def strongly_damped(random: Random) -> Drawn:
    """Linear oscillators whose damping is larger than their stiffness may be."""
    scene = linear_oscillator(
        stiffness=float(10 ** random.uniform(0, 4)),
        damping=_damping(_order(random), float(10 ** random.uniform(1, 4))),
        initial_position=1.0,
        initial_velocity=float(random.uniform(-1, 1)),
        final_time=float(random.uniform(1, 10)),
    )
    return Drawn("strongly damped", scene, lambda: _closed(scene))


def forced_at_rest(random: Random) -> Drawn:
    """Linear oscillators at rest under a sine."""
    frequency = float(10 ** random.uniform(-0.5, 1.2))
    order, coefficient = _order(random), float(10 ** random.uniform(-3, 0.5))
    stiffness = float(10 ** random.uniform(-0.5, 1))
    scene = linear_oscillator(
        stiffness=stiffness,
        damping=_damping(order, coefficient),
        forcing=Forcing.from_text(f"sin({frequency!r}*t)"),
        final_time=float(random.uniform(5, 60)),
    )

    def known() -> Known:
        times = scene.final_time * np.linspace(0.013, 0.4, 8)
        values = talbot_inverse(
            lambda s: (
                frequency / ((s**2 + frequency**2) * (s**2 + coefficient * s**order + stiffness))
            ),
            times.tolist(),
            largest_frequency=max(frequency, math.sqrt(stiffness)),
        )
        return Known(times, values[:, None], 1e-15, "Talbot")

    return Drawn("forced at rest", scene, known)


def singular_force(random: Random) -> Drawn:
    """Linear oscillators at rest under a power of t."""
    power = float(random.choice([-0.5, -0.3, -0.7, 0.5, 0.25, 1.5]))
    scene = linear_oscillator(
        stiffness=float(10 ** random.uniform(-0.5, 1)),
        damping=_damping(_order(random), float(10 ** random.uniform(-2, 0.5))),
        forcing=Forcing.from_text(f"t**({power!r})"),
        final_time=float(random.uniform(1, 20)),
    )
    return Drawn("singular force", scene, lambda: _closed(scene))


def sampled_record(random: Random) -> Drawn:
    """Linear oscillators under straight lines through random samples."""
    final_time = float(random.uniform(2, 10))
    knots = np.linspace(0.0, final_time, int(random.integers(20, 60)))
    if random.random() < 0.3:
        inside = np.sort(random.uniform(0, final_time, knots.size - 2))
        knots = np.concatenate([[0.0], inside, [final_time]])
    values = random.standard_normal(knots.size)
    damping = _damping(_order(random), float(10 ** random.uniform(-2, 0.5)))
    stiffness = float(10 ** random.uniform(0, 2))
    force = SampledForce.through(knots, values, "linear")
    scene = linear_oscillator(
        stiffness=stiffness,
        damping=damping,
        forcing=Forcing(pieces=(ForcingPiece(components=(force,)),)),
        final_time=final_time,
    )

    def known() -> Known:
        # a record of straight lines is a sum of ramps, each of which has a closed form
        times = final_time * np.linspace(0.05, 1.0, 20)
        ramp, step = (
            match_scene(
                linear_oscillator(
                    stiffness=stiffness,
                    damping=damping,
                    forcing=Forcing.from_text(text),
                    final_time=final_time,
                )
            )
            for text in ("t", "1")
        )
        if ramp is None or step is None:
            raise ValueError("no closed form")
        slopes = np.diff(values) / np.diff(knots)
        total = values[0] * step.position(times)
        for begin, change in zip(knots[:-1], np.diff(slopes, prepend=0.0), strict=True):
            later = times > begin
            total[later] += change * ramp.position(times[later] - begin)
        scale = float(np.abs(total).max())
        return Known(times, total, 1e-12 * scale, "sum of ramps")

    return Drawn("sampled record", scene, known)


def duffing_scene(random: Random) -> Drawn:
    """Duffing oscillators with one or two wells, free or forced."""
    scene = duffing(
        stiffness=float(random.choice([1.0, -1.0])),
        cubic_stiffness=float(10 ** random.uniform(-1, 1)),
        damping=_damping(_order(random), float(10 ** random.uniform(-2, 0))),
        initial_position=float(random.uniform(-1.5, 1.5)),
        initial_velocity=float(random.uniform(-1, 1)),
        forcing=Forcing.from_text("0.3*cos(1.2*t)") if random.random() < 0.5 else None,
        final_time=float(random.uniform(2, 20)),
    )
    return Drawn("Duffing", scene, lambda: _two_runs(scene))


def near_separatrix(random: Random) -> Drawn:
    """Undamped pendulums that nearly reach the top."""
    velocity = 2.0 * (1.0 + float(random.choice([0.0, -1.0, 1.0])) * 10 ** random.uniform(-6, -1))
    scene = pendulum(initial_velocity=float(velocity), final_time=float(random.uniform(3, 12)))

    def known() -> Known:
        if velocity != 2.0:
            return _classical(scene, lambda t, q: -np.sin(q), 0.05)
        times = _times(scene)
        values = 2.0 * np.arctan(np.sinh(times))
        return Known(times, values[:, None], 1e-15, "2 arctan(sinh t)")

    return Drawn("near the separatrix", scene, known)


def kepler_scene(random: Random) -> Drawn:
    """Orbits with eccentricities up to 0.99, some with drag."""
    eccentricity = float(random.choice([random.uniform(0, 0.9), random.uniform(0.9, 0.99)]))
    data = {
        "initial_position": (1 + eccentricity, 0.0),
        "initial_velocity": (0.0, math.sqrt((1 - eccentricity) / (1 + eccentricity))),
        "final_time": float(random.uniform(2, 12)),
    }
    if random.random() < 0.3:
        damped = kepler(damping=_damping(0.5, 1e-3, 2), **data)  # type: ignore[arg-type]
        return Drawn("Kepler", damped, lambda: _two_runs(damped))
    scene = kepler(**data)  # type: ignore[arg-type]

    def known() -> Known:
        times = _times(scene)
        # from the apocentre: M = t + pi; bisection of E - e sin E = M
        mean = times + math.pi
        low, high = mean - 1.0, mean + 1.0
        for _ in range(70):
            middle = 0.5 * (low + high)
            late = middle - eccentricity * np.sin(middle) > mean
            low, high = np.where(late, low, middle), np.where(late, middle, high)
        values = np.stack(
            [
                eccentricity - np.cos(low),
                -math.sqrt(1 - eccentricity**2) * np.sin(low),
            ],
            axis=1,
        )
        # what round-off in M makes of it at the pericentre
        return Known(times, values, 3e-15 / (1 - eccentricity), "Kepler's equation")

    return Drawn("Kepler", scene, known)


def general_lagrangian(random: Random) -> Drawn:
    """Two coordinates with a mass matrix that depends on them."""
    a = float(random.uniform(0.1, 1))
    scene = lagrangian_scene(
        coordinates=["x", "y"],
        lagrangian=(
            f"(1 + {a!r}*sin(x)**2)*vx**2/2 + vy**2/2 + {a / 3!r}*cos(x - y)*vx*vy"
            " - x**2/2 - y**2 - x**2*y/3"
        ),
        initial_position=[float(random.uniform(-0.5, 0.5)), float(random.uniform(-0.5, 0.5))],
        initial_velocity=[float(random.uniform(-0.5, 0.5)), 0.0],
        damping=_damping(_order(random), float(10 ** random.uniform(-2, 0)), 2),
        final_time=float(random.uniform(2, 10)),
    )
    return Drawn("general Lagrangian", scene, lambda: _two_runs(scene))


def kink_or_wall(random: Random) -> Drawn:
    """Balls between two slopes, and balls that meet a narrow wall."""
    if random.random() < 0.5:
        return _kink(random)
    width = float(10 ** random.uniform(-2.7, -0.5))
    height = float(random.uniform(0.6, 5))
    scene = lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"0.5*vx**2 - {height!r}*exp(-((x-2)/{width!r})**2)",
        initial_position=0.0,
        initial_velocity=1.0,
        final_time=float(random.uniform(3, 5)),
    )

    def push(time: float, q: Array) -> Array:
        u = (q - 2.0) / width
        return np.asarray(2.0 * height / width * u * np.exp(-(u**2)))

    return Drawn("kinks and walls", scene, lambda: _classical(scene, push, 0.2 * width))


def _kink(random: Random) -> Drawn:
    """Between two slopes of unlike steepness: parabolas."""
    left, right = float(random.uniform(0.5, 3)), float(random.uniform(0.5, 3))
    half, middle = 0.5 * (left + right), 0.5 * (right - left)
    scene = lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"0.5*vx**2 - {half!r}*abs(x) - {middle!r}*x",
        initial_position=float(random.uniform(0.5, 2)),
        initial_velocity=float(random.uniform(-1, 1)),
        final_time=float(random.uniform(3, 20)),
    )

    def known() -> Known:
        times = _times(scene)
        values = np.empty(times.size)
        begin, x, v = 0.0, float(scene.initial_position[0]), float(scene.initial_velocity[0])
        is_right = True
        while begin < scene.final_time:
            pull = -right if is_right else left
            # the other root of x + v s + pull s^2 / 2 on this side
            root = math.sqrt(v * v - 2 * pull * x)
            length = (-v - root) / pull if pull < 0 else (-v + root) / pull
            inside = (times >= begin) & (times <= begin + length)
            late = times[inside] - begin
            values[inside] = x + v * late + 0.5 * pull * late**2
            begin, x, v, is_right = begin + length, 0.0, v + pull * length, not is_right
        return Known(times, values[:, None], 1e-13, "parabolas")

    return Drawn("kinks and walls", scene, known)


KINDS: tuple[Callable[[Random], Drawn], ...] = (
    linear,
    strongly_damped,
    forced_at_rest,
    singular_force,
    sampled_record,
    duffing_scene,
    near_separatrix,
    kepler_scene,
    general_lagrangian,
    kink_or_wall,
)
