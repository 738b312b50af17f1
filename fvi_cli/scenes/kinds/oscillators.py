"""``damped-oscillator`` and ``bagley-torvik``: linear equations, which differ by a usual order."""

from __future__ import annotations

from typing import Final, Unpack

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.keys.containers import ByForm
from fvi_cli.keys.records import Key
from fvi_cli.keys.scalars import Matrix, Number
from fvi_cli.scenes.data import SceneData
from fvi_cli.scenes.kinds.kind import SceneKind, scene_record
from fvi_cli.scenes.kinds.shared_keys import NUMBER_OR_SYMMETRIC, matrix_of
from fvi_cli.scenes.named import linear_oscillator

_EQUATION: Final = "M x'' + sum mu D^gamma x + K x = f(t)"
_KEYS: Final = (
    Key(
        "mass",
        ByForm(single=Number(above=0.0), several=Matrix(positive=True)),
        "M: a number or a symmetric positive definite matrix.",
        unit="unit of mass",
        default=1.0,
    ),
    Key(
        "stiffness",
        NUMBER_OR_SYMMETRIC,
        "K: a number or a symmetric matrix.",
        unit="mass per time^2",
        default=1.0,
    ),
)


def _make(mass: object, stiffness: object, **data: Unpack[SceneData]) -> Scene:
    size = np.size(data["initial_position"])
    return linear_oscillator(
        mass=matrix_of(mass, size), stiffness=matrix_of(stiffness, size), **data
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
