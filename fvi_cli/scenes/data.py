"""What every scene takes beside its own numbers: interval, drivers and initial data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Required, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import Factored, Form, SparseMatrix, scaled, symmetric_form
from fvi_cli.effects.potential import Potential
from fvi_cli.effects.scene import Derivative, Scene
from fvi_cli.mathematics.arrays import Array


class SceneData(TypedDict, total=False):
    r"""Keyword arguments of all scenes.

    Parameters
    ----------
    final_time
        T: the motion is sought on [0, T].
    damping
        Terms :math:`\mu D^\gamma q` of the equation of motion; default: none.
    laws
        Relaxation laws; default: none.
    forcing
        f(t); default: none.
    initial_position, initial_velocity
        q(0) and q'(0), shape ``(d,)``; a number stands for every coordinate, default 0.
    derivative
        ``caputo`` (default) or ``riemann-liouville``.
    """

    final_time: Required[float]
    damping: Sequence[FractionalDamping]
    laws: Sequence[Law]
    forcing: Forcing | None
    initial_position: ArrayLike
    initial_velocity: ArrayLike
    derivative: Derivative


def make_scene(
    mass: ArrayLike | SparseMatrix,
    potential: Potential | None = None,
    *,
    lagrangian: Lagrangian | None = None,
    **data: Unpack[SceneData],
) -> Scene:
    """The scene of a mass matrix, shape ``(d, d)`` or a number, and its other effects."""
    inertia = Inertia(mass=mass)
    return Scene(
        inertia=inertia,
        potential=potential,
        lagrangian=lagrangian,
        damping=tuple(data.get("damping", ())),
        laws=tuple(data.get("laws", ())),
        forcing=data.get("forcing"),
        initial_position=per_coordinate(data.get("initial_position", 0.0), inertia.dimension),
        initial_velocity=per_coordinate(data.get("initial_velocity", 0.0), inertia.dimension),
        final_time=data["final_time"],
        derivative=data.get("derivative", "caputo"),
    )


def per_coordinate(value: ArrayLike, size: int) -> Array:
    """A number as a vector of so many equal ones; a vector as it is."""
    vector = np.asarray(value, dtype=float)
    return np.full(size, float(vector)) if vector.ndim == 0 else vector


Damper = tuple[float, float] | tuple[float, float, str]
"""Order, coefficient and name of a damper that stands beside every spring, or in every joint."""


def with_dampers(
    data: SceneData, matrix: Form, dampers: Sequence[Damper], rows: Array | None = None
) -> SceneData:
    r"""The data with terms :math:`c A D^\gamma q` before the others, A the `matrix`.

    With `rows` B, :math:`A = B^T B`, their deformations are :math:`B q`.
    """
    others = *data.get("damping", ()), *data.get("laws", ())
    before = max((one.number for one in others), default=0)
    terms = []
    for index, (order, coefficient, *name) in enumerate(dampers, start=before + 1):
        c = float(coefficient)
        kept = None if rows is None else Factored(rows=rows, inner=c * np.eye(len(rows)))
        terms.append(
            FractionalDamping(
                order=float(order),
                form=symmetric_form(scaled(matrix, c), "coefficient"),
                factored=kept,
                name="".join(map(str, name)),
                number=index,
            )
        )
    return {**data, "damping": (*terms, *data.get("damping", ()))}
