"""Scenes side by side: their numbers in arrays, the number of the system last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.laws.law import RelaxationKernel
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.batches.potentials import SidePotentials
from fvi_cli.integrator.convolution.damping import Direction, directions_of
from fvi_cli.integrator.convolution.kernel import Term
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.mathematics.arrays import Array

Remembered = tuple[Term, tuple[RelaxationKernel, ...]]
"""An exponent, or the kernel of a law, and all kernels of its scene, which shape the rates."""

Terms = tuple[tuple[Remembered, NDArray[np.intp], Array], ...]
"""For each of them the systems that have it and their factors."""

WIDTH = 8
"""The number of systems is filled up to a multiple of it: then what vector instructions and matrix
products do to a system does not depend on how many others there are."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Slot:
    r"""One direction of the damping of every system.

    Parameters
    ----------
    direction
        D, shape ``(e, e, q)``; None: it is one, and its number is in the factors (e = 1).
    terms
        For each exponent :math:`1 - \gamma` and kernel the systems that have it, and factors.
    rate
        Coefficients of the terms of order 1, shape ``(q,)``.
    relative
        Those of the terms that subtract the start velocity.
    start
        :math:`v_0 D`, shape ``(e, q)``.
    """

    direction: Array | None
    terms: Terms
    rate: Array
    relative: Terms
    start: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Systems:
    """q independent systems of e coupled components each.

    Parameters
    ----------
    mass, stiffness
        M and K, shape ``(e, e, q)``; no stiffness beside a potential.
    potential
        The potentials of nonlinear systems; None for linear ones.
    position, momentum, velocity
        At the start, shape ``(e, q)``.
    slots
        Directions of the damping.
    """

    mass: Array
    stiffness: Array
    potential: SidePotentials | None
    position: Array
    momentum: Array
    velocity: Array
    slots: tuple[Slot, ...]

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers e and q."""
        return int(self.mass.shape[0]), int(self.mass.shape[2])

    @property
    def has_memory(self) -> bool:
        """Whether any damping remembers the past."""
        return any(slot.terms for slot in self.slots)


_Found = dict[Remembered, dict[int, float]]
"""Factors by what is remembered, and system."""


def filled(members: int, width: int) -> NDArray[np.intp]:
    """Which member stands at each place, the last one again where a place is left over.

    Parameters
    ----------
    members, width
        Number of members, and of the systems that each of them is.
    """
    total = members
    while (total * width) % WIDTH:
        total += 1
    return np.minimum(np.arange(total), members - 1)


def filled_up(places: NDArray[np.intp]) -> NDArray[np.intp]:
    """The same places, some of them again, in a number that is a multiple of the width."""
    return np.resize(places, -(-places.size // WIDTH) * WIDTH)


def joined(scenes: Sequence[Scene], decouplings: Sequence[Decoupling]) -> Systems:
    """The systems of all scenes, one scene after the other."""
    width = decouplings[0].batch
    pairs = list(zip(scenes, decouplings, strict=True))
    potential = None
    if isinstance(scenes[0].potential, ExpressionPotential):
        potential = SidePotentials.of([_formula(scene) for scene in scenes])
    return Systems(
        mass=_last([own.matrices(scene.inertia.mass) for scene, own in pairs]),
        stiffness=_last([own.matrices(_stiffness(scene)) for scene, own in pairs]),
        potential=potential,
        position=_last([own.positions(scene.initial_position) for scene, own in pairs]),
        velocity=_last([own.positions(scene.initial_velocity) for scene, own in pairs]),
        momentum=_last(
            [own.forces(scene.initial_velocity @ scene.inertia.mass) for scene, own in pairs]
        ),
        slots=_slots(pairs, width),
    )


def _formula(scene: Scene) -> ExpressionPotential:
    if not isinstance(scene.potential, ExpressionPotential):
        raise ValueError("potential: linear and nonlinear scenes do not go together")
    return scene.potential


def _stiffness(scene: Scene) -> Array:
    if isinstance(scene.potential, QuadraticPotential):
        return scene.potential.stiffness
    return np.zeros((scene.dimension, scene.dimension))


def _last(parts: Sequence[Array]) -> Array:
    """From ``(q, ...)`` of every scene to ``(..., q)`` of all."""
    return np.ascontiguousarray(np.moveaxis(np.concatenate(parts), 0, -1))


def _slots(pairs: Sequence[tuple[Scene, Decoupling]], width: int) -> tuple[Slot, ...]:
    every = [directions_of(scene) for scene, _ in pairs]
    e, q = pairs[0][0].dimension // width, len(pairs) * width
    if e == 1:
        return (_number(pairs, every, width),) if any(every) else ()
    slots = []
    for index in range(max(map(len, every), default=0)):
        direction, start, rate = np.zeros((e, e, q)), np.zeros((e, q)), np.zeros(q)
        found: _Found = {}
        relative: _Found = {}
        for place, ((scene, _), own) in enumerate(zip(pairs, every, strict=True)):
            if index < len(own):
                one = own[index]
                matrix = dense(one.matrix)
                direction[..., place] = matrix
                rate[place] = one.rate
                _note(found, one, place, 1.0, kernels_of(scene))
                if one.is_relative:
                    start[:, place] = scene.initial_velocity @ matrix
                    _note(relative, one, place, 1.0, kernels_of(scene))
        slots.append(
            Slot(
                direction=direction,
                terms=_terms(found),
                rate=rate,
                relative=_terms(relative),
                start=start,
            )
        )
    return tuple(slots)


def _number(
    pairs: Sequence[tuple[Scene, Decoupling]], every: Sequence[list[Direction]], width: int
) -> Slot:
    """All terms of systems of one component in one slot."""
    q = len(pairs) * width
    rate, velocity = np.zeros(q), np.zeros(q)
    found: _Found = {}
    relative: _Found = {}
    for index, ((scene, own), directions) in enumerate(zip(pairs, every, strict=True)):
        part = slice(index * width, (index + 1) * width)
        for one in directions:
            numbers = own.matrices(dense(one.matrix))[:, 0, 0]
            rate[part] += one.rate * numbers
            for place, number in zip(range(part.start, part.stop), numbers, strict=True):
                _note(found, one, place, float(number), kernels_of(scene))
                if one.is_relative:
                    _note(relative, one, place, float(number), kernels_of(scene))
        velocity[part] = own.positions(scene.initial_velocity)[:, 0]
    return Slot(
        direction=None,
        terms=_terms(found),
        rate=rate,
        relative=_terms(relative),
        start=velocity[None],
    )


def kernels_of(scene: Scene) -> tuple[RelaxationKernel, ...]:
    """The kernels of the laws of a scene, each once."""
    return tuple(dict.fromkeys(law.kernel for law in scene.active_laws))


def _note(
    found: _Found,
    one: Direction,
    place: int,
    number: float,
    kernels: tuple[RelaxationKernel, ...],
) -> None:
    for term, factor in zip(one.terms, one.factors, strict=True):
        own = found.setdefault((term, kernels), {})
        own[place] = own.get(place, 0.0) + factor * number


def _terms(found: _Found) -> Terms:
    return tuple(
        (one, np.fromiter(own, dtype=np.intp), np.array(list(own.values())))
        for one, own in sorted(found.items(), key=_order)
    )


def _order(item: tuple[Remembered, dict[int, float]]) -> tuple[bool, float, str]:
    """Exponents by size, then laws: the same for a system, whatever others are beside it."""
    (term, _), _ = item
    return (False, term, "") if isinstance(term, float) else (True, 0.0, repr(term))
