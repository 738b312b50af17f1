"""The baseline of Dormand and Prince: SciPy's DOP853, for scenes without memory."""

from __future__ import annotations

import time

import numpy as np
from scipy.integrate import solve_ivp

from fvi_cli.effects.forcing import ForcingPiece
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.baselines.results import baseline_trajectory
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array


def integrate_dop853(scene: Scene, tolerance: float, n_steps: int) -> Trajectory:
    """Runge-Kutta of order 8(5,3) with steps of its own and dense output at t_k = k T / N.

    Parameters
    ----------
    scene
        Damping of order 1 only.
    tolerance
        Relative and absolute tolerance of a step.
    n_steps
        Number of intervals of the grid on which the solution is asked for.

    Returns
    -------
    Trajectory
        The number of evaluations of the right-hand side is among its remarks. Every piece of the
        forcing is integrated by itself.
    """
    began = time.perf_counter()
    d, h = scene.dimension, scene.final_time / n_steps
    grid = h * np.arange(n_steps + 1, dtype=float)
    inverse_mass = np.linalg.inv(scene.inertia.mass)
    matrix = np.zeros((2 * d, 2 * d))
    matrix[:d, d:] = np.eye(d)
    for term in scene.active_damping:
        matrix[d:, d:] -= inverse_mass @ term.coefficient
    potential = scene.potential
    if isinstance(potential, QuadraticPotential):
        matrix[d:, :d] = -inverse_mass @ potential.stiffness
        potential = None
    ends = (0.0, *scene.break_points, scene.final_time)
    pieces: tuple[ForcingPiece | None, ...] = (None,)
    if scene.forcing is not None:
        pieces = scene.forcing.pieces[: len(ends) - 1]
    ready = time.perf_counter()
    state = np.concatenate((scene.initial_position, scene.initial_velocity))
    states = [state[None]]
    evaluations = 0
    failure: Failure | None = None
    with np.errstate(over="ignore", invalid="ignore"):
        for piece, start, end in zip(pieces, ends[:-1], ends[1:], strict=True):

            def rate(at: float, y: Array, piece: ForcingPiece | None = piece) -> Array:
                value = matrix @ y
                if piece is not None:
                    value[d:] += inverse_mass @ piece.evaluate(np.asarray(at))
                if potential is not None:
                    value[d:] -= inverse_mass @ potential.gradient(y[:d])
                return value

            inside = grid[(grid > start + 1e-9 * h) & (grid <= end + 1e-9 * h)]
            inside = np.minimum(inside, end)
            # the end of the piece is the start of the next, on the grid or not
            asked = np.append(inside[inside < end], end)
            found = solve_ivp(
                rate, (start, end), state, "DOP853", asked, rtol=tolerance, atol=tolerance
            )
            evaluations += int(found.nfev)
            values = np.asarray(found.y, dtype=float).T.reshape(-1, 2 * d)
            if found.status != 0 or not np.isfinite(values).all():
                reached = np.isfinite(values).all(axis=1)
                states.append(values[: int(reached.sum())][: inside.size])
                words = f"stopped in t = {start:g} to {end:g}: {found.message}"
                failure = Failure(words, time=start)
                break
            states.append(values[: inside.size])
            state = values[-1]
    everything = np.concatenate(states)
    return baseline_trajectory(
        scene,
        everything[:, :d],
        everything[:, d:],
        n_steps,
        failure=failure,
        operations=0,
        iterations=0,
        began=began,
        ready=ready,
        remarks=(f"{evaluations} evaluations of the right-hand side",),
    )
