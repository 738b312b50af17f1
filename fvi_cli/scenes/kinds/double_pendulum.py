"""``double-pendulum``: two rods in a row with damped joints."""

from __future__ import annotations

from typing import Final

from fvi_cli.keys.containers import ListOf
from fvi_cli.keys.records import Key
from fvi_cli.keys.scalars import Number
from fvi_cli.scenes.kinds.kind import SceneKind, scene_record
from fvi_cli.scenes.kinds.shared_keys import dampers_key
from fvi_cli.scenes.lagrangian import double_pendulum

_PAIR: Final = ListOf(shape=Number(above=0.0), least=2, most=2, example="[1.0, 1.0]")


DOUBLE_PENDULUM: Final = SceneKind(
    name="double-pendulum",
    equation="two rods, angles theta1, theta2 from the vertical; the joints turn "
    "against c D^gamma of theta1 and of theta2 - theta1",
    record=scene_record(
        Key(
            "masses",
            _PAIR,
            "Point masses at the ends of the first and the second rod.",
            unit="unit of mass",
            default=[1.0, 1.0],
        ),
        Key("lengths", _PAIR, "Lengths of the rods.", unit="length", default=[1.0, 1.0]),
        Key(
            "gravity",
            Number(),
            "Acceleration of free fall.",
            unit="length per time^2",
            default=1.0,
        ),
        dampers_key(
            "joints",
            "Fractional dampers c D^gamma in both joints.",
            "mass length^2 times time^(gamma-2)",
        ),
    ),
    make=double_pendulum,
    size=2,
    coordinates=("theta1", "theta2"),
    example={
        "joints": "[{order: 0.5, coefficient: 0.2}]",
        "initial": "{position: [1.0, -0.5], velocity: 0.0}",
        "final_time": "4.0",
    },
    sweep="problem.joints.0.order: [0.5, 1.0]",
)
