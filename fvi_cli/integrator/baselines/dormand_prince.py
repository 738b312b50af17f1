"""The baseline of Dormand and Prince: SciPy's DOP853, for scenes without memory."""

from __future__ import annotations

import itertools
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

    For damping of order 1 only; `tolerance` is relative and absolute. Every piece of the forcing is
    integrated by itself. The number of evaluations of the right-hand side is among the remarks.
    """
    began = time.perf_counter()
    d, h = scene.dimension, scene.final_time / n_steps
    grid = h * np.arange(n_steps + 1, dtype=float)
    inverse_mass = np.linalg.inv(scene.inertia.mass)
    matrix = np.zeros((2 * d, 2 * d))
    matrix[:d, d:] = np.eye(d)
    for term in scene.active_damping:
        matrix[d:, d:] -= inverse_mass @ term.matrix
    potential = scene.potential
    if isinstance(potential, QuadraticPotential):
        matrix[d:, :d] = -inverse_mass @ potential.stiffness
        potential = None
    ends = (0.0, *scene.break_points, scene.final_time)
    ready = time.perf_counter()
    state = np.concatenate((scene.initial_position, scene.initial_velocity))
    states, evaluations, failure = [state[None]], 0, None
    with np.errstate(over="ignore", invalid="ignore"):
        for index, (start, end) in enumerate(itertools.pairwise(ends)):
            piece = None if scene.forcing is None else scene.forcing.pieces[index]

            def rate(at: float, y: Array, piece: ForcingPiece | None = piece) -> Array:
                value = matrix @ y
                if piece is not None:
                    value[d:] += inverse_mass @ piece.evaluate(np.asarray(at))
                if potential is not None:
                    value[d:] -= inverse_mass @ potential.gradient(y[:d])
                return value

            inside = grid[(grid > start + 1e-9 * h) & (grid <= end + 1e-9 * h)]
            # the end of the piece is the start of the next, on the grid or not
            at_times = np.append(inside[inside < end], end)
            found = solve_ivp(
                rate, (start, end), state, "DOP853", at_times, rtol=tolerance, atol=tolerance
            )
            evaluations += int(found.nfev)
            values = np.asarray(found.y, dtype=float).T.reshape(-1, 2 * d)
            sound = np.isfinite(values).all(axis=1)
            if found.status != 0 or not sound.all():
                states.append(values[: int(sound.sum())][: inside.size])
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
        began=began,
        ready=ready,
        remarks=(f"{evaluations} evaluations of the right-hand side",),
    )
