r"""Whether the steps of a finished run were short enough for what it met, and for its method.

Along the path the scene is close to linear ones. In the modes of each the undamped oscillator
:math:`x'' + \omega^2 x = 0` turns by :math:`\omega h` in a step of length h, and by the step
equations of the method by an eigenvalue :math:`\lambda(\omega h)`: their distance
:math:`|\log \lambda - i \omega h|`, summed over the steps, is the error of its phase.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.matrices import dense
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.stability.patterns import MASS, STIFFNESS, has_patterns, step_patterns
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.planning.resolution import (
    MOST_MODES,
    SLACK,
    STEPS_PER_PERIOD,
    TAKES_PART,
    advice,
    own_period,
)

MOST_VALUES = 1_000_000
"""Second derivatives along a path that are looked at."""
BETWEEN = np.array([0.0, 0.25, 0.5, 0.75])
"""Places in every step where a path is looked at, where there is room for all."""
MOST_PHASES = 1_000
"""States whose errors of phases are averaged."""
SHARE = 0.1
"""Errors of phases below this share of the motion are not remarked on."""
MUCH_SHORTER = 0.5
UNBOUNDED = 3.0
"""So many times farther than before, a run that ends early moves without bound (guessed)."""
FINER = 1.25
MOST_REFINEMENTS = 60


@dataclass(frozen=True, kw_only=True, eq=False)
class _Modes:
    """Modes of linear scenes close to a path, by n states and d modes."""

    time: Array  # (n,)
    position: Array  # (n, d)
    step: Array  # lengths of the steps there, (n,)
    rates: Array  # (n, d), 0 where a mode does not oscillate
    decay: Array  # of their amplitudes, (n, d)
    share: Array  # of the motion that they move by, (n, d)


def path_remarks(
    scene: Scene, method: AnyMethod, trajectory: Trajectory, *, with_phases: bool = True
) -> tuple[str, ...]:
    """What the steps of a run were too long for, with what to write; empty: nothing.

    Besides what was known before the run; errors of phases say something where no error is known.
    """
    if scene.prescribed is not None or scene.is_sparse or scene.dimension > MOST_MODES:
        return ()
    try:
        with np.errstate(all="ignore"):
            modes = _modes_along(scene, trajectory)
    except np.linalg.LinAlgError:
        return ()
    if modes is None:
        return ()
    known = own_period(scene)
    is_long = bool(modes.step.max() > SLACK * known / STEPS_PER_PERIOD)
    found = () if scene.is_linear else _met(modes, scene.final_time, known if is_long else math.inf)
    if found or is_long or not (with_phases and has_patterns(method)):
        return found
    return _out_of_phase(modes, method, scene.final_time)


def unbounded_remark(scene: Scene, trajectory: Trajectory) -> tuple[str, ...]:
    """That a run which ended early was driven away by its potential, and since when."""
    with np.errstate(all="ignore"):
        finite = np.isfinite(trajectory.position).all(axis=1)
        time, path = trajectory.time[finite], trajectory.position[finite]
        if scene.is_linear or scene.prescribed is not None or time.size < 3:
            return ()
        rest = np.zeros_like(path)
        _, stiffness, force = _derivatives(scene, time[-1:], path[-1:], rest[-1:])
        if scene.lagrangian is not None:
            energy = -scene.lagrangian.lagrangian(path, rest, time)
        else:
            energy, force = scene.potential_energy(path), -force
        lowest = np.linalg.eigvalsh(np.nan_to_num(stiffness[0]))[0]
        distance = np.abs(path - path[0]).max(axis=1)
    size = max(float(np.abs(path[0]).max()), float(np.median(distance)))
    # it drives outwards, ever faster, and only where it falls
    outwards = float(force[0] @ (path[-1] - path[0])) > 0.0 > lowest
    if not (outwards and distance[-1] > UNBOUNDED * size and energy[-1] <= energy.min()):
        return ()
    since = float(time[np.flatnonzero(distance <= 0.1 * distance[-1])[-1]])
    return (
        f"motion: it grows without bound from t = {since:.4g} on, to "
        f"{np.abs(path[-1]).max():.4g} at t = {time[-1]:.6g}: the potential energy falls from "
        f"{energy[0]:.4g} to {energy[-1]:.4g} "
        "and has no minimum on this side; is the sign of V meant? L is kinetic minus potential "
        "energy",
    )


def _met(modes: _Modes, final_time: float, known: float) -> tuple[str, ...]:
    """Of the period that is shortest for the step that met it, if that is much below the known."""
    takes_part = (modes.share >= TAKES_PART) & (modes.decay < modes.rates)
    fastest = np.where(takes_part, modes.rates, 0.0).max(axis=1)
    worst = int(np.argmax(modes.step * fastest))
    if not fastest[worst] > 0.0:
        return ()
    step, period = float(modes.step[worst]), 2.0 * math.pi / float(fastest[worst])
    if step <= SLACK * period / STEPS_PER_PERIOD or period > MUCH_SHORTER * known:
        return ()
    place = ", ".join(f"{one:.4g}" for one in modes.position[worst, :4])
    place += ", ..." if modes.position.shape[1] > 4 else ""
    return (
        f"steps: h = {step:.4g} is longer than a quarter of the shortest period {period:.4g} of "
        f"the motion, met near t = {modes.time[worst]:.6g} at q = {place}; "
        f"{advice(final_time, period / STEPS_PER_PERIOD)}",
    )


def _out_of_phase(modes: _Modes, method: AnyMethod, final_time: float) -> tuple[str, ...]:
    """Of the error that phases accumulate over a run."""
    error_of = oscillator_errors(method)
    some = slice(None, None, math.ceil(modes.time.size / MOST_PHASES))
    rates, step = modes.rates[some], modes.step[some, None]
    # old errors decay with the mode
    lasting = np.minimum(1.0, 1.0 / np.maximum(modes.decay[some] * final_time, 1e-300))

    def accumulated(refinement: float) -> tuple[float, int]:
        """The error relative to the motion, and the mode that has most of it."""
        errors = error_of(rates * step / refinement) * refinement
        every = final_time * np.mean(errors / step * lasting, axis=0)
        shares = np.minimum(every, 2.0) * np.minimum(modes.share.mean(axis=0), 1.0)
        return float(shares.sum()), int(shares.argmax())

    found, mode = accumulated(1.0)
    if not found > SHARE:
        return ()
    refinement, count = 1.0, 0
    while count < MOST_REFINEMENTS and accumulated(refinement)[0] > SHARE:
        refinement, count = refinement * FINER, count + 1
    rate, longest = float(modes.rates[:, mode].max()), float(modes.step.max())
    return (
        f"steps: with h = {longest:.4g} {method_name(method)} shifts the phase of motions of the "
        f"period {2.0 * math.pi / rate:.4g} until the error is some {100.0 * min(found, 1.0):.2g} "
        f"% of the motion; {advice(final_time, longest / refinement)}",
    )


def oscillator_errors(method: AnyMethod) -> Callable[[Array], Array]:
    r""":math:`|\log \lambda - i \omega h|` of one step of a method for any :math:`\omega h > 0`.

    The determinant of the step equations is a polynomial of degree 2 in :math:`1 / \lambda`.
    """
    matrices = step_patterns(method, ())(np.array([0.0, 1.0, -1.0], dtype=np.complex128)).real

    def errors(turned: Array) -> Array:
        square = (turned**2)[..., None, None, None]
        whole = matrices[:, MASS] + square * matrices[:, STIFFNESS]
        constant, plus, minus = np.moveaxis(np.linalg.det(whole), -1, 0)
        linear, quadratic = 0.5 * (plus - minus), 0.5 * (plus + minus) - constant
        root = np.sqrt((linear**2 - 4.0 * constant * quadratic).astype(np.complex128))
        # z with Im z < 0, or the larger of two real ones: the other is its conjugate
        inverse = np.stack([-linear + root, -linear - root]) / (2.0 * quadratic)
        distance = np.abs(-np.log(inverse) - 1j * turned).min(axis=0)
        return np.where(turned > 0.0, np.where(np.isfinite(distance), distance, turned), 0.0)

    return errors


def _modes_along(scene: Scene, trajectory: Trajectory) -> _Modes | None:
    """Modes at states of a run, of a linear scene at one; None where it has too few points."""
    finite = np.isfinite(trajectory.position).all(axis=1)
    time, path = trajectory.time[finite], trajectory.position[finite]
    size = 0.5 * float(np.ptp(path, axis=0).max(initial=0.0))
    if time.size < 3 or not size > 0.0:
        return None
    velocity = np.gradient(path, time, axis=0)
    step = np.append(np.diff(time), time[-1] - time[-2]) / trajectory.every
    d = scene.dimension
    if scene.is_linear:
        some = slice(None, None, math.ceil(time.size * d / MOST_VALUES))
        time, path, velocity, step = time[some], path[some], velocity[some], step[some]
        mass, stiffness, force = _linear_derivatives(scene)
    else:
        time, path, velocity, step = _between(time, path, velocity, step)
        mass, stiffness, force = _derivatives(scene, time, path, velocity)
        known = np.isfinite(mass).all(axis=(1, 2)) & np.isfinite(stiffness).all(axis=(1, 2))
        if not known.any():
            return None
        mass, stiffness, force = mass[known], stiffness[known], force[known]
        time, path, velocity, step = time[known], path[known], velocity[known], step[known]
    inverse = np.linalg.inv(np.linalg.cholesky(mass))
    squares, turned = np.linalg.eigh(inverse @ stiffness @ inverse.swapaxes(1, 2))
    shapes = inverse.swapaxes(1, 2) @ turned
    oscillates = squares > 1e-12 * np.abs(squares).max(initial=0.0)
    rates = np.where(oscillates, np.sqrt(np.abs(squares)), 0.0)
    # amplitudes by what velocities and forces would make of them, in the mode alone
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


def _linear_derivatives(scene: Scene) -> tuple[Array, Array, Array]:
    """Mass, stiffness and no force of one state, ``(1, d, d)`` and ``(1, d)``."""
    mass = dense(scene.inertia.form)
    known = scene.potential
    form = dense(known.form) if isinstance(known, QuadraticPotential) else np.zeros_like(mass)
    return mass[None], form[None], np.zeros((1, scene.dimension))


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
    """States at the points of a run and, where there is room, between them by cubics."""
    values = path.shape[1] ** 2
    some = slice(None, None, math.ceil(time.size * values / MOST_VALUES))
    if time.size * values * BETWEEN.size > MOST_VALUES:
        return time[some], path[some], velocity[some], step[some]
    h = np.diff(time)[:, None, None]
    tau = BETWEEN[None, :, None]
    left, right = path[:-1, None], path[1:, None]
    rates = velocity[:-1, None], velocity[1:, None]
    chord = right - left
    bend = (rates[0] * h - chord, chord - rates[1] * h)
    inside = left + tau * chord + tau * (1 - tau) * ((1 - tau) * bend[0] + tau * bend[1])
    slope = chord / h + ((1 - 2 * tau) * ((1 - tau) * bend[0] + tau * bend[1])) / h
    slope = slope + tau * (1 - tau) * (bend[1] - bend[0]) / h
    d = path.shape[1]
    return (
        (time[:-1, None] + np.diff(time)[:, None] * BETWEEN).ravel(),
        inside.reshape(-1, d),
        slope.reshape(-1, d),
        np.repeat(step[:-1], BETWEEN.size),
    )
