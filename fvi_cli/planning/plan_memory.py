"""How much memory a run will take at its peak, from the sizes of its arrays.

What is counted are the arrays that are alive together, as they were found by tracing: the weights
while they are made, the dense matrices of a block while they are put together, and, on long runs,
the trajectory with the largest transform of its history.
"""

from __future__ import annotations

from fvi_cli.integrator.batches.march import CHUNK as CHUNK_TOGETHER
from fvi_cli.integrator.batches.plan import BLOCK
from fvi_cli.integrator.batches.run import MOST_TOGETHER
from fvi_cli.integrator.blocks.batch import CHUNK_BLOCKS
from fvi_cli.integrator.blocks.groups import LARGEST_NEAR
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
    n, d, sizes = run.n_steps, run.components, plan.sizes
    held = _weights(run) + _known_in_advance(run)
    making, kept = _linear_matrices(run, plan)
    # systems are advanced slice by slice, and only the samples of one slice are kept
    share = plan.width / run.systems
    chunk = min(n, CHUNK_BLOCKS * sizes.block)
    driven = 4.0 * (run.method.degree + 1) + 3 * run.samples
    work = chunk * plan.width * run.coupled * driven
    transform = share * _transform(run) + (1 - share) * _kept_transforms(run)
    if n <= 2 * sizes.group or run.memory <= sizes.group + 1:
        transform = 0.0
    buffer = share * run.samples * d * n if plan.is_damped else 0.0
    path = _path(run)
    if run.members > 1:
        # what becomes of one slice is there while that of the others is still to come
        path += d * n
    steps = held + path + buffer + kept + max(transform, work)
    return max(held + path + buffer + making, steps, held + path + _after(run))


def _newton_blocks(run: Machinery, plan: NewtonPlan) -> float:
    """The same; the matrices are made while the steps are under way."""
    held = _weights(run) + _known_in_advance(run) + _path(run)
    making, kept = _newton_matrices(run, plan)
    buffer = float(run.samples * run.components * run.n_steps) if plan.is_damped else 0.0
    transform = 0.0 if run.memory <= 1 else _transform(run)
    return held + buffer + max(making, kept + transform, _after(run) - buffer)


def _after(run: Machinery) -> float:
    """Energy and grid, and with diagnostics increments, rates, and what is paired with them."""
    d, n, degree = run.components, run.n_steps, run.method.degree
    numbers = (3.4 + 0.7 * d) * n
    if run.diagnosed:
        numbers += (6 * degree + 4 + 2 * run.samples) * run.scene.dimension * n
    return numbers


def _transform(run: Machinery) -> float:
    """Numbers in the longest transform, with those of weights that are kept for later ones."""
    if run.memory <= 1:
        return 0.0
    systems = run.systems * run.coupled
    spectra = 2.1 * systems * run.samples + 1.4 * systems + 1.9
    return spectra * run.n_steps + _kept_transforms(run)


def _kept_transforms(run: Machinery) -> float:
    long = [memory for memory in run.memories if memory > run.n_steps // 2]
    return float(run.n_steps * len(long))


def _linear_matrices(run: Machinery, plan: BatchPlan) -> tuple[float, float]:
    """Numbers at work while the matrices of a block are made, and those that are kept."""
    width, sizes, nodes = plan.width, plan.sizes, run.keeps_force
    b, m, e, far = sizes.block, run.samples, run.coupled, plan.far
    size = b * m * e
    state = 2 * e + m * e + 1
    driven = b * (run.method.degree + 1) * e
    columns = size + state + driven
    first = far * m * e + state
    used = first + driven
    outputs = 2 * b * e + nodes * size
    dense = (2 * size + outputs) * columns
    inside, sequential = first * used, first * first
    # a single system needs no second copy in another order
    copies = 0 if width == 1 else first * driven + outputs * used
    impulses = b * (3 * m * e + 2 * e + run.method.stages * e) * (3 * e + 2 * m * e + 3)
    n_channels = len(run.memories) if plan.is_damped else 0
    strip = far * plan.reach(sizes.blocks - 1) * m * m * n_channels
    tail = (min(sizes.group, max(1, LARGEST_NEAR // (m * e))) * m) ** 2 * n_channels
    own = width * (dense + inside + sequential + outputs * used + copies + impulses)
    last = max(strip / max(n_channels, 1) + strip, strip + tail + tail / max(n_channels, 1))
    making = own + max(width * outputs * (columns - used if width > 1 else columns), last)
    kept = width * (inside + sequential + outputs * used + copies) + strip + tail
    return making, kept


def _newton_matrices(run: Machinery, plan: NewtonPlan) -> tuple[float, float]:
    d, r, m = run.scene.dimension, run.method.stages, run.samples
    b, nodes = plan.block, run.keeps_force
    size = b * m * d
    columns = size + 2 * d + m * d + 1 + b * (run.method.degree + 1) * d
    points, outputs = b * r * d, (1 + nodes) * size + 2 * b * d
    dense = (2 * size + nodes * size + points + 2 * b * d) * columns
    frozen = points * columns + points**2 + outputs * columns
    strip = 0.0
    if plan.is_damped:
        near = min(plan.group, max(1, LARGEST_NEAR // (m * d)))
        strip = size * m * d * plan.group + (near * m) ** 2
    # every halved block has matrices of its own
    kept = strip + dense + 1.33 * frozen
    return strip + dense + frozen + 1.5 * outputs * columns, kept


def _single_steps(run: Machinery, plan: EqualPlan) -> float:
    """Every step on its own: its samples, forces and history are arrays of the whole run."""
    d, n, m, s = run.scene.dimension, run.n_steps, run.samples, run.method.degree
    numbers = 2.0 * _weights(run) + _known_in_advance(run) + (2 * d + 3 * m * d) * n
    if plan.route == "stepped":
        numbers += m * d * n + _transform(run)
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
