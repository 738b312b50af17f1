"""``frame``: a building of storeys that shear, shaken by the ground."""

from __future__ import annotations

from typing import Final

from fvi_cli.keys.containers import ByForm, ListOf
from fvi_cli.keys.records import Key
from fvi_cli.keys.scalars import Integer, Number
from fvi_cli.scenes.chains import frame
from fvi_cli.scenes.forces import GROUND_ACCELERATION
from fvi_cli.scenes.kinds.kind import SceneKind, scene_record
from fvi_cli.scenes.kinds.shared_keys import dampers_key

_PER_STOREY: Final = ByForm(
    single=Number(above=0.0), several=ListOf(shape=Number(above=0.0), example="[2.0, 1.0]")
)


FRAME: Final = SceneKind(
    name="frame",
    equation="mass_i x_i'' + s_i - s_(i+1) + sum mu D^gamma x_i = -mass_i a(t), s_i = (stiffness_i "
    "+ sum c D^gamma) (x_i - x_(i-1))",
    record=scene_record(
        Key(
            "storeys",
            Integer(least=1, most=1000),
            "Number n of storeys; x1 ... xn are their displacements against the ground.",
            default=3,
        ),
        Key(
            "mass",
            _PER_STOREY,
            "Mass of every storey, or a list from the ground up.",
            unit="unit of mass",
            default=1.0,
        ),
        Key(
            "stiffness",
            _PER_STOREY,
            "Shear stiffness of every storey, or a list.",
            unit="mass per time^2",
            default=1.0,
        ),
        dampers_key(
            "dampers",
            "Fractional dampers c D^gamma between storeys.",
            "mass times time^(gamma-2)",
        ),
        force=GROUND_ACCELERATION,
    ),
    make=frame,
    size_key="storeys",
    example={
        "stiffness": "10.0",
        "dampers": "[{order: 0.5, coefficient: 0.5}]",
        "ground_acceleration": "t**3*exp(-t)*sin(3*t)",
        "final_time": "8.0",
    },
    sweep="problem.dampers.0.order: {from: 0.1, to: 1.9, number: 10}",
)
