"""Damping terms and relaxation laws of scenes, by the matrices along which they act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.damping import FractionalDamping, is_same_direction
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import Form, dense, form, is_sparse
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.memory.kernel import LARGEST_EXPONENT, Term
from fvi_cli.integrator.memory.reach import DamperForms
from fvi_cli.mathematics.arrays import Array

DampingForce = FractionalDamping | Law
Pattern = tuple[tuple[tuple[int, ...], bool], ...]
"""For each direction the places of its terms among a scene's active forces; whether it is relative.

Relative terms subtract the start velocity: Caputo derivatives of order above 1.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Direction:
    """Terms that act along one matrix of every member."""

    # D with the coefficient of the first term, (q, e, e); for one large structure (r, r), dense
    # or sparse
    matrix: Form
    # terms of the memory, a row for every member, or one row for all
    terms: tuple[tuple[Term, ...], ...]
    factors: Array  # coefficients relative to that of the first term, (q or 1, n)
    is_relative: bool  # whether the start velocity is subtracted


def pattern_of(scene: Scene) -> Pattern:
    """Which terms of a scene share a direction: scenes of one pattern are integrated together.

    Terms whose matrices are multiples of each other share their sums.
    """
    is_moving = bool(np.any(scene.initial_velocity != 0))
    known: list[tuple[bool, Form, list[int]]] = []
    for place, force in enumerate(scene.active_forces):
        is_relative = is_moving and isinstance(force, FractionalDamping) and force.order > 1
        _, direction = force.scale_and_direction
        for other, matrix, places in known:
            if other == is_relative and is_same_direction(matrix, direction):
                places.append(place)
                break
        else:
            known.append((is_relative, direction, [place]))
    return tuple((tuple(places), is_relative) for is_relative, _, places in known)


def directions_of(
    scenes: Sequence[Scene],
    modes: Sequence[Decoupling] | None = None,
    reach: DamperForms | None = None,
) -> tuple[Direction, ...]:
    """Directions of scenes of one pattern.

    `modes` are the coordinates in which each scene is decoupled into systems, which are members;
    `reach` has the components on which the dampers of one scene act; None: all components.
    """
    return tuple(
        _direction([[one.active_forces[k] for k in places] for one in scenes], modes, reach, above)
        for places, above in pattern_of(scenes[0])
    )


def _direction(
    forces: Sequence[Sequence[DampingForce]],
    modes: Sequence[Decoupling] | None,
    reach: DamperForms | None,
    is_relative: bool,
) -> Direction:
    """One direction of all scenes; `forces` has the terms of every scene."""
    each = 1
    matrix: Form
    if reach is not None or is_sparse(forces[0][0].form):
        matrix = _matrix(forces[0][0], reach)
    elif modes is None:
        matrix = np.array([dense(_matrix(own[0], None)) for own in forces])
    else:
        pairs = zip(modes, forces, strict=True)
        matrix = np.concatenate(
            [mode.matrices(dense(_matrix(own[0], None))) for mode, own in pairs]
        )
        each = len(matrix) // len(forces)
    scales = np.array([[_scale(force) for force in own] for own in forces])
    factors = np.repeat(scales / scales[:, :1], each, axis=0)
    terms = [tuple(map(_term, own)) for own in forces for _ in range(each)]
    return Direction(
        matrix=matrix,
        terms=tuple(terms[:1] if len(set(terms)) == 1 else terms),
        factors=factors[:1] if np.all(factors == factors[0]) else factors,
        is_relative=is_relative,
    )


def _matrix(force: DampingForce, reach: DamperForms | None) -> Form:
    matrix = force.form if reach is None else reach.inner(force)
    return form(force.size * matrix if isinstance(force, Law) else matrix)


def _scale(force: DampingForce) -> float:
    scale, _ = force.scale_and_direction
    return scale * force.size if isinstance(force, Law) else scale


def _term(force: DampingForce) -> Term:
    if isinstance(force, Law):
        return force.kernel
    return min(1.0 - force.order, LARGEST_EXPONENT)
