"""``chain``: equal masses in a row with springs and dampers between neighbours."""

from __future__ import annotations

from typing import Final

from fvi_cli.keys.records import Key
from fvi_cli.keys.scalars import Choice, Integer, Number
from fvi_cli.scenes.chains import chain
from fvi_cli.scenes.kinds.kind import SceneKind, scene_record
from fvi_cli.scenes.kinds.shared_keys import dampers_key

CHAIN: Final = SceneKind(
    name="chain",
    equation="mass x_i'' + (stiffness + sum c D^gamma) (2 x_i - x_(i-1) - x_(i+1)) + sum mu "
    "D^gamma x_i = f_i(t)",
    record=scene_record(
        Key(
            "masses",
            Integer(least=1, most=1000),
            "Number n of masses; the coordinates are x1 ... xn (x if there is one).",
            default=10,
        ),
        Key("mass", Number(above=0.0), "Mass.", unit="unit of mass", default=1.0),
        Key(
            "stiffness",
            Number(),
            "k of the spring between neighbours.",
            unit="mass per time^2",
            default=1.0,
        ),
        Key(
            "ends",
            Choice(words=("both", "left", "none")),
            "Which ends of the chain are tied to a wall by a spring and its dampers.",
            default="both",
        ),
        dampers_key(
            "dampers",
            "Fractional dampers c D^gamma beside every spring.",
            "mass times time^(gamma-2)",
        ),
    ),
    make=chain,
    size_key="masses",
    example={
        "masses": "3",
        "dampers": "[{order: 0.5, coefficient: 0.2}]",
        "initial": "{position: [1.0, 0.0, 0.0], velocity: 0.0}",
        "final_time": "10.0",
    },
    sweep="problem.dampers.0.coefficient: [0.1, 0.2, 0.4]",
)
