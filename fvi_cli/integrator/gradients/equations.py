r"""Linear maps of blocks of steps from their beginning and loads, in all components of a scene.

A block maps position x and momentum p at its beginning, the forces F of the past at its stages
(term by term, without their matrices) and load vectors g to x and p after it, to the velocities V
at its stages and to the positions X at the ends of its other steps,

.. math:: (x', p', V, X) = T\,(x, p, F) + G g.

For equal steps of a linear scene the maps come from the engine's operator; otherwise every step
has maps of its own, with the second derivatives at the stages of the trajectory.
"""

from typing import NamedTuple

import numpy as np

from fvi_cli.integrator.damping.damping import Damping
from fvi_cli.integrator.engine.frame import Frame, unit_tables
from fvi_cli.integrator.engine.law import StepLaw
from fvi_cli.integrator.engine.operator import Operator, step_matrix
from fvi_cli.integrator.engine.tables import on_components, on_every_component
from fvi_cli.integrator.memory.exponentials import ExponentialKernels, Exponentials
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array

Points = tuple[Array, Array, Array]
"""Positions ``(n, m, d)``, velocities and times ``(n, m)`` at the stages of n steps."""


class Maps(NamedTuple):
    """Tables of k blocks of B steps; the first axis has one table for all blocks, or one for each.

    Tables of the memory are for u different lengths of steps, f terms and J states.
    """

    by_state: Array  # T, (1 or k, (1 + B + B m) d, (2 + f B m) d)
    by_load: Array  # G, (1 or k, (1 + B + B m) d, B (s + 1) d)
    which: list[int]  # index of the step length of every block, (k,)
    local: Array  # from velocities of a block to its forces, (f, u, B m, B m)
    response: Array  # from states at its beginning to its forces, (u, f B m, J)
    intake: Array  # from velocities of a block to states after it, (u, J, B m)
    decay: Array  # factors of the states over a block, (u, J, 1)


def maps_of_equal_steps(
    law: StepLaw, method: Method, damping: Damping, h: float, count: int, blocks: int
) -> Maps:
    """Tables of blocks of equal steps of a linear scene.

    Raises
    ------
    numpy.linalg.LinAlgError
        If their equations have no unique solution.
    """
    d = damping.start_velocity.shape[-1]
    frame = Frame(unit_tables(method, count, d, False), damping, h, count)
    at = law.linearise(np.zeros((1, d)), None, 0.0)
    operator = Operator(frame, at, damping, is_linear=True)
    if operator.singular.any():
        raise np.linalg.LinAlgError
    assert frame.damping is not None
    kernels = frame.damping.kernels
    assert isinstance(kernels, ExponentialKernels)
    return Maps(
        *_arranged(damping, operator.outputs, operator.outputs_of_loads, count),
        which=[0] * blocks,
        local=np.array(frame.damping.local),
        response=_by_term(damping, kernels.response[None]),
        intake=kernels.intake[None],
        decay=1.0 + kernels.change[None, :, None],
    )


def maps_of_steps(
    law: StepLaw, method: Method, damping: Damping, sizes: Array, points: Points
) -> Maps:
    """Tables of n steps of any lengths, linearised at the points of each.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equations of one have no unique solution.
    """
    assert isinstance(damping.memory, Exponentials)
    t = step_tables(method)
    to_inputs = t.to_inputs
    lengths, which = np.unique(sizes, return_inverse=True)
    by_term, response, intake, change = damping.memory.of_steps(lengths)
    local = np.array([one.combine(by_term.swapaxes(0, 1))[0] for one in damping.combinations])
    position, velocity, time = points
    n, m, d = position.shape
    s, h = t.degree, sizes[:, None, None]
    unit = unit_tables(method, 1, d, law.has_rates)
    at_stages = np.concatenate([position, velocity], axis=2) if law.has_rates else position
    at, _ = law.expand(np.zeros((1, d)), at_stages, time)
    stiffness = at.stiffness if at.stiffness.ndim == 4 else at.stiffness[:, None]
    stiffness = np.broadcast_to(stiffness, (n, m, d, d))
    damp = h * (t.test_weights[:-1] @ local[:, which] @ to_inputs)
    matrices = [one.matrices for one in damping.combinations]
    inverse = np.linalg.inv(step_matrix(unit, at, h, list(damp), matrices))
    by_load = np.concatenate([-inverse, np.zeros((n, s * d, d))], axis=2)
    # at a stage K and C act on the position at the beginning as on the displacement from there
    mixed = [] if at.mixed is None else [at.mixed]
    moved = np.concatenate([*mixed, -stiffness], axis=2).reshape(n, -1, d)
    tests, at_points = h * unit.tests[-1], h * unit.points[0]
    if mixed:
        tests, at_points = tests + unit.tests[0], at_points + unit.points[1]
    by_force = -by_load @ on_every_component(h * t.test_weights, d)
    unknowns = np.concatenate(
        [by_load @ (tests @ moved), -inverse[..., :d], by_force, by_load], axis=2
    )
    weighted = h[..., None] * t.weights[:, None, None]
    turned = [one.swapaxes(2, 3) for one in mixed]
    pulled = weighted * np.concatenate([-stiffness, *turned], axis=3)
    gained = pulled.swapaxes(1, 2).reshape(n, d, -1) @ at_points
    for table, matrix in zip((h * t.weights) @ local[:, which] @ to_inputs, matrices, strict=True):
        gained = gained - on_components(table, matrix)
    momentum = gained @ unknowns
    momentum[..., :d] -= (weighted * stiffness).sum(axis=1)
    begin = (2 + m) * d
    momentum[..., 2 * d : begin] -= on_every_component(h * t.weights, d)
    momentum[..., begin:] += np.tile(np.eye(d), s + 1)
    inputs = np.matmul(to_inputs, unknowns.reshape(n, s, -1)).reshape(n, m * d, -1)
    rows = np.concatenate([inputs, h * unknowns[:, -d:], momentum], axis=1)
    return Maps(
        *_arranged(damping, rows[..., :begin], rows[..., begin:], 1),
        which=which.tolist(),
        local=local,
        response=_by_term(damping, response),
        intake=intake,
        decay=1.0 + change[..., None],
    )


def _arranged(damping: Damping, by_state: Array, by_load: Array, count: int) -> tuple[Array, Array]:
    """T and G from rows of velocities and of changes of position and momentum.

    Rows are (V, changes at the ends of all steps), columns position, momentum and the whole force.
    """
    d = damping.start_velocity.shape[-1]
    k, rows, _ = by_state.shape
    of_position = slice(rows - 2 * count * d, rows - count * d)
    whole = by_state.copy()
    whole[:, of_position, :d] += np.tile(np.eye(d), (count, 1))
    whole[:, -d:, d : 2 * d] += np.eye(d)
    by_force = whole[..., 2 * d :].reshape(k, -1, d)
    terms = [np.matmul(by_force, one.matrices).reshape(k, rows, -1) for one in damping.combinations]
    whole = np.concatenate([whole[..., : 2 * d], *terms], axis=2)
    order = np.arange(rows)
    inner, last = order[of_position][:-d], order[of_position][-d:]
    order = np.concatenate([last, order[-d:], order[: of_position.start], inner])
    return whole[:, order], by_load[:, order]


def _by_term(damping: Damping, response: Array) -> Array:
    """Responses ``(u, B m, J)`` with the weights of every term, ``(u, f B m, J)``."""
    weights = np.array([one.weights[0] for one in damping.combinations])
    u, samples, states = response.shape
    found = weights[:, None] * response[:, None]
    return np.asarray(found.reshape(u, len(weights) * samples, states))
