"""``lagrangian``: any mechanical system, by its Lagrangian as a formula."""

from __future__ import annotations

from typing import Final

from fvi_cli.keys.containers import ListOf, Named
from fvi_cli.keys.records import Key
from fvi_cli.keys.scalars import Number, Text
from fvi_cli.scenes.kinds.kind import SceneKind, Values, scene_record
from fvi_cli.scenes.lagrangian import check_names, lagrangian_scene


def _names(values: Values) -> tuple[str, ...]:
    names = tuple(str(name) for name in values["coordinates"])
    check_names(names, values["parameters"])
    return names


LAGRANGIAN: Final = SceneKind(
    name="lagrangian",
    equation="d/dt dL/dv - dL/dq + sum mu D^gamma q = f(t)",
    record=scene_record(
        Key(
            "coordinates",
            ListOf(shape=Text(what="a name"), most=100, example="[x, y]"),
            "Names of the coordinates q; the velocity of x is vx.",
        ),
        Key(
            "parameters",
            Named(shape=Number(), example="{m: 1.0, g: 9.81}"),
            "Values of further names in the Lagrangian and in all expressions; can be swept.",
            default={},
        ),
        Key(
            "lagrangian",
            Text(what="an expression in coordinates, velocities, parameters and t"),
            "L(q, v, t), kinetic minus potential energy.",
            unit="energy",
        ),
    ),
    make=lagrangian_scene,
    size_key="coordinates",
    names=_names,
    example={
        "coordinates": "[x]",
        "parameters": "{m: 1.0, g: 9.81}",
        "lagrangian": "m*vx**2/2 - m*g*(1 - cos(x))",
        "damping": "[{order: 0.5, coefficient: 0.3, acts_on: [x]}]",
        "initial": "{position: 1.0, velocity: 0.0}",
        "final_time": "4.0",
    },
    sweep="problem.parameters.g: [1.62, 9.81]",
)
