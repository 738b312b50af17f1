r"""How fine a grid must be to see what moves in a scene, told without a run.

Two runs that both miss a motion agree with each other. An unresolved mode stays for a Gauss method
what it was at the start, on every grid (:math:`|R(\infty)| = 1`), and a short feature of the force
that falls between the points is seen by none. What such a motion amounts to is told in advance, and
the steps that it takes to see it.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.stability.linearisation import linearised_at_start

Array = NDArray[np.float64]

LONGEST_STEP: Final = 4.0
"""Largest product of step and frequency (or rate of decay) of a motion that counts."""

COUNTING_SHARE: Final = 0.25
"""Motions of less than this share of the tolerance do not count."""

LARGEST_DIMENSION: Final = 400
"""Scenes with more components are not taken apart into modes."""

USUAL_LEVEL, FINEST_LEVEL = 13, 18
"""The force is looked at on so many halvings of [0, T]: usually, and where it needs more."""

UNRESOLVED_DECREASE: Final = 0.48
"""Surpluses that fall less than this from level to level belong to something unresolved.

They fall by 1/8 where a force is smooth, by 1/4 at kinks, by :math:`2^{-1-e}` at powers t**e.
"""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """One motion on its own time scale.

    Parameters
    ----------
    rate
        Frequency or rate of decay, in 1/time.
    amplitude
        What it contributes to any component of the position, roughly.
    decay
        Rate at which it dies out, roughly; 0: not at all.
    """

    rate: float
    amplitude: float
    decay: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Singularity:
    r"""A fractional power with which the damping force sets in: a term size t**power of position.

    Parameters
    ----------
    order
        Order of the error that a method makes that does nothing about it, in norms over the grid:
        2 more than the power of the force.
    size
        Coefficient of :math:`t^{order}`, roughly; it bounds what the error is measured by.
    """

    order: float
    size: float


@dataclass(frozen=True, kw_only=True)
class Resolution:
    """What a grid must resolve.

    Parameters
    ----------
    least_steps
        Number of steps below which a motion that counts is not seen; 1 where there is none.
    forcing_points
        Number of points in [0, T] below which a feature of the force is missed; 0 without force.
    motions
        Modes of the linearised scene and layers of its damping.
    singularities
        With which the scene starts, and goes on after jumps of the force.
    reason
        What asks for `least_steps`, in words; empty where nothing does.
    """

    least_steps: int
    forcing_points: int
    motions: tuple[Motion, ...]
    singularities: tuple[Singularity, ...]
    reason: str


def find_resolution(scene: Scene, tolerance: float) -> Resolution:
    r"""Look at modes, damping layers and force of a scene.

    Of the scene linearised at its start the modes :math:`\omega_j` of mass and stiffness are
    taken, with the amplitude :math:`|a_j|/\omega_j^2 + |v_j|/\omega_j` that the acceleration at
    the start (and that of every jump of the force) and the velocity there give them, and for every
    damping term the layers of rate :math:`r = \mu^{1/(2 - \gamma)}`, with :math:`|a|/r^2` and,
    where the derivative acts on the velocity at the start, :math:`|v|/r`.

    Parameters
    ----------
    scene
        The scene.
    tolerance
        Accuracy of positions that is wanted.

    Returns
    -------
    Resolution
        A nonlinear scene may become stiffer on its way; that is seen by runs only.
    """
    motions, singularities = _motions(scene)
    least = 1.0
    reason = ""
    for motion in motions:
        needed = motion.rate * scene.final_time / LONGEST_STEP
        if motion.amplitude > COUNTING_SHARE * tolerance and needed > least:
            least = needed
            reason = f"a motion of rate {motion.rate:.3g} and size {motion.amplitude:.2g}"
    return Resolution(
        least_steps=math.ceil(min(least * (1 - 1e-12), 2.0**62)),
        forcing_points=_forcing_points(scene, tolerance),
        motions=motions,
        singularities=singularities,
        reason=reason,
    )


def _motions(scene: Scene) -> tuple[tuple[Motion, ...], tuple[Singularity, ...]]:
    if scene.dimension > LARGEST_DIMENSION or scene.is_sparse:
        return (), _unknown_singularities(scene)
    singular: list[Singularity] = []
    if scene.active_laws:
        singular += _unknown_singularities(scene)
    try:
        linear = linearised_at_start(scene)
        factor: Array = np.asarray(np.linalg.cholesky(linear.inertia.mass), dtype=float)
    except (ValueError, np.linalg.LinAlgError):
        return (), _unknown_singularities(scene)
    found: list[Motion] = []
    with np.errstate(all="ignore"):
        kicks = _accelerations(scene, linear, factor)
        velocity = factor.T @ scene.initial_velocity
        if linear.potential is not None:
            stiffness = linear.potential.hessian(scene.initial_position)
            for law in linear.active_laws:
                # as stiff as a law is at first
                if law.kernel.at_start < math.inf:
                    stiffness = stiffness + law.size * law.kernel.at_start * law.coefficient
            modes = _scaled(stiffness, factor, kicks, velocity, power=2.0)
            found += [_damped(mode, linear, factor) for mode in modes]
        for term in linear.active_damping:
            sees_velocity = term.order <= 1 or scene.derivative == "riemann-liouville"
            own = velocity if sees_velocity else np.zeros_like(velocity)
            layers = _scaled(term.coefficient, factor, kicks, own, power=2.0 - term.order)
            found += [replace(layer, decay=layer.rate) for layer in layers]
            if not term.is_integer_order:
                strength = float(
                    np.abs(term.coefficient).max() * np.abs(np.linalg.inv(factor)).max()
                )
                singular += _singularities(scene, term.order, strength, kicks, own)
    return tuple(found), tuple(singular)


def _singularities(
    scene: Scene, order: float, strength: float, kicks: Array, velocity: Array
) -> list[Singularity]:
    """Terms that a velocity, an acceleration and, of Riemann-Liouville, a position give rise to."""
    sources = [
        (3.0 - order, np.abs(velocity).max()),
        (4.0 - order, np.abs(kicks).sum(axis=0).max()),
    ]
    if scene.derivative == "riemann-liouville":
        # the force -q0 t**(-order) makes a motion t**(2 - order), which is damped in turn
        sources.append((4.0 - 2.0 * order, strength * np.abs(scene.initial_position).max()))
    return [
        Singularity(order=power, size=strength * float(source) / math.gamma(1.0 + power))
        for power, source in sources
        if source > 0
    ]


def _unknown_singularities(scene: Scene) -> tuple[Singularity, ...]:
    orders = [term.order for term in scene.active_damping if not term.is_integer_order]
    begins = [law.kernel.start_order for law in scene.active_laws]
    orders += [order for order in begins if order is not None]
    return tuple(
        Singularity(order=(3.0 if order < 1 else 4.0) - order, size=math.inf) for order in orders
    )


def _damped(mode: Motion, linear: Scene, factor: Array) -> Motion:
    r"""The mode with the decay of weak damping, :math:`\mu \omega^{\gamma-1} \sin(\gamma \pi/2)/2`.

    With the least eigenvalue of every damping matrix against the mass: no mode is taken to die out
    sooner than it does.
    """
    decay = 0.0
    for term in linear.active_damping:
        scaled = np.linalg.solve(factor, np.linalg.solve(factor, term.coefficient).T)
        least = float(np.linalg.eigvalsh(0.5 * (scaled + scaled.T))[0])
        decay += (
            0.5 * least * mode.rate ** (term.order - 1.0) * math.sin(0.5 * math.pi * term.order)
        )
    return replace(mode, decay=min(max(decay, 0.0), mode.rate))


def _accelerations(scene: Scene, linear: Scene, factor: Array) -> Array:
    """Accelerations that begin at once, at the start and at jumps of the force; shape (n, d).

    In the coordinates in which the mass is one.
    """
    position, velocity = scene.initial_position, scene.initial_velocity
    start = np.zeros(scene.dimension)
    if scene.lagrangian is not None:
        start = start + scene.lagrangian.force(position, velocity, 0.0)
    elif scene.potential is not None:
        start = start - scene.potential.gradient(position)
    forces = []
    if scene.forcing is not None:
        pieces = scene.forcing.pieces
        start = start + pieces[0].evaluate(np.zeros(()))
        for before, after in itertools.pairwise(pieces):
            if before.until < scene.final_time:
                at = np.asarray(before.until)
                forces.append(after.evaluate(at) - before.evaluate(at))
    for term in linear.active_damping:
        if term.order == 1.0:
            start = start - term.coefficient @ velocity
    return np.linalg.solve(factor, np.array([start, *forces]).T).T


def _scaled(
    matrix: Array, factor: Array, kicks: Array, velocity: Array, *, power: float
) -> list[Motion]:
    """Rates |c|**(1/power) of the eigenvalues c of a matrix against the mass, with amplitudes."""
    scaled = np.linalg.solve(factor, np.linalg.solve(factor, matrix).T)
    if not np.isfinite(scaled).all():
        return []
    values, modes = np.linalg.eigh(0.5 * (scaled + scaled.T))
    shapes = np.abs(np.linalg.solve(factor.T, modes)).max(axis=0)
    accelerations = np.abs(kicks @ modes).sum(axis=0)
    speeds = np.abs(velocity @ modes)
    found = []
    for value, shape, kick, speed in zip(values, shapes, accelerations, speeds, strict=True):
        if not abs(value) > 0:
            continue
        # what grows has its time scale as well
        rate = math.exp(min(math.log(abs(value)) / power, 300.0))
        found.append(Motion(rate=rate, amplitude=float(shape * (kick / rate + speed) / rate)))
    return found


def _forcing_points(scene: Scene, tolerance: float) -> int:
    """Number of points in [0, T] below which something in the force is missed; 0 without force.

    Jumps at break points are no features: grids have them between two steps.
    """
    ends = [0.0, *scene.break_points, scene.final_time]
    spare = math.ceil(math.log2(len(ends) - 1))
    most = 0.0
    for index, (start, end) in enumerate(itertools.pairwise(ends)):
        points = 0
        for level in (max(USUAL_LEVEL - spare, 5), max(FINEST_LEVEL - spare, 5)):
            values = _sampled_force(scene, index, start, end, 2**level)
            if values is None:
                break
            points = _points_of(values, end - start, tolerance / scene.final_time)
            if points < values.shape[0] // 2:
                break
        most = max(most, points * scene.final_time / (end - start))
    return math.ceil(most * (1 - 1e-12))


def _sampled_force(scene: Scene, index: int, start: float, end: float, n: int) -> Array | None:
    """A piece of the force at n + 1 times in accelerations, shape ``(n + 1, d)``.

    The times are not quite equidistant, lest they hit the zeros of a fast oscillation.
    """
    u = np.arange(n + 1) / n
    times = start + (end - start) * (u + 0.1 * u * (1.0 - u))
    total: Array | None = None
    with np.errstate(all="ignore"):
        if scene.forcing is not None:
            total = scene.forcing.pieces[index].evaluate(times)
        if scene.lagrangian is not None and scene.lagrangian.depends_on_time:
            shape = (times.size, scene.dimension)
            position = np.broadcast_to(scene.initial_position, shape)
            velocity = np.broadcast_to(scene.initial_velocity, shape)
            driving = scene.lagrangian.force(position, velocity, times)
            total = driving if total is None else total + driving
        if total is None or not np.isfinite(total).all():
            return None
        return scene.inertia.velocity(total)


def _points_of(values: Array, length: float, least: float) -> int:
    """The first of 2, 4, 8, ... points from which on linear interpolation gets better quickly.

    Surpluses times the widths of their intervals are impulses that a grid does not see: all
    together, as of an oscillation, or the largest, as of a short feature. Those below a share of
    `least` do not count: they move nothing by the tolerance.
    """
    n = values.shape[0] - 1
    impulses = []
    width = n
    while width > 1:
        ends = values[::width]
        middle = values[width // 2 :: width]
        surplus = np.abs(middle - 0.5 * (ends[:-1] + ends[1:])).max(axis=1)
        step = length * width / n
        impulses.append((float(surplus.sum()) * step, float(surplus.max()) * step))
        width //= 2
    for level in range(len(impulses) - 1, 0, -1):
        for here, before in zip(impulses[level], impulses[level - 1], strict=True):
            if here > max(COUNTING_SHARE * least, UNRESOLVED_DECREASE * before):
                return int(2 ** (level + 1))
    return 2
