"""How much memory a run will take at its peak, from the sizes of its arrays.

What is counted are the arrays that are alive together, as they were found by tracing: the weights
while they are made, the dense matrices of a block while they are put together, and, on long runs,
the trajectory with the largest transform of its history.
"""

from __future__ import annotations

from fvi_cli.integrator.batches.march import CHUNK as CHUNK_TOGETHER
from fvi_cli.integrator.batches.plan import BLOCK
from fvi_cli.integrator.batches.run import MOST_TOGETHER
from fvi_cli.integrator.blocks.history import LARGEST_NEAR
from fvi_cli.integrator.blocks.newton import BLOCKS_PER_GROUP, newton_block
from fvi_cli.integrator.blocks.sizes import BlockSizes, batch_sizes
from fvi_cli.integrator.run.march import CHUNK
from fvi_cli.integrator.steps.linear_blocks import is_recurrence
from fvi_cli.planning.batches import Machinery

SMALLEST = 8_000
"""Numbers in the tables of a method, in expressions and the like."""


def peak_bytes(sizes: Machinery) -> int:
    """Largest memory of a run in bytes, the program itself left out."""
    if sizes.route == "any mesh":
        return int(8 * (SMALLEST + _any_mesh(sizes)))
    if sizes.route == "side by side":
        return int(8 * (SMALLEST + _side_by_side(sizes)))
    if sizes.route in ("linear blocks", "newton blocks"):
        numbers = _blocks(sizes)
    else:
        numbers = _single_steps(sizes)
    return int(8 * (SMALLEST + max(numbers, _making_weights(sizes))))


def _weights(sizes: Machinery) -> float:
    """Numbers in all weights."""
    return sum(sizes.shape.memories)


def _making_weights(sizes: Machinery) -> float:
    m, longest = sizes.shape.samples, sizes.shape.memory
    if longest <= m + 6:
        return 0.0
    return _weights(sizes) + 4.0 * longest


def _known_in_advance(sizes: Machinery) -> float:
    """Numbers in the moments of known forces."""
    return (sizes.method.degree + 1) * sizes.components * sizes.n_steps if sizes.driven else 0


def _blocks(sizes: Machinery) -> float:
    """The larger one of set-up, steps and what follows them."""
    shape, n, d = sizes.shape, sizes.n_steps, sizes.components
    held = _weights(sizes) + _known_in_advance(sizes)
    path = (2 * d + sizes.keeps_force * shape.samples * d) * (n + 1)
    damped = shape.memory > 1
    buffer = float(shape.samples * d * n) if damped else 0.0
    if sizes.route == "linear blocks":
        chosen = batch_sizes(shape.samples, shape.coupled, shape.batch, n)
        if chosen is None:  # pragma: no cover - the route says so
            raise ValueError("route: these blocks are too large")
        width, blocks = chosen
        making, kept = _linear_matrices(sizes, width, blocks)
        # systems are advanced slice by slice, and only the samples of one slice are kept
        share = width / shape.batch
        chunk = min(n, 64 * blocks.block)
        driven = 4.0 * (sizes.method.degree + 1) + 3 * shape.samples
        work = chunk * width * shape.coupled * driven
        transform = share * _transform(sizes) + (1 - share) * _kept_transforms(sizes)
        buffer = share * buffer
        group = blocks.group
    else:
        making, kept = _newton_matrices(sizes)
        work, transform, group = 0.0, _transform(sizes), 0
    if n <= 2 * group or shape.memory <= group + 1:
        transform = 0.0
    after = (3.4 + 0.7 * d) * n
    if sizes.members > 1:
        # what becomes of one slice is there while that of the others is still to come
        path += d * n
    if sizes.diagnosed:
        after += _balances(sizes)
    if sizes.route == "newton blocks":
        # the matrices are made while the steps are under way
        return held + path + buffer + max(making, kept + transform, after - buffer)
    steps = held + path + buffer + kept + max(transform, work)
    return max(held + path + buffer + making, steps, held + path + after)


def _balances(sizes: Machinery) -> float:
    """Increments, rates, and the moments that are paired with them."""
    d, n, degree = sizes.scene.dimension, sizes.n_steps, sizes.method.degree
    return (6 * degree + 4 + 2 * sizes.shape.samples) * d * n


def _transform(sizes: Machinery) -> float:
    """Numbers in the longest transform, with those of weights that are kept for later ones."""
    shape, n = sizes.shape, sizes.n_steps
    if shape.memory <= 1:
        return 0.0
    systems = shape.batch * shape.coupled
    spectra = 2.1 * systems * shape.samples + 1.4 * systems + 1.9
    return spectra * n + _kept_transforms(sizes)


def _kept_transforms(sizes: Machinery) -> float:
    long = [memory for memory in sizes.shape.memories if memory > sizes.n_steps // 2]
    return float(sizes.n_steps * len(long))


def _linear_matrices(sizes: Machinery, width: int, blocks: BlockSizes) -> tuple[float, float]:
    """Numbers at work while the matrices of a block are made, and those that are kept."""
    shape, b, nodes = sizes.shape, blocks.block, sizes.keeps_force
    m, e = shape.samples, shape.coupled
    size = b * m * e
    state = 2 * e + m * e + 1
    driven = b * (sizes.method.degree + 1) * e
    columns = size + state + driven
    far = min(b, max(shape.memory - 1, 0))
    first = far * m * e + state
    used = first + driven
    outputs = 2 * b * e + nodes * size
    dense = (2 * size + outputs) * columns
    inside, sequential = first * used, first * first
    # a single system needs no second copy in another order
    copies = 0 if width == 1 else first * driven + outputs * used
    impulses = b * (3 * m * e + 2 * e + sizes.method.stages * e) * (3 * e + 2 * m * e + 3)
    reach = min(b * (blocks.blocks - 1), max(shape.memory - 1, 0))
    n_channels = len(shape.memories) if shape.memory > 1 else 0
    strip = far * reach * m * m * n_channels
    tail = (min(blocks.group, max(1, LARGEST_NEAR // (m * e))) * m) ** 2 * n_channels
    own = width * (dense + inside + sequential + outputs * used + copies + impulses)
    last = max(strip / max(n_channels, 1) + strip, strip + tail + tail / max(n_channels, 1))
    making = own + max(width * outputs * (columns - used if width > 1 else columns), last)
    kept = width * (inside + sequential + outputs * used + copies) + strip + tail
    return making, kept


def _newton_matrices(sizes: Machinery) -> tuple[float, float]:
    shape, d, r = sizes.shape, sizes.scene.dimension, sizes.method.stages
    b = newton_block(sizes.scene, shape.samples, sizes.n_steps) or 1
    size, nodes = b * shape.samples * d, sizes.keeps_force
    columns = size + 2 * d + shape.samples * d + 1 + b * (sizes.method.degree + 1) * d
    points, outputs = b * r * d, (1 + nodes) * size + 2 * b * d
    dense = (2 * size + nodes * size + points + 2 * b * d) * columns
    frozen = points * columns + points**2 + outputs * columns
    strip = 0.0
    if shape.memory > 1:
        near = min(b * BLOCKS_PER_GROUP, max(1, LARGEST_NEAR // (shape.samples * d)))
        strip = size * size * BLOCKS_PER_GROUP + (near * shape.samples) ** 2
    # every halved block has matrices of its own
    kept = strip + dense + 1.33 * frozen
    return strip + dense + frozen + 1.5 * outputs * columns, kept


def _single_steps(sizes: Machinery) -> float:
    """Every step on its own: its samples, forces and history are arrays of the whole run."""
    shape, d, n = sizes.shape, sizes.scene.dimension, sizes.n_steps
    m, s = shape.samples, sizes.method.degree
    numbers = 2.0 * _weights(sizes) + _known_in_advance(sizes) + (2 * d + 3 * m * d) * n
    if sizes.route == "stepped":
        numbers += m * d * n + _transform(sizes)
    if d > 1 or sizes.scene.lagrangian is not None:
        numbers += 3 * (s * d) ** 2
    if sizes.scene.lagrangian is not None:
        numbers += (6 * d + 8 * d * d) * n
    return numbers


def _any_mesh(sizes: Machinery) -> float:
    """No more of the past than the states, and of the run what is kept."""
    shape, d, n = sizes.shape, sizes.scene.dimension, sizes.n_steps
    m, e, q = shape.samples, shape.coupled, shape.batch
    kept = (2 + 3 * d) * (n / sizes.every + 3)
    block, states, rows = sizes.block, sizes.n_states, sizes.method.degree + 1
    channels = max(len(shape.memories), 1)
    chunk = min(CHUNK, sizes.n_mesh_steps) * d * (6 + 3 * rows + 2 * m)
    tables = states * (block * m * (2 * channels + 1) + 2 * block + 4 * m + 2 * d)
    columns = block * rows * e + 2 * e
    dense = q * block * (2 * m + 2) * e * columns
    if sizes.scene.is_linear and is_recurrence(q, e, states):
        dense += (states + 2) * e * ((states + 2) * e + block * (2 * m + 2 + rows) * e)
    elif not sizes.scene.is_linear:
        dense += 3 * (block * m * d) ** 2
    stepping = kept + chunk + dense + tables
    # diagnostics are made of all stages, when the matrices of the blocks are gone
    diagnosing = kept + (12 + (6 + 5 * m) * d) * sizes.n_mesh_steps
    return max(stepping, diagnosing) if sizes.diagnosed else stepping


def _side_by_side(sizes: Machinery) -> float:
    """Trajectories of all members, put together at the end, and what their steps take."""
    shape, d = sizes.shape, sizes.components
    points = sizes.n_steps / sizes.every + 2
    m, e, q = shape.samples, shape.coupled, min(shape.batch, MOST_TOGETHER)
    size = (sizes.method.degree + 1) * e
    tables = sizes.n_states * (3 * BLOCK * m + 5 * q * e) + 2 * BLOCK * m * m * sizes.n_states
    matrices = q * (2 * size * (size + e) + BLOCK * m * (m + 2 * e))
    loads = 3 * CHUNK_TOGETHER * size * q if sizes.driven else 0
    return max(5 * d, 4 * d + 2 * sizes.members) * points + tables + matrices + loads
