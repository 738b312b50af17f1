r"""The sum of the errors of all steps along the path of a run.

Near a state y = (q, p) the quadratic expansion of the Lagrangian has the linear motion
:math:`y' = A y + c`. From there one step of the method has the error :math:`d_k`, and the motion
carries earlier errors on:

.. math:: e_{k+1} = \Phi_k e_k + d_k, \qquad \Phi_k = e^{h (A_k + A_{k+1}) / 2} .

So phases shift, and errors grow where a motion leaves unstable states. Where energy is conserved,
the error in the energy is known from the run: :math:`\nabla H \cdot e_k = H(y_k) - H(y_0)`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.matrices import dense
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.planning.one_step import exponentials, increments, rate_errors

MOST_STEPS = 1_000
"""For scenes with one coordinate all steps are examined up to this number."""
MOST_ENTRIES = 4_000
"""Most second derivatives that are evaluated."""
WINDOWS, SHORTEST = 4, 8
"""Number of windows of longer runs that are examined, and fewest steps of a window."""
ROUND_OFF = 1e-12
"""Changes of the energy below this share of the kinetic energy are no error (guessed)."""
ITERATIONS = 8
"""Fixed-point iterations for the rates of damped motions."""
FINER, LARGEST_RATIO, MOST_REFINEMENTS = 1.25, 4.0, 9
"""Least and largest ratio of successive refinements of steps, and most refinements."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AccumulatedError:
    """Estimated errors of positions at times of a run, relative to the motion."""

    time: Array
    error: Array
    amplification: float  # largest error over the sum of the errors of all steps
    refinement: float | None  # factor by which steps must be shorter for the wanted error


@dataclass(frozen=True, kw_only=True, eq=False)
class _States:
    """n states of b independent parts of k coordinates; parts of a linear scene are its modes."""

    step: Array  # lengths of the steps from the states, (n,)
    every: int  # number of steps between two states
    velocity: Array  # (n, b, k)
    force: Array
    momentum: Array
    mass: Array  # (n, b, k, k)
    mixed: Array
    stiffness: Array  # second derivatives of L by q: minus those of the potential
    damping: tuple[tuple[float, Array], ...]  # pairs (order, coefficients (b, k, k))
    gain: Array | None  # energy gained since the first state, (n,); None where it need not be 0

    is_regular: bool  # linear scene and equal steps: one map carries all errors

    @property
    def acceleration(self) -> Array:
        return _solved(self.mass, self.force)

    def flow(self, rate: Array, *, with_damping: bool) -> Array:
        """The matrices A, with the losses by damping at frequencies `rate`, (n, b, 2 k, 2 k)."""
        inverse = np.linalg.inv(self.mass)
        turned = self.mixed.swapaxes(-1, -2)
        slope = inverse @ self.mixed
        below, right = self.stiffness - turned @ slope, turned @ inverse
        for order, form in self.damping if with_damping else ():
            loss = form * (math.sin(0.5 * math.pi * order) * rate ** (order - 1.0))[:, None, None]
            below, right = below + loss @ slope, right - loss @ inverse
        upper = np.concatenate([-slope, inverse], axis=-1)
        return np.concatenate([upper, np.concatenate([below, right], axis=-1)], axis=-2)


def _solved(matrix: Array, vector: Array) -> Array:
    """Solutions (n, b, k); without LAPACK for single unknowns, where it is slow."""
    if vector.shape[-1] == 1:
        return np.asarray(vector / matrix[..., 0])
    return np.asarray(np.linalg.solve(matrix, vector[..., None])[..., 0])


def accumulated_error(
    scene: Scene, method: AnyMethod, trajectory: Trajectory, wanted: float
) -> AccumulatedError | None:
    """Estimate the errors of a run, and how much shorter the steps must be for those `wanted`.

    To first order, for methods with step patterns; None where the path does not move or is not
    finite.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a mass matrix on the path is singular.
    """
    count, d = trajectory.time.size - 1, scene.dimension
    size = 0.5 * float(np.ptp(trajectory.position, axis=0).max(initial=0.0))
    if count < 2 or not 0.0 < size < math.inf:
        return None
    length, starts = min(count, MOST_STEPS, MOST_ENTRIES // (d if scene.is_linear else d * d)), [0]
    if length < count:
        length = min(max(length // WINDOWS, SHORTEST), count)
        starts = sorted({int(one) for one in np.linspace(0, count - length, WINDOWS)})
    lasting = count / (len(starts) * length)
    shapes = _shapes(scene)
    windows = [_states(scene, trajectory, shapes, one, one + length) for one in starts]
    windows, rate = _with_real_parts(windows)
    orders, steps = tuple(one[0] for one in windows[0].damping), np.diff(trajectory.time)
    # weighted by time: short steps after a singular start must not dominate the mean
    mean = float(steps @ steps) / float(steps.sum())

    def shifts(finer: float) -> ComplexArray:
        """Rate errors that :func:`increments` does not contain, for modes at the motion's rates."""
        if isinstance(method, Method) and not orders:
            return np.zeros((1, rate.size), dtype=np.complex128)
        return rate_errors(method, orders, rate * (mean / (finer * trajectory.every)))

    def made(finer: float) -> list[Array]:
        """Errors of the steps in each window."""
        shifted = shifts(finer)
        if not windows[0].is_regular:
            return [errors_of_steps(one, method, rate, shifted, finer) for one in windows]
        by_unit = errors_of_steps(_units(windows[0]), method, rate, shifted, finer)
        return [one.velocity[:-1] * by_unit[0] + one.force[:-1] * by_unit[1] for one in windows]

    total, made_by_steps = np.zeros(shapes.shape[1:]), 0.0
    errors: list[Array] = [np.zeros(1)]
    for states, local in zip(windows, made(1.0), strict=True):
        place = _carried(states, local, rate)[:, :, : shapes.shape[2]]
        if len(starts) == 1:
            errors.append(np.abs(np.einsum("dbk,nbk->nd", shapes, place)).max(axis=1))
        else:
            # assume that steps up to the next window err like those of this one
            gap = trajectory.time[-1] / len(starts)
            total *= np.exp(-gap * _losses(states, rate).mean(axis=0))[:, None]
            total += lasting * np.abs(place[-max(length // 4, 1) :]).max(axis=0)
            errors.append(np.einsum("dbk,bk->d", np.abs(shapes), total).max(keepdims=True))
        made_by_steps += lasting * _sum(states, local, shapes, rate)
    error = np.concatenate(errors) / size
    if not np.isfinite(error).all():
        return None
    largest, finer, tried, ratio = float(error.max()), 1.0, 0, FINER
    while largest > wanted and tried < MOST_REFINEMENTS:
        finer, tried = finer * ratio, tried + 1
        left = sum(
            _sum(one, local, shapes, rate) for one, local in zip(windows, made(finer), strict=True)
        )
        before, largest = largest, float(error.max()) * lasting * left / made_by_steps
        # by the order that the last refinement shows
        order = math.log(max(before / largest, 1.0 + 1e-9)) / math.log(ratio) if largest else 1.0
        ratio = min(max((largest / wanted) ** (1.0 / max(order, 0.5)), FINER), LARGEST_RATIO)
    ends = range(count + 1) if len(starts) == 1 else [0, *(one + length for one in starts)]
    return AccumulatedError(
        time=trajectory.time[ends],
        error=error,
        amplification=float(error.max()) * size / made_by_steps if made_by_steps > 0.0 else 1.0,
        refinement=finer if largest <= wanted else None,
    )


def _shapes(scene: Scene) -> Array:
    """Mass-normalised modes of a linear scene, else one part of all coordinates: (d, b, k)."""
    if not scene.is_linear:
        return np.eye(scene.dimension)[:, None, :]
    inverse = np.linalg.inv(np.linalg.cholesky(dense(scene.inertia.form)))
    return np.asarray(inverse.T @ np.linalg.eigh(inverse @ _stiffness(scene) @ inverse.T)[1])[
        :, :, None
    ]


def _stiffness(scene: Scene) -> Array:
    known = scene.potential
    if isinstance(known, QuadraticPotential):
        return dense(known.form)
    return np.zeros((scene.dimension, scene.dimension))


def _states(scene: Scene, trajectory: Trajectory, shapes: Array, first: int, last: int) -> _States:
    here = slice(first, last + 1)
    time, position = trajectory.time[here], trajectory.position[here]
    step = np.diff(time) / trajectory.every
    velocity = np.gradient(position, time, axis=0)
    if trajectory.momentum is not None:
        found = scene.velocity(position, trajectory.momentum[here], time)
        velocity = found if np.isfinite(found).all() else velocity
    forcing: Array | float = 0.0
    if scene.forcing is not None:
        forcing = scene.forcing(time + 0.5 * np.append(step, step[-1]))
    if scene.is_linear:
        _, force = scene.forces(position, velocity, time)
        modes, shape = shapes[..., 0], (*position.shape, 1, 1)
        own = np.einsum("am,ab,bm->m", modes, _stiffness(scene), modes)
        moved = (velocity @ dense(scene.inertia.form) @ modes)[..., None]
        parts = {
            "velocity": moved,
            "momentum": moved,
            "force": ((force + forcing) @ modes)[..., None],
            "mass": np.ones(shape),
            "mixed": np.zeros(shape),
            "stiffness": np.broadcast_to(-own[:, None, None], shape),
        }
    else:
        at = scene.derivatives(position, velocity, time)
        parts = {
            name: one[:, None]
            for name, one in (
                ("velocity", velocity),
                ("momentum", at.momentum),
                ("force", at.force + forcing),
                ("mass", at.mass),
                ("mixed", at.mixed),
                ("stiffness", at.stiffness),
            )
        }
    energy = trajectory.energy
    changes = scene.is_linear or bool(scene.active_forces) or scene.forcing is not None
    changes = changes or (scene.lagrangian is not None and scene.lagrangian.depends_on_time)
    gain = None
    if not changes and energy is not None:
        gain = energy[here] - energy[first]
        # such a small share of the energy is round-off
        gain[
            np.abs(gain) < ROUND_OFF * np.abs((parts["momentum"] * velocity[:, None]).sum((1, 2)))
        ] = 0
    return _States(
        step=step,
        is_regular=scene.is_linear,
        every=trajectory.every,
        damping=tuple(
            (one.order, np.einsum("abk,ac,cbl->bkl", shapes, dense(one.form), shapes))
            for one in scene.active_damping
        ),
        gain=gain,
        **parts,
    )


def _with_real_parts(windows: list[_States]) -> tuple[list[_States], Array]:
    r"""States with the mass and stiffness that damping adds, and the frequency of each part, (b,).

    The real part of :math:`(i \omega)^\gamma` is a stiffness, for orders above 1 a mass.
    """
    squares = [
        sum((one**2).sum(axis=(0, 2)) for one in parts)
        for parts in zip(*((w.acceleration, w.velocity) for w in windows), strict=True)
    ]
    steps, mass = np.concatenate([one.step for one in windows]), windows[0].mass[0]
    is_regular = windows[0].is_regular and float(np.ptp(steps)) <= 1e-6 * float(steps.max())
    with np.errstate(all="ignore"):
        square = squares[0] / squares[1]
    rest = (1e-6 / float(steps.sum())) ** 2
    square = np.where(np.isfinite(square) & (square > rest), square, rest)
    rate = np.sqrt(square)
    inverse, known = np.linalg.inv(mass), []
    for order, form in windows[0].damping:
        size = math.cos(0.5 * math.pi * order) * form
        share = np.einsum("bkl,blk->b", inverse, size) / mass.shape[-1]
        known.append((int(order > 1.0), order, size, share))
    for _ in range(ITERATIONS if known else 0):
        shares = [np.zeros_like(rate), np.zeros_like(rate)]
        for kind, order, _, share in known:
            # for orders above 1 the real part is negative: it acts as a mass
            shares[kind] = shares[kind] + (1 - 2 * kind) * share * rate ** (order - 2.0 * kind)
        used = rate
        rate = np.sqrt((square + np.maximum(shares[0], 0.0)) / (1.0 + np.maximum(shares[1], 0.0)))
    added = [np.zeros_like(mass), np.zeros_like(mass)]
    for kind, order, size, _ in known:
        added[kind] += (1 - 2 * kind) * size * (used ** (order - 2.0 * kind))[:, None, None]
    found = [
        replace(
            one,
            is_regular=is_regular,
            stiffness=one.stiffness - added[0],
            mass=one.mass + added[1],
            momentum=one.momentum + (added[1] @ one.velocity[..., None])[..., 0],
        )
        for one in windows
    ]
    return found, rate


def _units(states: _States) -> _States:
    """Two states, one with unit velocity and one with unit force, for the errors of a step."""
    units = np.eye(3, 2)[:, :, None, None] * np.ones_like(states.velocity[0])
    mass = states.mass[:3]
    return replace(
        states,
        step=states.step[:2],
        velocity=units[:, 0],
        force=units[:, 1],
        momentum=(mass @ units[:, 0, :, None])[..., 0],
        mass=mass,
        mixed=states.mixed[:3],
        stiffness=states.stiffness[:3],
    )


def errors_of_steps(
    states: _States, method: AnyMethod, rate: Array, shifts: ComplexArray, finer: float = 1.0
) -> Array:
    """Errors of the steps from states, `finer` times shorter ones, (n - 1, b, 2 k)."""
    h, k = states.step / finer, states.velocity.shape[2]
    velocity, acceleration, mass = states.velocity[:-1], states.acceleration[:-1], states.mass[:-1]
    rate_by, long = rate[:, None], h[:, None]
    turned = acceleration / rate_by
    # pairs (matrix relative to the mass, rate error)
    parts: list[tuple[Array, ComplexArray]] = []
    if not isinstance(method, Method):
        parts.append((np.eye(k), shifts[0] * np.ones_like(long)))
    for (order, coefficient), shift in zip(states.damping, shifts[1:], strict=True):
        form = np.asarray(np.linalg.solve(mass, np.broadcast_to(coefficient, mass.shape)))
        parts.append((form, long ** (2.0 - order) * shift))
    found = np.zeros((*velocity.shape[:2], 2 * k))
    if isinstance(method, Method):
        whole = np.zeros((*velocity.shape[:2], 2 * k + 1, 2 * k + 1))
        whole[..., : 2 * k, : 2 * k] = states.flow(rate, with_damping=False)[:-1]
        whole[..., : 2 * k, 2 * k] = np.concatenate([velocity, states.force[:-1]], axis=-1)
        exact = exponentials(whole * long[..., None, None])[..., : 2 * k, 2 * k]
        names = ("velocity", "momentum", "force", "mass", "mixed", "stiffness")
        found = increments(method, h, *(getattr(states, name)[:-1] for name in names)) - exact
    for form, shift in parts:
        real, imaginary = shift.real[..., None], shift.imag[..., None]
        place = form @ ((imaginary * velocity - real * turned) / rate_by)[..., None]
        speed = mass @ form @ (real * velocity + imaginary * turned)[..., None]
        found += np.concatenate([place, speed], axis=-2)[..., 0]
    # damping reduces the error of a step together with the motion
    found *= np.exp(-_losses(states, rate) * long)[..., None]
    return np.asarray(found * finer * states.every)


def _losses(states: _States, rate: Array) -> Array:
    """Decay rates of amplitudes in the least damped direction, (n - 1, b)."""
    mass = states.mass[:-1]
    loss = np.zeros(mass.shape[:2])
    for order, form in states.damping:
        share = 0.5 * math.sin(0.5 * math.pi * order) * rate ** (order - 1.0)
        solved = np.linalg.solve(mass, np.broadcast_to(form, mass.shape))
        loss += share * np.linalg.eigvals(solved).real.min(axis=-1)
    return np.maximum(loss, 0.0)


def _carried(states: _States, local: Array, rate: Array) -> Array:
    """Accumulated errors after every step, (n - 1, b, 2 k)."""
    flow = states.flow(rate, with_damping=True)[: 2 if states.is_regular else None]
    h = (states.step * states.every)[: len(flow) - 1, None, None, None]
    maps, errors = exponentials(0.5 * h * (flow[:-1] + flow[1:])), local[..., None].copy()
    if states.is_regular:
        return _repeated(maps[0], local)
    if states.gain is not None:
        # replace the component along the gradient of the energy by the known error of the energy
        slope = np.concatenate([-states.force, states.velocity], axis=-1)[1:]
        units = np.abs(states.stiffness).sum(axis=-1), 1.0 / np.abs(states.mass).sum(axis=-1)
        units = np.maximum(units[0], 1e-12 * units[0].max()), units[1]
        across = slope / np.concatenate(units, axis=-1)[1:]
        size = (slope * across).sum(axis=-1)
        across /= np.where(size > 0.0, size, math.inf)[..., None]
        kept = np.eye(slope.shape[-1]) - across[..., None] * slope[..., None, :]
        maps = kept @ maps
        errors = kept @ errors + (across * states.gain[1:, None, None])[..., None]
    shift = 1
    while shift < len(errors):
        errors[shift:] = errors[shift:] + maps[shift:] @ errors[:-shift]
        maps[shift:] = maps[shift:] @ maps[:-shift]
        shift *= 2
    return np.asarray(errors[..., 0])


def _repeated(carrying: Array, local: Array) -> Array:
    """Accumulated errors after every step where one map carries all errors."""
    errors, shift = np.ascontiguousarray(np.moveaxis(local, 0, -1)), 1
    while shift < len(local):
        errors[..., shift:] += carrying @ errors[..., :-shift]
        carrying, shift = carrying @ carrying, 2 * shift
    return np.moveaxis(errors, -1, 0)


def _sum(states: _States, local: Array, shapes: Array, rate: Array) -> float:
    """The sum of the sizes of local errors; those of p become positions by the rates."""
    k = shapes.shape[2]
    speed = _solved(states.mass[:-1], local[..., k:])
    place = (np.abs(local[..., :k]) + np.abs(speed) / rate[:, None]).sum(axis=0)
    return float(np.einsum("dbk,bk->d", np.abs(shapes), place).max())
