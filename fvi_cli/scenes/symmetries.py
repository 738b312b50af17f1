"""Symmetries that a scene is found to have, for its momentum maps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.effects.symmetry import Symmetry, symmetry_defect

LARGEST_DEFECT = 1e-9
MOST_COORDINATES = 32


def known_symmetries(scene: Scene, coordinates: tuple[str, ...]) -> tuple[Symmetry, ...]:
    """Those of a few usual motions of space that change nothing of the scene but its drivers.

    Tried are a turn of the plane (``angular``, two coordinates), a shift of all coordinates
    together (``linear``), and a shift of each coordinate alone (``p_<coordinate>``; up to 32
    coordinates).
    """
    return tuple(
        one
        for one in _candidates(scene.dimension, coordinates)
        if symmetry_defect(scene, one) < LARGEST_DEFECT
    )


def _candidates(d: int, coordinates: tuple[str, ...]) -> Iterator[Symmetry]:
    still = np.zeros((d, d))
    if d == 2:
        turn = np.array([[0.0, -1.0], [1.0, 0.0]])
        yield Symmetry(name="angular", generator=turn, shift=np.zeros(2))
    if d > 1:
        yield Symmetry(name="linear", generator=still, shift=np.ones(d))
    if d <= MOST_COORDINATES:
        for name, unit in zip(coordinates, np.eye(d), strict=True):
            yield Symmetry(name=f"p_{name}", generator=still, shift=unit)
