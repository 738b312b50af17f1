"""Buildings as their keys describe them: storeys by lists, dampers of any law in some of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Unpack

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.directions import Directions
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.scenes.chains import frame, neighbour_rows
from fvi_cli.scenes.data import SceneData
from fvi_cli.scenes.kinds.damping_keys import AtStorey, Coefficient, Term, effects_of
from fvi_cli.scenes.structures.rayleigh import Rayleigh

USUAL_STOREYS: Final = 3


def frame_of_keys(
    *,
    storeys: int | None,
    mass: ArrayLike,
    masses: ArrayLike | None,
    stiffness: ArrayLike,
    stiffnesses: ArrayLike | None,
    dampers: Sequence[Term],
    rayleigh: Rayleigh | None,
    ground_acceleration: Forcing | None = None,
    **data: Unpack[SceneData],
) -> Scene:
    """The scene of a building; terms of its `dampers` stand before those of its damping."""
    count = int(np.size(data["initial_position"]))

    def between_floors(term: Term, factor: object) -> Coefficient:
        value = np.asarray(factor, dtype=float)
        if value.ndim:
            raise ArgumentError("coefficient", "a damper between two floors has a number here")
        storey = term.storey if isinstance(term, AtStorey) else None
        if storey is None:
            return Directions(rows=neighbour_rows(count, "left")).factored(value)
        if storey > count:
            raise ArgumentError("storey", f"{storey} is not allowed; there are {count} storeys")
        row = np.zeros((1, count))
        row[0, storey - 1] = 1.0
        if storey > 1:
            row[0, storey - 2] = -1.0
        return Directions(rows=row).factored(value)

    others = *data.get("damping", ()), *data.get("laws", ())
    before = max((one.number for one in others), default=0)
    damping, laws = effects_of(dampers, between_floors, "dampers", before=before)
    data["damping"] = (*damping, *data.get("damping", ()))
    data["laws"] = (*laws, *data.get("laws", ()))
    return frame(
        storeys=count,
        mass=mass if masses is None else masses,
        stiffness=stiffness if stiffnesses is None else stiffnesses,
        rayleigh=None if rayleigh is None else (rayleigh.ratios, rayleigh.modes),
        ground_acceleration=ground_acceleration,
        **data,
    )
