"""Whether steps are short enough for records, pulses, and the periods of forces."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from fvi_cli.effects.forcing import ForcingPiece, formula_of
from fvi_cli.effects.lagrangian import TIME, Lagrangian
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.growth_bound import PROBED_FRACTIONS
from fvi_cli.integrator.local_error.pulses import Motion, Pulsed, pulsed
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.algebra.dependence import arguments_of
from fvi_cli.mathematics.arrays import Array

STEPS_PER_PERIOD = 4.0
"""Fewer steps do not resolve a period."""
NEGLIGIBLE_MOTION = 1e-9
"""Pulses that move a scene by less than this share of its start do not count (guessed)."""
STEPS_PER_PULSE = 2.0
"""Steps with three nodes resolve a pulse if they are at most so many times the length over which it
is a polynomial (guessed)."""
FIRST_DIGITS = 0.01
"""Pulses count only if steps lose more than this share of their impulse (guessed)."""
PANELS, NODES = 256, 8
"""Number of panels of a run, and nodes in each, for integrals."""
Effect = Callable[[Array], Array]
WAVES = ("sin", "cos")
SLACK = 1.0 + 1e-9
DIFFERENCE = 1e-6
"""Step of difference quotients for the rates of arguments, relative to T."""


def resolution_remarks(
    scene: Scene,
    n_steps: float,
    *,
    grading: float = 1.0,
    nodes: int = 3,
    trajectory: Trajectory | None = None,
) -> tuple[str, ...]:
    """Warnings of steps that are too long, with both lengths and advice; empty: there are none.

    They concern samples, pulses and periods of forces; for the periods of motions see
    `path_remarks`. A step evaluates formulas at `nodes` nodes. Lagrangians that depend on time are
    evaluated at states of `trajectory`, if there is one.
    """
    # the longest of N steps that end at T (k/N)^r
    step = scene.final_time * (1.0 - (1.0 - 1.0 / n_steps) ** grading)
    found: list[str] = []
    for component in () if scene.forcing is None else scene.forcing.samples:
        spacing = _spacing(component, scene.final_time)
        if step > SLACK * spacing:
            found.append(
                f"steps: h = {step:.4g} is longer than the spacing {spacing:.4g} of "
                f"{component.source}; {advice(scene.final_time, spacing)}"
            )
    found += _pulse_remarks(scene, step, nodes, trajectory)
    if scene.prescribed is not None:
        period = _waves_period(scene.prescribed.displacement.pieces, scene.final_time)
        return (*found, *_long_steps(scene, step, [(period, "displacement")]))
    forces = () if scene.forcing is None else scene.forcing.pieces
    periods = [(_waves_period(forces, scene.final_time), "force")]
    if scene.lagrangian is not None:
        periods.append((_lagrangian_period(scene, scene.lagrangian), "Lagrangian"))
    found += _long_steps(scene, step, periods)
    return tuple(dict.fromkeys(found))


def _long_steps(scene: Scene, step: float, periods: Sequence[tuple[float, str]]) -> list[str]:
    return [
        f"steps: h = {step:.4g} is longer than a quarter of the shortest period {period:.4g} of "
        f"the {whose}; {advice(scene.final_time, period / STEPS_PER_PERIOD)}"
        for period, whose in periods
        if step > SLACK * period / STEPS_PER_PERIOD
    ]


def _pulse_remarks(
    scene: Scene, step: float, nodes: int, trajectory: Trajectory | None
) -> list[str]:
    """Warnings of the narrowest pulses that steps may pass over with a visible error.

    Jumps, kinks and steep flanks are also narrow, but steps across them err far less.
    """
    size = float(np.abs(scene.initial_position).max())
    size += scene.final_time * float(np.abs(scene.initial_velocity).max())
    motion = None
    if trajectory is not None and scene.lagrangian and scene.lagrangian.depends_on_time:
        motion = _motion_of(trajectory)
    found: dict[str, tuple[float, str]] = {}
    for one in pulsed(scene, NEGLIGIBLE_MOTION * size, motion):
        now = _passed_over(one, scene, step, nodes)
        found[one.name] = min(now, found.get(one.name, now))
    return [words for _, words in found.values() if words]


def _motion_of(trajectory: Trajectory) -> Motion | None:
    """A function that interpolates positions, velocities and momenta of a run."""
    path, time, momentum = trajectory.position, trajectory.time, trajectory.momentum
    if time.size < 3 or momentum is None or not np.isfinite(path).all():
        return None
    every = path, np.gradient(path, time, axis=0), momentum

    def motion(t: Array) -> tuple[Array, Array, Array]:
        x, v, p = (np.stack([np.interp(t, time, one) for one in k.T], axis=-1) for k in every)
        return x, v, p

    return motion


def _passed_over(one: Pulsed, scene: Scene, step: float, nodes: int) -> tuple[float, str]:
    """Steps that resolve a pulse, and a warning if the present ones are too long."""
    points, seen = np.array(one.pulses.points), step
    if points.size < 2:
        return step, ""
    narrowest = int(np.diff(points).argmin())
    width = float(points[narrowest + 1] - points[narrowest])
    enough = SLACK * STEPS_PER_PULSE * width * (min(nodes, 3) / 3.0) ** 2
    while seen > enough and (_lost_share(one.effect, scene, points, seen, nodes) > FIRST_DIGITS):
        seen = 0.5 * seen
    if seen == step:
        return step, ""
    seen = max(seen, enough / SLACK)
    return seen, (
        f"steps: h = {step:.4g} may pass over a pulse or jump of the {one.name} near t = "
        f"{points[narrowest]:.6g}, some {width:.2g} long; {advice(scene.final_time, seen)}"
    )


def _lost_share(effect: Effect, scene: Scene, points: Array, step: float, nodes: int) -> float:
    """Error of the integral by nodes in every step near `points`, as a share of its range."""
    ends = [0.0, *(one for one in scene.break_points if one < scene.final_time), scene.final_time]
    coarse = np.linspace(0.0, scene.final_time, PANELS + 1)
    times = np.unique([*ends, *points, *coarse])
    whole = np.cumsum(_integrals(effect, times, NODES), axis=0)
    # the range between pulses: within a pulse the integral may be much larger
    whole = whole[np.isin(times[1:], coarse)]
    size = float((np.maximum(whole.max(axis=0), 0) - np.minimum(whole.min(axis=0), 0)).max())
    lost = 0.0
    places = np.interp(np.arange(0, points.size - 0.9, 0.25), np.arange(points.size), points)
    for shift in (0.0, 0.5):
        # ends of the steps that contain such points, or lie between two close ones
        first = step * (np.unique(np.floor(places / step - shift)) + shift)
        edges = np.unique(np.clip([*first, *(first + step), *ends], 0.0, scene.final_time))
        edges = edges[np.diff(edges, prepend=-math.inf) > 1e-13 * scene.final_time]
        panels = np.union1d(edges, points[(points > edges[0]) & (points < edges[-1])])
        inside = np.searchsorted(edges, panels[:-1], side="right") - 1
        own = _integrals(effect, panels, NODES)
        held = np.zeros((edges.size - 1, own.shape[1]))
        np.add.at(held, inside, own)
        seen = _integrals(effect, edges, nodes)
        has_points = np.isin(np.arange(edges.size - 1), np.searchsorted(edges, places) - 1)
        has_points &= np.diff(edges) <= step * SLACK
        missed = np.cumsum(np.where(has_points[:, None], held - seen, 0.0), axis=0)
        # after pulses, where errors of the steps across one pulse have cancelled
        has_points[-1] = False
        lost = max(lost, float(np.abs(missed[~has_points]).max()))
    return lost / size if size > 0 else 0.0


def _integrals(effect: Effect, ends: Array, count: int) -> Array:
    """Integrals between times by Gauss nodes, ``(n, k)``."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    half = 0.5 * np.diff(ends)[:, None]
    with np.errstate(all="ignore"):
        values = effect(ends[:-1, None] + half * (1.0 + nodes))
    values = np.where(np.isfinite(values), values, 0.0)
    return np.asarray(((half * weights)[..., None] * values).sum(axis=1))


def advice(final_time: float, wanted: float) -> str:
    """Advice to take enough steps of at most the length `wanted`."""
    least = math.ceil(final_time / wanted * (1.0 - 1e-9))
    return f"take {least} steps or more, or `accuracy: {{tolerance: ...}}`"


def _spacing(component: SampledForce, final_time: float) -> float:
    knots = component.knots[(component.knots >= 0) & (component.knots <= final_time)]
    return float(np.median(np.diff(knots))) if knots.size > 1 else math.inf


def _waves_period(pieces: Sequence[ForcingPiece], final_time: float) -> float:
    """Shortest period of the sines and cosines in formulas of the time, at probed times."""
    rate, begin = 0.0, 0.0
    for piece in pieces:
        end = min(piece.until, final_time)
        both = _pairs(begin, end, final_time)
        for component, _ in piece.distinct if begin < end else ():
            if (formula := formula_of(component)) is not None:
                waves = arguments_of(formula.system, WAVES)
                known: dict[str, Array | float] = {**dict(formula.constants), "t": both}
                rate = max(rate, _fastest(waves.evaluate(known), both))
        begin = end
    return 2.0 * math.pi / rate if rate > 0 else math.inf


def _lagrangian_period(scene: Scene, lagrangian: Lagrangian) -> float:
    """The same for a Lagrangian as a function of time, at the initial position and velocity."""
    waves = arguments_of(lagrangian.value, WAVES)
    if TIME not in waves.names:
        return math.inf
    both = _pairs(0.0, scene.final_time, scene.final_time)
    position, velocity = (
        np.broadcast_to(one, (*both.shape, scene.dimension))
        for one in (scene.initial_position, scene.initial_velocity)
    )
    found = lagrangian.evaluate(waves, position, velocity, both)
    rate = _fastest(np.moveaxis(found, -1, 0), both)
    return 2.0 * math.pi / rate if rate > 0 else math.inf


def _pairs(begin: float, end: float, final_time: float) -> Array:
    """Probed times in an interval, and times shortly after them, ``(2, n)``."""
    times = begin + max(end - begin, 0.0) * PROBED_FRACTIONS
    return np.stack([times, times + DIFFERENCE * final_time])


def _fastest(arguments: Iterable[Array | float], both: Array) -> float:
    """Largest rate of change of arguments between both rows of times."""
    rate = 0.0
    for values in arguments:
        slopes = np.abs(np.diff(np.broadcast_to(values, both.shape), axis=0)) / np.diff(
            both, axis=0
        )
        rate = max(rate, float(slopes[np.isfinite(slopes)].max(initial=0.0)))
    return rate
