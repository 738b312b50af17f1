"""``pendulum``: a rod that turns around a fixed point."""

from __future__ import annotations

from typing import Final

from fvi_cli.keys.records import Key
from fvi_cli.keys.scalars import Number
from fvi_cli.scenes.kinds.kind import SceneKind, scene_record
from fvi_cli.scenes.named import pendulum

PENDULUM: Final = SceneKind(
    name="pendulum",
    equation="x'' + sum mu D^gamma x + omega^2 sin x = f(t)",
    record=scene_record(
        Key(
            "omega",
            Number(least=0.0),
            "Angular frequency of small oscillations.",
            unit="1/time",
            default=1.0,
        )
    ),
    make=pendulum,
    size=1,
    size_key="omega",
    example={
        "damping": "[{order: 0.5, coefficient: 0.3}]",
        "initial": "{position: 1.0, velocity: 0.0}",
        "final_time": "20.0",
    },
    sweep="problem.initial.position: [0.1, 1.0, 3.0]",
)
