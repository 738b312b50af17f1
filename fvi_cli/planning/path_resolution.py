"""Whether the steps of a finished run were short enough for its path and its method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.stability.patterns import has_patterns
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.planning.accumulated_error import accumulated_error
from fvi_cli.planning.one_step import rate_errors
from fvi_cli.planning.resolution import SLACK, STEPS_PER_PERIOD, advice

TAKES_PART = 1e-3
"""Modes that move by less than this share of the motion do not count (guessed)."""
MOST_MODES = 400
"""Most degrees of freedom for which periods are computed."""
MOST_VALUES = 1_000_000
"""Most second derivatives that are evaluated along a path."""
MOST_SUDDEN = 1_000
"""Most steps with sudden changes that are examined."""
MOST_STATES = 500
"""Most steps of a long run that are examined in addition to those with sudden changes (guessed)."""
SUDDEN, UNEXPLAINED = 0.25, 0.3
"""Changes in one step, relative to the largest momentum: those above the first are examined, and
above the second a remark is made if forces do not explain them. Of 504 correct runs against walls
none was above 0.075, of 11 wrong ones none below 1.2."""
MANY_MORE = 4
"""Advised factor in the number of steps if the length of a wall or pulse is unknown (guessed)."""
BETWEEN = np.array([0.0, 0.25, 0.5, 0.75])
"""Places in every step at which a path is examined if there are not too many, as shares of it."""
SHARE = 0.03
"""Errors below this share of the motion get no remark; nor do long steps if both the error of the
run and the phase error of the fastest mode in one step are less. Of 155 runs with errors above a
tenth three then have no remark; with a tenth as threshold twelve would have none."""
AMPLIFIED = 10.0
"""A remark says that errors grow if they exceed the sum of all steps by this factor (guessed)."""
NO_STEPS = "round-off alone is too large for that: take a shorter run"
UNBOUNDED, FAR = 3.0, 100.0
"""A run moves without bound if it is so many times farther than before: first for runs that end
early, second for runs that reach their end (guessed)."""
BEYOND = 2.0 ** np.arange(7.0)
"""Multiples of the displacement at which the potential has to fall."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Modes:
    """Modes of a scene that is linearised at n states of a path; d modes each."""

    time: Array  # (n,)
    position: Array  # (n, d)
    step: Array  # lengths of the steps at the states, (n,)
    rates: Array  # angular frequencies (n, d), 0 where a mode does not oscillate
    decay: Array  # decay rates of their amplitudes, (n, d)
    share: Array  # their amplitudes as shares of the motion, (n, d)


def path_remarks(
    scene: Scene, method: AnyMethod, trajectory: Trajectory, *, with_errors: bool = True
) -> tuple[str, ...]:
    """Warnings of steps that were too long, with advice; empty: there are none.

    With `with_errors`, and without impacts, errors are estimated as well.
    """
    with_errors &= trajectory.steps is None or trajectory.steps.jump is None
    if scene.prescribed is not None or scene.is_sparse or scene.dimension > MOST_MODES:
        return ()
    error, known = math.inf, None
    try:
        with np.errstate(all="ignore"):
            modes = _modes_along(scene, trajectory)
            if with_errors and has_patterns(method):
                known = accumulated_error(scene, method, trajectory, SHARE)
                error = 0.0 if known is None else float(known.error.max())
    except np.linalg.LinAlgError:
        return ()
    found = () if modes is None else _met(modes, method, error, scene)
    if known is None or known.time.size < trajectory.time.size:
        found = found or _unexplained(scene, trajectory)
    if found or known is None or not error > SHARE:
        return found
    longest = float(np.diff(trajectory.time).max()) / trajectory.every
    grows = f", for this motion makes errors {known.amplification:.2g} times larger"
    return (
        f"steps: with h = {longest:.4g} by {method_name(method)} the error is some "
        f"{float(f'{100.0 * min(error, 1.0):.2g}'):g} % of the motion, above {100.0 * SHARE:g} % "
        f"from t = {known.time[np.argmax(known.error > SHARE)]:.4g} on"
        f"{grows if known.amplification > AMPLIFIED else ''}; "
        + (advice(scene.final_time, longest / known.refinement) if known.refinement else NO_STEPS),
    )


def unbounded_remark(scene: Scene, trajectory: Trajectory) -> tuple[str, ...]:
    """A warning that its potential drives a run away without bound, and since when.

    A run that reached its end must have gone farther, as along a negative stiffness.
    """
    if scene.prescribed is not None or scene.is_sparse or scene.dimension > MOST_MODES:
        return ()
    with np.errstate(all="ignore"):
        time, path = _finite(trajectory)
        if time.size < 3:
            return ()
        far = np.abs(path[-1] - path[0]).max() / (FAR if trajectory.status == "ok" else UNBOUNDED)
        if not far > np.abs(path[0]).max():
            return ()
        distance = np.abs(path - path[0]).max(axis=1)
        # equal times, since points are dense after a singular start
        usual = np.interp(np.linspace(0.0, time[-1], time.size), time, distance)
        if not far > np.median(usual):
            return ()
        at = scene.derivatives(path[-1:], np.zeros_like(path[-1:]), time[-1:])

        def potential(places: Array, times: Array | float) -> Array:
            if scene.lagrangian is not None:
                return -scene.lagrangian.lagrangian(places, np.zeros_like(places), times)
            return scene.potential_energy(places)

        energy = potential(path, time)
        beyond = potential(path[0] + BEYOND[:, None] * (path[-1] - path[0]), time[-1])
        lowest = -np.linalg.eigvalsh(np.nan_to_num(at.stiffness[0]))[-1]
    # the force points outwards, increases outwards, and the potential falls there and beyond
    outwards = float(at.force[0] @ (path[-1] - path[0])) > 0.0 > lowest
    if not outwards or energy[-1] > energy.min() or (np.diff(beyond) > 0.0).any():
        return ()
    since = float(time[np.flatnonzero(distance <= 0.1 * distance[-1])[-1]])
    return (
        f"motion: it grows without bound from t = {since:.4g} on, to "
        f"{np.abs(path[-1]).max():.4g} at t = {time[-1]:.6g}: the potential energy falls from "
        f"{energy[0]:.4g} to {energy[-1]:.4g} and has no minimum on this side; "
        "is the sign of V meant? L is kinetic minus potential energy, and a stiffness that pulls "
        "back is positive",
    )


def _met(modes: _Modes, method: AnyMethod, error: float, scene: Scene) -> tuple[str, ...]:
    """A warning of the period that is shortest relative to its step, if the method errs there."""
    takes_part = (modes.share >= TAKES_PART) & (modes.decay < modes.rates)
    fastest = np.where(takes_part, modes.rates, 0.0).max(axis=1)
    # a linear scene has the same modes everywhere
    fastest = np.broadcast_to(fastest, modes.step.shape)
    worst = int(np.argmax(modes.step * fastest))
    if not fastest[worst] > 0.0:
        return ()
    step, period = float(modes.step[worst]), 2.0 * math.pi / float(fastest[worst])
    if step <= SLACK * period / STEPS_PER_PERIOD:
        return ()
    if error <= SHARE:
        turned = np.array([step * fastest[worst]])
        if abs(rate_errors(method, (), turned)[0, 0]) <= SHARE:
            return ()
    place = ", ".join(f"{one:.4g}" for one in modes.position[worst, :4])
    place += ", ..." if modes.position.shape[1] > 4 else ""
    met = "" if scene.is_linear else f", met near t = {modes.time[worst]:.6g} at q = {place}"
    return (
        f"steps: h = {step:.4g} is longer than a quarter of the shortest period {period:.4g} of "
        f"the motion{met}; {advice(scene.final_time, period / STEPS_PER_PERIOD)}",
    )


def _unexplained(scene: Scene, trajectory: Trajectory) -> tuple[str, ...]:
    """A warning of the largest change of momentum in one step that forces do not explain.

    The change by damping varies slowly: it is estimated from the steps before and after.
    """
    momentum, steps = trajectory.momentum, trajectory.steps
    if scene.is_linear or momentum is None or trajectory.every > 1 or momentum.shape[0] < 4:
        return ()
    path, time = trajectory.position, trajectory.time
    # damping may change the momentum quickly in the first step: leave it out
    is_sudden = _sudden(momentum)[1:-1]
    if steps is not None and steps.jump is not None:
        # impacts change the momentum at once
        pushed = np.asarray(steps.jump[: time.size].any(axis=1))
        is_sudden &= ~(pushed[:-3] | pushed[1:-2] | pushed[2:-1] | pushed[3:])
    sudden = np.flatnonzero(is_sudden)[:MOST_SUDDEN, None] + 1
    if not sudden.size:
        return ()
    size = np.abs(momentum).max(axis=0)
    first = sudden + np.array([-1, 0, 1])
    h = (time[first + 1] - time[first])[..., None]
    ends = [path[first], path[first + 1]]
    ends += [scene.velocity(path[k], momentum[k], time[k]) for k in (first, first + 1)]
    unknown = momentum[first + 1] - momentum[first]
    nodes, weights = np.polynomial.legendre.leggauss(3)
    for tau, weight in zip(0.5 + 0.5 * nodes, 0.5 * weights, strict=True):
        place, rate = _cubic(ends, h, tau)
        times = time[first] + tau * h[..., 0]
        force = scene.forces(place, rate, times)[1]
        if scene.forcing is not None:
            force = force + scene.forcing(times)
        unknown -= weight * h * force
    usual = np.abs(unknown[:, [0, 2]]).max(axis=1)
    share = np.where(size > 0, (np.abs(unknown[:, 1]) - usual) / size, 0.0).max(axis=1)
    share = np.where(np.isnan(share), math.inf, share)
    worst = int(share.argmax())
    if not share[worst] > UNEXPLAINED:
        return ()
    k, step = int(sudden[worst, 0]), float(h[worst, 1, 0])
    at = ", ".join(f"{one:.4g}" for one in path[k, :4])
    return (
        f"steps: in one step of h = {step:.4g} near t = {time[k]:.6g}, at q = {at}, the momentum "
        "changes suddenly, and the forces on its way do not explain it: a wall or a pulse inside "
        f"of the step; {advice(scene.final_time, step / MANY_MORE)}",
    )


def _modes_along(scene: Scene, trajectory: Trajectory) -> _Modes | None:
    """Modes at states of a run, for a linear scene at one; None where there are too few points."""
    time, path = _finite(trajectory)
    size = 0.5 * float(np.ptp(path, axis=0).max(initial=0.0))
    if time.size < 3 or not size > 0.0:
        return None
    d = scene.dimension
    each = math.ceil(time.size * max(d / MOST_VALUES, 0.1 / MOST_SUDDEN)) if scene.is_linear else 1
    first, last = np.arange(0, time.size, each), time.size - 1
    before, behind = np.maximum(first - 1, 0), np.minimum(first + 1, last)
    velocity = (path[behind] - path[before]) / (time[behind] - time[before])[:, None]
    step = (time[behind] - time[np.minimum(first, last - 1)]) / trajectory.every
    if scene.is_linear:
        time, path = time[first], path[first]
        mass, stiffness, force = _linear_derivatives(scene)
    else:
        time, path, velocity, step = _between(time, path, velocity, step)
        mass, stiffness, force = _derivatives(scene, time, path, velocity)
        known = np.isfinite(mass).all(axis=(1, 2)) & np.isfinite(stiffness).all(axis=(1, 2))
        # a cheap bound first: if steps are short for any mode no warning is possible
        lowest = (
            np.linalg.det(mass) / np.trace(mass, axis1=1, axis2=2) ** (d - 1)
            if d > 1
            else mass[:, 0, 0]
        )
        fastest = np.linalg.norm(stiffness, axis=(1, 2)) / lowest
        known &= ~(step**2 * fastest < (2.0 * math.pi / STEPS_PER_PERIOD) ** 2)
        if not known.any():
            return None
        mass, stiffness, force = mass[known], stiffness[known], force[known]
        time, path, velocity, step = time[known], path[known], velocity[known], step[known]
    inverse = np.linalg.inv(np.linalg.cholesky(mass))
    squares, turned = np.linalg.eigh(inverse @ stiffness @ inverse.swapaxes(1, 2))
    shapes = inverse.swapaxes(1, 2) @ turned
    oscillates = squares > 1e-12 * np.abs(squares).max(initial=0.0)
    rates = np.where(oscillates, np.sqrt(np.abs(squares)), 0.0)
    # amplitudes of each mode by its velocity and its force
    swing = np.abs(np.einsum("...a,...am->...m", velocity, mass @ shapes)) / rates
    displaced = np.abs(np.einsum("na,nam->nm", force, shapes)) / squares
    moved = np.hypot(swing.max(axis=0) if scene.is_linear else swing, displaced)
    decay = np.zeros_like(rates)
    for term in scene.active_damping:
        form = np.einsum("nam,nam->nm", shapes, dense(term.form) @ shapes)
        loss = math.sin(0.5 * math.pi * term.order)
        decay += 0.5 * np.abs(form) * loss * rates ** (term.order - 1.0)
    share = np.minimum(np.abs(shapes).max(axis=1) * moved / size, 1.0)
    return _Modes(
        time=time,
        position=path,
        step=step,
        rates=rates,
        decay=np.where(oscillates, decay, 0.0),
        share=np.where(oscillates, share, 0.0),
    )


def _finite(trajectory: Trajectory) -> tuple[Array, Array]:
    """Times and positions of the points with finite positions."""
    known = np.isfinite(trajectory.position)
    rows = slice(None) if known.all() else known.all(axis=1)
    return trajectory.time[rows], trajectory.position[rows]


def _linear_derivatives(scene: Scene) -> tuple[Array, Array, Array]:
    """Mass and stiffness ``(1, d, d)`` and zero force ``(1, d)`` for a single state."""
    mass = dense(scene.inertia.form)
    return mass[None], scene.stiffness[None], np.zeros((1, scene.dimension))


def _derivatives(
    scene: Scene, time: Array, path: Array, velocity: Array
) -> tuple[Array, Array, Array]:
    """Masses, stiffnesses and forces at states, ``(n, d, d)`` and ``(n, d)``."""
    if scene.lagrangian is not None:
        at = scene.lagrangian.derivatives(path, velocity, time)
        mass, stiffness, force = at.mass, -at.stiffness, at.force
    elif scene.potential is not None:
        stiffness, force = scene.potential.hessian(path), scene.potential.gradient(path)
        mass = np.broadcast_to(dense(scene.inertia.form), stiffness.shape)
    else:  # pragma: no cover - such a scene is linear
        return _linear_derivatives(scene)
    halves = ((one + one.swapaxes(1, 2)) * 0.5 for one in (mass, stiffness))
    return next(halves), next(halves), force


def _between(
    time: Array, path: Array, velocity: Array, step: Array
) -> tuple[Array, Array, Array, Array]:
    """States at the points of a run and, if there are not too many, between them by cubics.

    For long runs only some steps are taken, and all steps in which velocities change suddenly.
    """
    values = path.shape[1] ** 2
    first = np.arange(time.size - 1)
    if first.size > MOST_STATES:
        looked_at = _sudden(velocity)
        looked_at[:: math.ceil(first.size / MOST_STATES)] = True
        first = np.flatnonzero(looked_at)
    first = first[:: math.ceil(first.size * values / MOST_VALUES)]
    if first.size * values * BETWEEN.size > MOST_VALUES:
        return time[first], path[first], velocity[first], step[first]
    h = (time[first + 1] - time[first])[:, None, None]
    ends = [one[k, None] for one in (path, velocity) for k in (first, first + 1)]
    inside, slope = _cubic(ends, h, BETWEEN[None, :, None])
    d = path.shape[1]
    return (
        (time[first, None] + h[:, 0] * BETWEEN).ravel(),
        inside.reshape(-1, d),
        slope.reshape(-1, d),
        np.repeat(step[first], BETWEEN.size),
    )


def _sudden(values: Array) -> NDArray[np.bool_]:
    """Steps in which a component changes by a large share of its largest value, ``(n - 1,)``."""
    # transposed, since NumPy is slow along short axes
    rows = np.ascontiguousarray(values.T)
    size = np.abs(rows).max(axis=1, keepdims=True)
    return np.asarray((np.abs(np.diff(rows, axis=1)) > SUDDEN * size).any(axis=0))


def _cubic(ends: Sequence[Array], h: Array, tau: Array | float) -> tuple[Array, Array]:
    """Cubic positions and velocities at shares tau of steps h; `ends`: q, q, v, v at both ends."""
    left, right, begin, end = ends
    chord = right - left
    bend = (begin * h - chord, chord - end * h)
    bent = (1 - tau) * bend[0] + tau * bend[1]
    inside = left + tau * chord + tau * (1 - tau) * bent
    slope = (chord + (1 - 2 * tau) * bent + tau * (1 - tau) * (bend[1] - bend[0])) / h
    return inside, slope
