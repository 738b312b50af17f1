"""Baselines: what users would write otherwise."""

from __future__ import annotations

import time

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.advance import STRIDE, advanced
from fvi_cli.integrator.baselines.implicit_equation import solve_implicit
from fvi_cli.integrator.baselines.results import (
    baseline_operations,
    baseline_trajectory,
    forces_on_grid,
)
from fvi_cli.integrator.failure import Failure, StepFailedError
from fvi_cli.integrator.growth_bound import beyond, bound_at_end
from fvi_cli.integrator.method import PEER_NAMES, Baseline
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.bdf import convolution_weights


def baseline_objection(scene: Scene, method: Baseline) -> str:
    """Why `method` is not made for `scene`; empty where it is."""
    name = method.case
    if scene.lagrangian is not None:
        return f"{name} is not made for a Lagrangian without a constant mass matrix"
    fractional = [t.order for t in scene.active_damping if not t.is_integer_order]
    if method.name == "dop853" and fractional:
        return f"{name} knows no memory: the order of damping must be 1, not {fractional[0]:g}"
    if scene.derivative == "riemann-liouville" and scene.initial_position.any():
        return f"{name} needs derivative: caputo, or an initial position of 0"
    if method.name in PEER_NAMES:
        from fvi_cli.integrator.baselines.peers import peer_objection

        return peer_objection(scene, method)
    return ""


def integrate_baseline(scene: Scene, method: Baseline, n_steps: int) -> Trajectory:
    """The trajectory of a baseline on t_k = k T / N.

    Raises
    ------
    ValueError
        For scenes that the method is not made for.
    """
    objection = baseline_objection(scene, method)
    if objection:
        raise ValueError(f"baseline: {objection}")
    if method.name == "gruenwald-letnikov":
        from fvi_cli.integrator.baselines.gruenwald_letnikov import integrate_gruenwald_letnikov

        return integrate_gruenwald_letnikov(scene, n_steps)
    if method.name == "product-integration":
        from fvi_cli.integrator.baselines.product_integration import integrate_product_trapezoidal

        return integrate_product_trapezoidal(scene, n_steps)
    if method.tolerance is not None:
        from fvi_cli.integrator.baselines.dormand_prince import integrate_dop853

        return integrate_dop853(scene, method.tolerance, n_steps)
    if method.name in PEER_NAMES:
        from fvi_cli.integrator.baselines.peers import integrate_peer

        return integrate_peer(scene, method, n_steps)
    return _integrate_euler(scene, method, n_steps)


def _integrate_euler(scene: Scene, method: Baseline, n_steps: int) -> Trajectory:
    r"""Explicit or implicit Euler for position and velocity.

    The damping is :math:`h^{1-\gamma} \sum_n w_n v_{k-n}` with the weights of
    :math:`(1 - z)^{\gamma - 1}` (Gruenwald-Letnikov on the velocity), which for
    :math:`\gamma = 1` is the velocity itself, so that the schemes are the classical ones there.
    """
    began = time.perf_counter()
    h = scene.final_time / n_steps
    explicit = method.name == "explicit-euler"
    inverse_mass = np.linalg.inv(scene.inertia.mass)
    rest = np.zeros(scene.dimension)
    terms = []
    for term in scene.active_damping:
        length = 1 if term.is_integer_order else n_steps + 1
        weights = h ** (1 - term.order) * convolution_weights(1, term.order - 1, length)
        is_shifted = term.order > 1 and scene.derivative == "caputo"
        shift = scene.initial_velocity if is_shifted else rest
        terms.append((np.ascontiguousarray(weights[::-1]), weights[0], term.coefficient, shift))
    forces = forces_on_grid(scene, n_steps)
    bound = bound_at_end(scene, n_steps)
    ready = time.perf_counter()
    position = np.empty((n_steps + 1, scene.dimension))
    velocity = np.empty_like(position)
    position[0], velocity[0] = scene.initial_position, scene.initial_velocity
    iterations, done = 0, 0
    failure: Failure | None = None

    def past(index: int) -> Array:
        """Damping force of velocities before `index` on time `index`."""
        force = rest
        for backwards, _, matrix, shift in terms:
            length = min(index, backwards.size - 1)
            if length:
                end = backwards.size - 1
                old = velocity[index - length : index] - shift
                force = force + backwards[end - length : end] @ old @ matrix
        return force

    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n_steps):
            if k % STRIDE == 0:
                advanced(k, n_steps)
            if explicit:
                force = forces[k] - past(k)
                for _, newest, matrix, shift in terms:
                    force = force - newest * (velocity[k] - shift) @ matrix
                if scene.potential is not None:
                    force = force - scene.potential.gradient(position[k])
                velocity[k + 1] = velocity[k] + h * (inverse_mass @ force)
                position[k + 1] = position[k] + h * velocity[k]
            else:
                linear = scene.inertia.mass / h
                constant = linear @ velocity[k] - past(k + 1) + forces[k + 1]
                for _, newest, matrix, shift in terms:
                    linear = linear + newest * matrix
                    constant = constant + newest * shift @ matrix
                try:
                    velocity[k + 1], used = solve_implicit(
                        linear,
                        constant,
                        scene.potential,
                        velocity[k],
                        base=position[k],
                        factor=h,
                        weight=1.0,
                    )
                except StepFailedError as error:
                    failure = Failure.in_step(k, k * h, error)
                    break
                iterations += used
                position[k + 1] = position[k] + h * velocity[k + 1]
            done = k + 1
            failure = beyond(position[done], velocity[done], bound, done, h)
            if failure:
                break
    return baseline_trajectory(
        scene,
        position[: done + 1],
        velocity[: done + 1],
        n_steps,
        failure=failure,
        operations=baseline_operations(method.name, scene, done),
        iterations=iterations,
        began=began,
        ready=ready,
    )
