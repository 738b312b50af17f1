"""``damped-oscillator`` and ``bagley-torvik``: linear equations, which differ by a usual order."""

from __future__ import annotations

from typing import Final, Unpack

import numpy as np

from fvi_cli.effects.matrices import is_sparse
from fvi_cli.effects.scene import Scene
from fvi_cli.keys.records import Key
from fvi_cli.scenes.data import SceneData
from fvi_cli.scenes.kinds.damping_keys import NUMBER_OR_SYMMETRIC
from fvi_cli.scenes.kinds.kind import SceneKind, scene_record
from fvi_cli.scenes.kinds.shared_keys import MASS_MATRIX
from fvi_cli.scenes.named import linear_oscillator
from fvi_cli.scenes.structures.matrix_keys import file_form, matrix_of

_EQUATION: Final = "M x'' + sum mu D^gamma x + K x = f(t)"
_KEYS: Final = (
    Key(
        "mass",
        MASS_MATRIX,
        "M: a number, a symmetric positive definite matrix or {file: M.mtx}.",
        unit="unit of mass",
        default=1.0,
    ),
    Key(
        "stiffness",
        NUMBER_OR_SYMMETRIC,
        "K: a number, a symmetric matrix or {file: K.mtx}.",
        unit="mass per time^2",
        default=1.0,
    ),
)


def _make(mass: object, stiffness: object, **data: Unpack[SceneData]) -> Scene:
    size = np.size(data["initial_position"])
    sparse = any(is_sparse(file_form(one)) for one in (mass, stiffness))
    return linear_oscillator(
        mass=matrix_of(mass, size, sparse=sparse),
        stiffness=matrix_of(stiffness, size, sparse=sparse),
        **data,
    )


DAMPED_OSCILLATOR: Final = SceneKind(
    name="damped-oscillator",
    equation=_EQUATION,
    record=scene_record(*_KEYS),
    make=_make,
    example={
        "damping": "[{order: 1.0, coefficient: 0.2}]",
        "initial": "{position: 0.0, velocity: 1.0}",
        "final_time": "16.0",
    },
    sweep="problem.damping.0.order: {from: 0.1, to: 1.9, number: 10}, problem.stiffness: [1, 10]",
)

BAGLEY_TORVIK: Final = SceneKind(
    name="bagley-torvik",
    title="Bagley–Torvik",
    equation=_EQUATION,
    record=scene_record(*_KEYS, default_order=1.5),
    make=_make,
    example={
        "damping": "[{order: 1.5, coefficient: 1.0}]",
        "forcing": "15/4*sqrt(t) + 15/8*sqrt(pi)*t + t**2.5",
        "initial": "{position: 0.0, velocity: 0.0}",
        "final_time": "1.0",
        "exact": "t**2.5",
    },
    sweep="problem.stiffness: {from: 1, to: 100, number: 5, spacing: log}",
)
