r"""The memory along a run: tables of its steps, stretch by stretch.

Of a damping force :math:`F = \mu I^\theta W`, :math:`\theta = 1 - \gamma`, with the power of the
mesh's own integration matrix, the derivative by the order is :math:`-\mu I^\theta \ln(I) W`: a term
of the memory as others (:class:`fvi_cli.integrator.memory.kernel.Slope`), with the same states.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.memory.interface import toeplitz_matrix
from fvi_cli.integrator.memory.kernel import Term
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.arrays import Array

EQUAL_STEPS = 8
"""Steps of the same length, on average, from which on blocks of them are taken at once."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearisedStretch:
    """Blocks of B steps, one behind the other, and what they are to the memory.

    Tables are for all u different lengths of steps, in the first axis; f terms, J states.
    """

    first: int  # number of the first step
    blocks: int
    count: int  # B
    sizes: Array  # (u,)
    which: list[int]  # of these lengths is that of each block
    local: Array  # force at the stages of a block by the velocities there, (u, f, B m, B m)
    response: Array  # and by the states at its beginning, (u, f, B m, J)
    intake: Array  # states behind it by velocities, (u, J, B m)
    decay: Array  # and by themselves, (u, J, 1)
    starts: Array  # force by a start velocity of 1 that is subtracted, (blocks, f, B m)

    @property
    def steps(self) -> slice:
        """Its steps."""
        return slice(self.first, self.first + self.blocks * self.count)


class LinearisedMemory:
    """What damping terms make of the velocities along a run of a Runge-Kutta method.

    Relative terms subtract the start velocity. A block has at most `longest` steps, with 1 of any
    lengths, and a stretch at most `together` blocks.
    """

    def __init__(
        self,
        method: Method,
        terms: Sequence[Term],
        is_relative: Sequence[bool],
        sizes: Array,
        final_time: float,
        *,
        longest: int,
        together: int,
    ) -> None:
        self.memory, stages, shortest = None, method.stages, float(sizes.min())
        if terms:
            self.memory = Exponentials(
                method,
                tuple(dict.fromkeys(terms)),
                shortest_step=shortest,
                final_time=final_time,
                steps=float((shortest / sizes).sum()),
            )
        self._stages = stages
        self._places = [] if self.memory is None else [self.memory.terms.index(o) for o in terms]
        self.n_states = 0 if self.memory is None else self.memory.n_states
        relative, column = np.array(is_relative, dtype=bool), np.ones((self.n_states, 1))
        self.stretches: list[LinearisedStretch] = []
        for first, blocks, count in _blocks(sizes, longest, together):
            lengths, places = np.unique(sizes[first : first + blocks * count], return_inverse=True)
            which = places[::count].tolist()
            local, response, intake, decay = self._tables(lengths, count)
            starts = np.zeros((blocks, len(relative), local.shape[-1]))
            if relative.any():
                # of a velocity of 1 from ever on nothing is left
                whole = (local[..., :stages, :stages].sum(3) + response[:, :, :stages].sum(3))[
                    which
                ]
                starts[:, relative] = -np.tile(whole, count)[:, relative]
                for start, index in zip(starts, which, strict=True):
                    start[relative] += (response[index] @ column)[relative, :, 0]
                    column = decay[index] * column
            self.stretches.append(
                LinearisedStretch(
                    first=first,
                    blocks=blocks,
                    count=count,
                    sizes=lengths,
                    which=which,
                    local=local,
                    response=response,
                    intake=intake,
                    decay=decay,
                    starts=starts,
                )
            )

    def _tables(self, sizes: Array, count: int) -> tuple[Array, Array, Array, Array]:
        """Local force, response, intake and decay of blocks of steps of these lengths."""
        m = self._stages * count
        if self.memory is None:
            shapes = (0, m, m), (0, m, 0), (0, m), (0, 1)
            return tuple(np.zeros((sizes.size, *one)) for one in shapes)  # type: ignore[return-value]
        if count == 1:
            local, response, intake, change = self.memory.of_steps(sizes)
        else:
            made = self.memory.kernels(float(sizes[0]), count)
            local, response = toeplitz_matrix(made.sequence)[None], made.response[None]
            intake, change = made.intake[None], made.change[None]
        weights = self.memory.weights[self._places]
        response = weights[:, None] * response[:, None]
        return local[:, self._places], response, intake, 1.0 + change[..., None]

    def along(self, velocity: Array, start: Array) -> Array:
        """Forces of all terms, ``(f, n, m, d)``, by velocities ``(n, m, d)`` at the stages."""
        n, m, d = velocity.shape
        found = np.zeros((len(self._places), n, m, d))
        states = np.zeros((self.n_states, d))
        for one in self.stretches if self._places else ():
            inputs = velocity[one.steps].reshape(one.blocks, 1, -1, d)
            path = np.empty((one.blocks, 1, *states.shape))
            taken = np.matmul(_each(one.intake, one.which), inputs[:, 0])
            for block, index, own in zip(path, one.which, taken, strict=True):
                block[:] = states
                states = one.decay[index] * states + own
            force = np.matmul(_each(one.response, one.which), path)
            force += np.matmul(_each(one.local, one.which), inputs)
            force += one.starts[..., None] * start
            found[:, one.steps] = force.swapaxes(0, 1).reshape(len(found), -1, m, d)
        return found


def _each(tables: Array, which: list[int]) -> Array:
    """The table of every block, or the one of all."""
    return tables if len(tables) == 1 else tables[which]


def are_regular(sizes: Array) -> bool:
    """Whether so many steps have equal lengths that blocks of them are worth their tables."""
    return bool(EQUAL_STEPS * (1 + np.count_nonzero(np.diff(sizes))) <= sizes.size)


def _blocks(sizes: Array, longest: int, together: int) -> Iterator[tuple[int, int, int]]:
    """First step, number of blocks and B, one behind the other.

    Of N equal steps B are taken at once, a power of 2 with 4 B^2 <= N: tables of a block are made
    step by step.
    """
    ends = [0, *(1 + np.flatnonzero(np.diff(sizes))).tolist(), sizes.size]
    if longest == 1:
        ends = [0, sizes.size]
    for begin, end in itertools.pairwise(ends):
        done, count = begin, 1
        while 2 * count <= longest and 16 * count * count <= end - begin:
            count *= 2
        while done < end:
            count = min(count, end - done)
            blocks = min((end - done) // count, together)
            yield done, blocks, count
            done += blocks * count
