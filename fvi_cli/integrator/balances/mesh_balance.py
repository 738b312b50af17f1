r"""Balances of a run on any mesh, with the scheme's own quadrature.

The force of the damping at the stages is found anew from the velocities there, with the energy
that it stores. With the states :math:`s_j` of the damping and weights :math:`e_j` of the kernel

.. math:: E^\text{stored} = \tfrac12 \sum_j e_j\, s_j \cdot D s_j,

and :math:`H + E^\text{stored}` of a scene with quadratic potential, without forcing, with positive
damping falls in every single step of every mesh: the work against the damping is the increase of
what is stored and a sum of squares. (Caputo derivatives of order above 1 take the start velocity
from the velocity; then this holds where it is zero.)
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import times
from fvi_cli.integrator.balances.diagnostics import Asked, BalanceData, diagnose
from fvi_cli.integrator.convolution.damping import Damping, DampingTables
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.results.diagnostics import Diagnostics
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.steps.step import StepSolver
from fvi_cli.mathematics.arrays import Array

PIECE = 128
"""Equal steps that are worked out together."""


def damping_along(damping: Damping, drivings: Array, sizes: Array) -> tuple[Array, Array | None]:
    """Damping force and stored energy along a run.

    Parameters
    ----------
    damping
        What acts.
    drivings
        What drove it in every step, shape ``(n, inputs, d)``.
    sizes
        Of the steps, shape ``(n,)``.

    Returns
    -------
    tuple
        Force, shape ``(n, m, d)``, and energy on the mesh, ``(n + 1,)``; None where the damping
        has none.
    """
    n_kept = damping.n_remembered
    n, _, d = drivings.shape
    force = np.empty((n, damping.n_points, d))
    stored = np.zeros(n + 1)
    states = damping.initial_states()
    weights = damping.energy_weights()
    for first, last in _pieces(sizes):
        at = damping.tables(float(sizes[first]))
        driving = damping.input_of(drivings[first:last])
        own = np.zeros((last - first, force.shape[1], n_kept))
        for local, one in zip(at.local, damping.directions, strict=True):
            own += times(np.einsum("ij,njc->nic", local, driving[..., :n_kept]), one.inner)
        if weights is None:
            states = _lagging(damping, at, states, driving, own)
        elif damping.has_memory:
            added = np.einsum("jr,nrc->njc", at.intake, driving)
            path = np.empty((last - first + 1, *states.shape))
            path[0] = states
            for index in range(last - first):
                path[index + 1] = path[index] * at.decay[:, None] + added[index]
            states = path[-1]
            for response, one, weight in zip(at.response, damping.directions, weights, strict=True):
                carried = np.einsum("rj,njc->nrc", response, path[:-1])
                own += damping.force_of_states(one, carried)
                free = path[1:, :, :n_kept]
                if one.is_relative:
                    # states that began with the start velocity, or carry it in their column
                    start = damping.remembered(damping.start_velocity)
                    moved = path[1:, :, n_kept:] * start if damping.has_column else 0.0
                    free = free + moved - start
                stored[first + 1 : last + 1] += 0.5 * np.einsum(
                    "j,njc,njc->n", weight, free, times(free, one.inner)
                )
        force[first:last] = damping.spread(own) + at.constant_force
    return force, None if weights is None else stored


def _lagging(
    damping: Damping, at: DampingTables, states: Array, driving: Array, force: Array
) -> Array:
    """Add the force of the past in some steps where lags have matrices; the states after them."""
    count, inputs, columns = driving.shape
    if at.step is None:
        return states
    block = at.step.over(count)
    for one in damping.directions:
        carried = damping.combined(one, block.response) @ states
        carried = carried.reshape(count, -1, columns)
        for lag, kernel in enumerate(damping.combined(one, block.lags), start=1):
            carried[lag:] += kernel @ driving[: count - lag]
        force += damping.force_of_states(one, carried)
    return block.after(states, driving.reshape(count * inputs, columns))


def _pieces(sizes: Array) -> list[tuple[int, int]]:
    """Ranges of equal step sizes, none longer than :data:`PIECE`."""
    if sizes.size == 0:
        return []
    ends = [0, *(np.flatnonzero(np.diff(sizes)) + 1).tolist(), sizes.size]
    return [
        (first, min(first + PIECE, end))
        for begin, end in itertools.pairwise(ends)
        for first in range(begin, end, PIECE)
    ]


def diagnose_run(
    steps: RunSteps,
    solver: StepSolver,
    loads: StepLoads,
    fresh: NDArray[np.bool_],
    asked: Asked,
    *,
    has_kicks: bool = False,
) -> Diagnostics:
    """The diagnostics that are asked for, on the points of the mesh.

    Parameters
    ----------
    steps
        The run.
    solver, loads
        What acted.
    fresh
        Steps that begin where a force may be singular, shape ``(n,)``.
    asked
        What is wanted.
    has_kicks
        Whether the damping acts by kicks at the points, half of each in the steps beside it.
    """
    forces, stored, damping, sampling = None, None, solver.damping, solver.sampling
    if damping is not None:
        driving = steps.velocity
        if not sampling.at_stages:
            driving = sampling.driving @ steps.unknowns
        force, stored = damping_along(damping, driving, steps.step_size)
        forces = np.einsum("vi,nid->nvd", sampling.to_loads, force)
        forces *= steps.step_size[:, None, None]
    added = loads_along(loads.of_damping, steps, fresh)
    if added is not None:
        forces = -added if forces is None else forces - added
    kicks = None
    if has_kicks and forces is not None:
        kicks = 2.0 * np.concatenate([forces[:, 0], forces[-1:, -1]])
    return diagnose(
        BalanceData(
            steps=steps,
            dynamics=solver.dynamics,
            energy=solver.dynamics.energy(steps.position, steps.momentum, steps.time),
            damping=forces,
            forcing=loads_along(loads.of_forcing, steps, fresh),
            stored=stored,
            kicks=kicks,
        ),
        asked,
    )


def loads_along(
    of_steps: Callable[..., Array | None], steps: RunSteps, fresh: NDArray[np.bool_]
) -> Array | None:
    """Load vectors of all steps of a run, shape ``(n, s + 1, d)``; None without forces.

    Parameters
    ----------
    of_steps
        As :meth:`fvi_cli.integrator.loads.step_loads.StepLoads.of_steps`.
    steps
        The run.
    fresh
        Steps that begin where a force may be singular, shape ``(n,)``.
    """
    found = []
    for first, last in _pieces(steps.step_size):
        begin = first
        # a piece may hold several singular points: each begins a part of its own
        for end in [*(first + 1 + np.flatnonzero(fresh[first + 1 : last])).tolist(), last]:
            own = of_steps(
                float(steps.time[begin]),
                float(steps.step_size[begin]),
                end - begin,
                is_fresh=bool(fresh[begin]),
            )
            if own is not None:
                found.append(own)
            begin = end
    return np.concatenate(found) if found else None
