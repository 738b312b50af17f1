"""``duffing``: a spring that hardens or softens, or a double well."""

from __future__ import annotations

from typing import Final

from fvi_cli.keys.records import Key
from fvi_cli.keys.scalars import Number
from fvi_cli.scenes.kinds.kind import SceneKind, scene_record
from fvi_cli.scenes.nonlinear import duffing

DUFFING: Final = SceneKind(
    name="duffing",
    equation="mass x'' + sum mu D^gamma x + stiffness x + cubic_stiffness x^3 = f(t)",
    record=scene_record(
        Key("mass", Number(above=0.0), "Mass.", unit="unit of mass", default=1.0),
        Key(
            "stiffness",
            Number(),
            "k of the linear force k x; negative for a double well.",
            unit="mass per time^2",
            default=1.0,
        ),
        Key(
            "cubic_stiffness",
            Number(),
            "Factor of x^3 in the force.",
            unit="mass per time^2 and length^2",
            default=1.0,
        ),
    ),
    make=duffing,
    size=1,
    example={
        "damping": "[{order: 0.5, coefficient: 0.2}]",
        "initial": "{position: 1.0, velocity: 0.0}",
        "final_time": "10.0",
    },
    sweep="problem.cubic_stiffness: [0.1, 1.0, 10.0]",
)
