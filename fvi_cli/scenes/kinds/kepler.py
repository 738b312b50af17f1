"""``kepler``: a mass in the plane around a centre that attracts it."""

from __future__ import annotations

from typing import Final

from fvi_cli.keys.records import Key
from fvi_cli.keys.scalars import Number
from fvi_cli.scenes.kinds.kind import SceneKind, scene_record
from fvi_cli.scenes.nonlinear import kepler

KEPLER: Final = SceneKind(
    name="kepler",
    equation="q'' + sum mu D^gamma q + attraction q/|q|^3 = f(t), q = (x, y)",
    record=scene_record(
        Key(
            "attraction",
            Number(),
            "k of the force k q/|q|^3 on a unit mass.",
            unit="length^3 per time^2",
            default=1.0,
        )
    ),
    make=kepler,
    size=2,
    coordinates=("x", "y"),
    example={
        "damping": "[{order: 0.5, coefficient: 0.01}]",
        "initial": "{position: [1.0, 0.0], velocity: [0.0, 1.0]}",
        "final_time": "10.0",
    },
    sweep="problem.damping.0.coefficient: [0.0, 0.01, 0.1]",
)
