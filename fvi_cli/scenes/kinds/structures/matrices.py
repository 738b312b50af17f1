"""``structure``: mass, stiffness and damping matrices as finite-element programs write them."""

from __future__ import annotations

from typing import Final

from fvi_cli.keys.containers import ByForm, ListOf
from fvi_cli.keys.records import Key, Record, optional
from fvi_cli.keys.scalars import Number
from fvi_cli.scenes.forces import GROUND_ACCELERATION
from fvi_cli.scenes.kinds.damping_keys import NUMBER_OR_SYMMETRIC, ORDER
from fvi_cli.scenes.kinds.kind import SceneKind, scene_record
from fvi_cli.scenes.kinds.shared_keys import MASS_MATRIX, MOST_COORDINATES
from fvi_cli.scenes.structures.structure import structure

_PROPORTIONAL: Final = Record(
    keys=(
        Key("mass", Number(least=0.0), "a.", unit="time^(gamma-2)", default=0.0),
        Key("stiffness", Number(least=0.0), "b.", unit="time^gamma", default=0.0),
        Key(ORDER.name, ORDER.shape, ORDER.meaning, default=1.0),
    )
)

STRUCTURE: Final = SceneKind(
    name="structure",
    equation="M x'' + sum mu D^gamma x + K x = f(t) - M r a(t)",
    record=scene_record(
        Key("mass", MASS_MATRIX, "M: a matrix, {file: M.mtx} or a number.", unit="unit of mass"),
        Key(
            "stiffness",
            NUMBER_OR_SYMMETRIC,
            "K: a matrix, {file: K.mtx} or a number.",
            unit="mass per time^2",
        ),
        optional(
            "proportional", _PROPORTIONAL, "Damping (a M + b K) D^gamma x, of Rayleigh for order 1."
        ),
        Key(
            "modal_damping",
            ListOf(shape=Number(least=0.0), least=0, example="[0.02, 0.05]"),
            "Damping ratios of the first modes of M and K, viscous damping; no unit.",
            default=[],
        ),
        Key(
            GROUND_ACCELERATION.name,
            GROUND_ACCELERATION.shape,
            GROUND_ACCELERATION.meaning,
            unit=GROUND_ACCELERATION.unit,
            default="0",
        ),
        Key(
            "ground_direction",
            ByForm(
                single=Number(),
                several=ListOf(shape=Number(), most=MOST_COORDINATES, example="[1, 0]"),
            ),
            "r: how far every coordinate goes with a ground that moves by 1.",
            default=1.0,
        ),
    ),
    make=structure,
    example={
        "mass": "[[2.0, 0.0], [0.0, 1.0]]",
        "stiffness": "[[300.0, -100.0], [-100.0, 100.0]]",
        "damping": "[{order: 0.5, coefficient: 4.0, acts_on: [x2 - x1]}]",
        "proportional": "{mass: 0.1, stiffness: 0.001, order: 1.0}",
        "ground_acceleration": "t**3*exp(-t)*sin(3*t)",
        "final_time": "4.0",
    },
    sweep="problem.damping.0.coefficient: [0.5, 1.0, 2.0]",
)
