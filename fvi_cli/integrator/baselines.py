"""Baselines: what users would write otherwise."""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import Baseline
from fvi_cli.integrator.trajectory import NewtonRecord, Trajectory
from fvi_cli.mathematics.bdf import convolution_weights

Array = NDArray[np.float64]


def integrate_baseline(scene: Scene, method: Baseline, n_steps: int) -> Trajectory:
    r"""Explicit or implicit Euler for position and velocity.

    The damping is :math:`h^{1-\gamma} \sum_n w_n v_{k-n}` with the weights of
    :math:`(1 - z)^{\gamma - 1}` (Gruenwald-Letnikov on the velocity), which for
    :math:`\gamma = 1` is the velocity itself, so that the schemes are the classical ones there.

    Raises
    ------
    ValueError
        For Riemann-Liouville damping of a scene that does not start at 0.
    """
    if scene.derivative == "riemann-liouville" and np.any(scene.initial_position != 0):
        raise ValueError(f"baseline: {method.name} needs Caputo damping or a start at 0")
    began = time.perf_counter()
    h = scene.final_time / n_steps
    explicit = method.name == "explicit-euler"
    inverse_mass = np.linalg.inv(scene.inertia.mass)
    terms = []
    for term in scene.active_damping:
        length = 1 if term.is_integer_order else n_steps + 1
        weights = h ** (1 - term.order) * convolution_weights(1, term.order - 1, length)
        shift = scene.initial_velocity if term.order > 1 else np.zeros(scene.dimension)
        terms.append((np.ascontiguousarray(weights[::-1]), weights[0], term.coefficient, shift))
    ready = time.perf_counter()
    position = np.empty((n_steps + 1, scene.dimension))
    velocity = np.empty_like(position)
    position[0], velocity[0] = scene.initial_position, scene.initial_velocity
    operations, iterations, failure, done = 0, 0, "", 0

    def past(index: int) -> Array:
        """Damping force of velocities before `index` on time `index`."""
        nonlocal operations
        force = np.zeros(scene.dimension)
        for backwards, _, matrix, shift in terms:
            length = min(index, backwards.size - 1)
            if length:
                end = backwards.size - 1
                old = velocity[index - length : index] - shift
                force = force + backwards[end - length : end] @ old @ matrix
                operations += length * scene.dimension
        return force

    def pull(q: Array, at: float) -> Array:
        force = np.zeros(scene.dimension)
        if scene.forcing is not None:
            force = force + scene.forcing(np.asarray(at))
        if scene.potential is not None:
            force = force - scene.potential.gradient(q)
        return force

    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n_steps):
            if explicit:
                damping = past(k)
                for _, newest, matrix, shift in terms:
                    damping = damping + newest * (velocity[k] - shift) @ matrix
                acceleration = inverse_mass @ (pull(position[k], k * h) - damping)
                velocity[k + 1] = velocity[k] + h * acceleration
                position[k + 1] = position[k] + h * velocity[k]
            else:
                damping = past(k + 1)
                solved, used = _implicit_step(
                    scene, h, (k + 1) * h, position[k], velocity[k], damping, terms
                )
                iterations += used
                velocity[k + 1] = solved
                position[k + 1] = position[k] + h * solved
            done = k + 1
            if not (np.isfinite(position[done]).all() and np.isfinite(velocity[done]).all()):
                failure = f"not finite after step {k}, t = {done * h:.6g}"
                break
        momentum = velocity[: done + 1] @ scene.inertia.mass
        energy = scene.energy(position[: done + 1], momentum)
    return Trajectory(
        time=h * np.arange(done + 1, dtype=float),
        position=position[: done + 1],
        momentum=momentum,
        energy=energy,
        n_steps=n_steps,
        step_size=h,
        status="diverged" if failure else "ok",
        message=failure,
        history_operations=operations,
        newton=NewtonRecord(iterations=iterations),
        setup_seconds=ready - began,
        stepping_seconds=time.perf_counter() - ready,
    )


def _implicit_step(
    scene: Scene,
    h: float,
    at: float,
    position: Array,
    velocity: Array,
    damping: Array,
    terms: list[tuple[Array, float, Array, Array]],
) -> tuple[Array, int]:
    """Velocity at the end of the step by Newton's iteration with the exact Jacobian."""
    linear = scene.inertia.mass / h
    constant = scene.inertia.mass @ velocity / h - damping
    for _, newest, matrix, shift in terms:
        linear = linear + newest * matrix
        constant = constant + newest * shift @ matrix
    if scene.forcing is not None:
        constant = constant + scene.forcing(np.asarray(at))
    unknown = velocity.copy()
    previous = math.inf
    for iteration in range(1, 51):
        residual = linear @ unknown - constant
        jacobian = linear
        if scene.potential is not None:
            q = position + h * unknown
            residual = residual + scene.potential.gradient(q)
            jacobian = jacobian + h * scene.potential.hessian(q)
        update = np.linalg.solve(jacobian, residual)
        unknown = unknown - update
        size = float(np.abs(update).max())
        scale = float(np.abs(unknown).max())
        if scene.is_linear or size <= 1e-13 * scale or size >= 0.5 * previous or size == 0:
            return unknown, iteration
        previous = size
    return unknown, iteration
