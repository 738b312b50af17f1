"""How many multiply-adds the memory will take: the counts of every route, without running it.

A count is that of weights times samples, as the routes keep it in ``operations``; tests hold the
two together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.blocks.history import LARGEST_NEAR, even_fast_length
from fvi_cli.integrator.blocks.newton import BLOCKS_PER_GROUP
from fvi_cli.integrator.blocks.sizes import BlockSizes
from fvi_cli.integrator.blocks.stepped_history import STEPPED_GROUP
from fvi_cli.integrator.convolution.directions import terms_by_direction
from fvi_cli.integrator.equal_steps.weights import memory_length
from fvi_cli.integrator.method import Baseline, Method


@dataclass(frozen=True, kw_only=True)
class Shape:
    """Sizes of what is convolved.

    Parameters
    ----------
    memories
        Number M of weights of every direction of the damping.
    samples
        Number m of samples of a step.
    coupled, batch
        Components e of a system, and number q of systems.
    """

    memories: tuple[int, ...]
    samples: int
    coupled: int
    batch: int = 1

    @property
    def memory(self) -> int:
        """The largest number of weights; 0 without damping."""
        return max(self.memories, default=0)


def memories_of(
    method: Method, n_weights: int, damping: tuple[FractionalDamping, ...]
) -> tuple[int, ...]:
    """How many weights each direction has of `n_weights` for all of `damping`."""
    return tuple(
        max(memory_length(method, order, n_weights) for _, order in terms)
        for _, terms in terms_by_direction(damping)
    )


def direct_operations(shape: Shape, n_steps: int) -> int:
    """Every sum written out, step after step, and the force at the end."""
    return sum(_direct_sum(shape, memory, n_steps + 1) for memory in shape.memories)


def _direct_sum(shape: Shape, memory: int, count: int) -> int:
    """Sums over the past of `count` steps from the first one on."""
    return shape.samples * shape.coupled * pairs(count, memory)


def pairs(count: int, memory: int) -> int:
    """How many earlier steps, at most M - 1 for each, the first `count` steps look back to."""
    rising = min(count, memory)
    return rising * (rising - 1) // 2 + (count - rising) * (memory - 1)


def stepped_operations(shape: Shape, n_steps: int) -> int:
    """One step after the other, finished groups convolved into the future by FFT."""
    if not shape.memories:
        return 0
    groups, rest = divmod(n_steps + 1, STEPPED_GROUP)
    inside = 0
    for memory in shape.memories:
        memory = min(memory, STEPPED_GROUP)
        inside += groups * _direct_sum(shape, memory, STEPPED_GROUP)
        inside += _direct_sum(shape, memory, rest)
    return inside + spread_operations(shape, STEPPED_GROUP, n_steps + 1, n_steps // STEPPED_GROUP)


def spread_operations(shape: Shape, group: int, n_steps: int, finished: int) -> int:
    """What `finished` groups of `n_steps` steps take to be convolved into later ones."""
    q, e, m = shape.batch, shape.coupled, shape.samples
    n_groups = -(-n_steps // group)
    long = [memory for memory in shape.memories if memory - 1 > group]
    short = [memory for memory in shape.memories if 1 < memory <= group + 1]
    near = min(group, max(1, LARGEST_NEAR // (m * e))) if long else 1
    spreading = min(finished, n_groups - 1)
    total = 0
    if n_groups > 1 and (short or near > 1):
        reach = max(max(short, default=1) - 1, near - 1)
        total += spreading * (len(short) + len(long)) * q * e * (reach * m) ** 2
    if long:
        # b finished groups spread as many groups as the largest power of two that divides b
        power = 1
        while power <= spreading:
            count = (spreading // power + 1) // 2
            last = (2 * count - 1) * power
            wanted = min(power, n_groups - last) * group
            length = power * group
            period = 2 * length if wanted == length else even_fast_length(length + wanted)
            total += transform_operations(shape, len(long), period)
            if count > 1:
                total += (count - 1) * transform_operations(shape, len(long), 2 * length)
            power *= 2
    return total


def transform_operations(shape: Shape, n_channels: int, period: int) -> int:
    """5/4 n log2(n) multiply-adds for a real transform, 4 for a complex product."""
    q, e, m = shape.batch, shape.coupled, shape.samples
    transforms = 2 * q * m * e * int(1.25 * period * math.log2(period))
    return transforms + 4 * n_channels * q * m * e * e * (period // 2 + 1)


def block_operations(shape: Shape, sizes: BlockSizes, n_steps: int, ends: int) -> int:
    """Linear systems in blocks.

    Parameters
    ----------
    shape, sizes, n_steps
        What is convolved, in which blocks, over how many steps.
    ends
        1 where the force at the end of the last step is wanted, else 0.
    """
    if shape.memory <= 1:
        return 0
    q, e, m = shape.batch, shape.coupled, shape.samples
    block, group = sizes.block, sizes.group
    count = -(-n_steps // block)
    if ends and n_steps % block == 0 and n_steps % group != 0:
        count += 1
    own = sum(pairs(block, memory) + block for memory in shape.memories)
    total = q * e * count * m * m * own
    far = min(block, shape.memory - 1)
    reach = min(block * (sizes.blocks - 1), shape.memory - 1)
    in_group = [min(reach, place * block) for place in range(sizes.blocks)]
    whole, rest = divmod(count, sizes.blocks)
    reached = whole * sum(in_group) + sum(in_group[:rest])
    total += len(shape.memories) * q * e * reached * m * m * far
    if ends and n_steps % group == 0:
        total += q * e * sum(min(memory, n_steps + 1) - 1 for memory in shape.memories)
    return total + spread_operations(shape, group, n_steps, whole)


def newton_operations(shape: Shape, largest: int, n_steps: int, ends: int) -> int:
    """Nonlinear scenes in blocks of at most `largest` steps, however they are cut.

    `ends` as for `block_operations`. Attempts of Newton's iteration that failed are not counted
    as work of the memory.
    """
    memory = shape.memory
    if memory <= 1:
        return 0
    group, size = largest * BLOCKS_PER_GROUP, shape.samples * shape.coupled
    groups, rest = divmod(n_steps, group)
    # every step looks back to earlier ones of its group, and to itself
    connected = groups * pairs(group, memory) + pairs(rest, memory) + n_steps
    if ends and rest:
        connected += min(rest, memory - 1)
    return connected * size**2 + spread_operations(shape, group, n_steps + ends, groups)


def baseline_operations(
    method: Baseline, damping: tuple[FractionalDamping, ...], dimension: int, n_steps: int
) -> int | None:
    """Sums of a baseline over its past; None where that is not ours to count."""
    total = 0
    for term in damping:
        if method.name == "explicit-euler":
            terms = 0 if term.is_integer_order else n_steps * (n_steps - 1) // 2
        elif method.name == "implicit-euler":
            terms = 0 if term.is_integer_order else n_steps * (n_steps + 1) // 2
        elif method.name == "gruenwald-letnikov":
            terms = 2 * n_steps - 1 if term.is_integer_order else n_steps * (n_steps + 1) // 2
        elif method.name == "product-integration":
            terms = n_steps if term.is_integer_order else n_steps * (n_steps - 1) // 2
        else:
            # SciPy's integrator has no memory; that of peers is not ours to count
            return 0 if method.name == "dop853" else None
        total += terms * dimension
    return total
