"""How much memory a run will take at its peak, from the sizes of its arrays.

What is counted are the arrays that are alive together, as they were found by tracing: the weights
while they are made, the dense matrices of a block while they are put together, and the trajectory.
"""

from __future__ import annotations

from fvi_cli.integrator.batches.march import CHUNK as CHUNK_TOGETHER
from fvi_cli.integrator.batches.plan import BLOCK
from fvi_cli.integrator.batches.run import MOST_TOGETHER
from fvi_cli.integrator.blocks.batch import CHUNK_BLOCKS
from fvi_cli.integrator.blocks.convolved import Convolved
from fvi_cli.integrator.blocks.newton import NewtonPlan
from fvi_cli.integrator.blocks.sizes import BatchPlan
from fvi_cli.integrator.equal_steps.routes import EqualPlan
from fvi_cli.integrator.run.march import CHUNK, MeshPlan
from fvi_cli.integrator.steps.linear_blocks import is_recurrence
from fvi_cli.planning.machinery import Machinery

SMALLEST = 8_000
"""Numbers in the tables of a method, in expressions and the like."""


def peak_bytes(run: Machinery) -> int:
    """Largest memory of a run in bytes, the program itself left out."""
    plan = run.plan
    if not isinstance(plan, EqualPlan):
        numbers = _side_by_side(run, plan) if run.is_side_by_side else _any_mesh(run, plan)
    else:
        steps = _single_steps(run, plan)
        if plan.batch is not None:
            steps = _linear_blocks(run, plan.batch)
        elif plan.newton is not None:
            steps = _newton_blocks(run, plan.newton)
        numbers = max(steps, _making_weights(run))
    return int(8 * (SMALLEST + numbers))


def _weights(run: Machinery) -> float:
    """Numbers in all weights."""
    return sum(run.memories)


def _making_weights(run: Machinery) -> float:
    if run.memory <= run.samples + 6:
        return 0.0
    return _weights(run) + 4.0 * run.memory


def _known_in_advance(run: Machinery) -> float:
    """Numbers in the moments of known forces."""
    if run.scene.forcing is None:
        return 0
    return (run.method.degree + 1) * run.components * run.n_steps


def _path(run: Machinery) -> float:
    """Numbers in positions, momenta and, where it is kept, the force of every step."""
    d = run.components
    return (2 * d + run.keeps_force * run.samples * d) * (run.n_steps + 1)


def _linear_blocks(run: Machinery, plan: BatchPlan) -> float:
    """The larger one of set-up, steps and what follows them."""
    n, d = run.n_steps, run.components
    held = _weights(run) + _known_in_advance(run)
    making, kept = _linear_matrices(run, plan)
    # systems are advanced slice by slice
    chunk = min(n, CHUNK_BLOCKS * plan.block)
    driven = 2.0 * (run.method.degree + 1 + run.samples)
    work = chunk * plan.width * run.coupled * driven
    # members are finished one after the other
    after = _after(run) + d * n * (run.members > 1)
    return held + _path(run) + max(making, kept + work, after)


def _newton_blocks(run: Machinery, plan: NewtonPlan) -> float:
    """The same; the matrices are made while the steps are under way."""
    held = _weights(run) + _known_in_advance(run) + _path(run)
    return held + max(_newton_matrices(run, plan), _after(run))


def _after(run: Machinery) -> float:
    """Energy and grid, and with diagnostics increments, rates, and what is paired with them."""
    d, n, degree = run.components, run.n_steps, run.method.degree
    numbers = (3.4 + 0.7 * d) * n
    if run.diagnosed:
        numbers += (6 * degree + 4 + 2 * run.samples) * run.scene.dimension * n
    return numbers


def _linear_matrices(run: Machinery, plan: BatchPlan) -> tuple[float, float]:
    """Numbers at work while the matrices of a block are made, and those that are kept."""
    width, nodes = plan.width, run.keeps_force
    b, m, e, far = plan.block, run.samples, run.coupled, plan.far
    size = b * m * e
    state = 2 * e + m * e + 1
    driven = b * (run.method.degree + 1) * e
    columns = size + state + driven
    first = far * m * e + state
    used = first + driven
    outputs = 2 * b * e + nodes * size
    dense = (size + outputs) * columns
    inside, sequential = first * used, first * first
    # a single system needs no second copy in another order
    copies = 0 if width == 1 else first * driven + outputs * used
    # the response to moments and state, from which that to all inputs is made
    response = (2 * size + b * run.method.stages * e + outputs) * (driven + 2 * e)
    own = width * (dense + max(response, inside + sequential + outputs * used + copies))
    past = _past(plan.convolved, b, width) if plan.is_damped else 0
    making = own + max(width * outputs * (columns - used if width > 1 else columns), past)
    kept = width * (inside + sequential + outputs * used + copies) + past
    return making, kept


def _past(convolved: Convolved, block: int, width: int) -> float:
    """Numbers in what is remembered, and in the matrices from it to a block and back."""
    remembered, rates = convolved.reach + convolved.n_rates, convolved.n_rates
    matrices = (len(convolved.memories) * remembered + rates) * block
    # lags and exponentials while they are made
    making = (convolved.reach + block) * (rates + 2) + 2 * convolved.reach * block
    return matrices + making + 2 * remembered * convolved.size * width


def _newton_matrices(run: Machinery, plan: NewtonPlan) -> float:
    d, r, m = run.scene.dimension, run.method.stages, run.samples
    b = plan.block
    size = b * m * d
    columns = 2 * d + b * (run.method.degree + 1) * d
    points, outputs = b * r * d, size + 2 * b * d
    dense = (2 * size + points + 2 * b * d) * columns
    frozen = points * columns + points**2 + outputs * columns
    past = _past(plan.convolved, b, 1) if plan.is_damped else 0
    # every halved block has matrices of its own
    return past + dense + 1.33 * frozen


def _single_steps(run: Machinery, plan: EqualPlan) -> float:
    """Every step on its own: its samples, forces and history are arrays of the whole run."""
    d, n, m, s = run.scene.dimension, run.n_steps, run.samples, run.method.degree
    numbers = 2.0 * _weights(run) + _known_in_advance(run) + (2 * d + 3 * m * d) * n
    if plan.route == "stepped":
        numbers += _past(plan.convolved, 1, 1)
    if d > 1 or run.scene.lagrangian is not None:
        numbers += 3 * (s * d) ** 2
    if run.scene.lagrangian is not None:
        numbers += (6 * d + 8 * d * d) * n
    return numbers


def _any_mesh(run: Machinery, plan: MeshPlan) -> float:
    """No more of the past than the states, and of the run what is kept."""
    d, m, e, q = run.scene.dimension, run.samples, plan.coupled, plan.systems
    kept = (2 + 3 * d) * (run.n_steps / run.every + 3)
    block, states, rows = plan.block, plan.n_states, run.method.degree + 1
    channels = max(len(run.memories), 1)
    chunk = min(CHUNK, plan.n_steps) * d * (6 + 3 * rows + 2 * m)
    tables = states * (block * m * (2 * channels + 1) + 2 * block + 4 * m + 2 * d)
    columns = block * rows * e + 2 * e
    dense = q * block * (2 * m + 2) * e * columns
    if run.scene.is_linear and is_recurrence(q, e, states, plan.n_steps // max(block, 1)):
        dense += (states + 2) * e * ((states + 2) * e + block * (2 * m + 2 + rows) * e)
    elif not run.scene.is_linear:
        dense += 3 * (block * m * d) ** 2
    stepping = kept + chunk + dense + tables
    # diagnostics are made of all stages, when the matrices of the blocks are gone
    diagnosing = kept + (12 + (6 + 5 * m) * d) * plan.n_steps
    return max(stepping, diagnosing) if run.diagnosed else stepping


def _side_by_side(run: Machinery, plan: MeshPlan) -> float:
    """Trajectories of all members, put together at the end, and what their steps take."""
    d, states = run.components, plan.n_states
    points = run.n_steps / run.every + 2
    m, e, q = run.samples, run.coupled, min(run.systems, MOST_TOGETHER)
    size = (run.method.degree + 1) * e
    tables = states * (3 * BLOCK * m + 5 * q * e) + 2 * BLOCK * m * m * states
    matrices = q * (2 * size * (size + e) + BLOCK * m * (m + 2 * e))
    loads = 0 if run.scene.forcing is None else 3 * CHUNK_TOGETHER * size * q
    return max(5 * d, 4 * d + 2 * run.members) * points + tables + matrices + loads
