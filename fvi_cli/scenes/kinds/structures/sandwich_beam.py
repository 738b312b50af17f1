"""``sandwich-beam``: a clamped beam of two elastic faces with a viscoelastic core."""

from __future__ import annotations

from typing import Any, Final

from fvi_cli.effects.laws.cole_cole import fractional_zener
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.records import Key, Record
from fvi_cli.keys.scalars import Integer, Number
from fvi_cli.scenes.kinds.kind import SceneKind, Values, scene_record
from fvi_cli.scenes.structures.sandwich_beam import (
    beam_coordinates,
    beam_matrices,
    beam_scene,
)

MOST_ELEMENTS: Final = 5000


_POSITIVE: Final = Number(above=0.0)
_SIZES: Final = (
    Key("length", _POSITIVE, "Of the beam.", unit="length", default=0.1778),
    Key("width", _POSITIVE, "Of the beam.", unit="length", default=0.0127),
    Key("face_thickness", _POSITIVE, "Of each face.", unit="length", default=1.524e-3),
    Key("core_thickness", _POSITIVE, "Of the core.", unit="length", default=1.27e-4),
    Key(
        "face_modulus",
        _POSITIVE,
        "Young's modulus of the faces.",
        unit="force per length^2",
        default=6.9e10,
    ),
    Key("face_density", _POSITIVE, "Of the faces.", unit="mass per length^3", default=2766.0),
    Key("core_density", _POSITIVE, "Of the core.", unit="mass per length^3", default=968.0),
)
"""What the matrices are made of."""
_CORE: Final = Record(
    keys=(
        Key("order", Number(above=0.0, below=1.0), "a of the law (no unit).", default=0.675),
        Key("time", Number(above=0.0), "Relaxation time tau.", unit="time", default=8.23e-9),
        Key(
            "relaxed",
            Number(least=0.0),
            "Shear modulus of slow motions.",
            unit="force per length^2",
            default=3.504e5,
        ),
        Key(
            "unrelaxed",
            Number(above=0.0),
            "Shear modulus of fast motions, at least the relaxed one.",
            unit="force per length^2",
            default=3.062e9,
        ),
    )
)


def _make(elements: int, core: dict[str, Any], **given: Any) -> Scene:
    own = {key.name: given.pop(key.name) for key in _SIZES}
    mass, faces, shear = beam_matrices(elements, **own)
    try:
        law = fractional_zener(**core, coefficient=shear)
    except ArgumentError as error:
        raise error.below("core") from None
    return beam_scene(mass, faces, law, **given)


def _names(values: Values) -> tuple[str, ...]:
    return beam_coordinates(int(values["elements"]))


SANDWICH_BEAM: Final = SceneKind(
    name="sandwich-beam",
    equation="M x'' + G(D) K_v x + sum mu D^gamma x + K x = f(t), G(s) = relaxed + (unrelaxed - "
    "relaxed) (s time)^order / (1 + (s time)^order)",
    record=scene_record(
        Key(
            "elements",
            Integer(least=1, most=MOST_ELEMENTS),
            "Number n of finite elements from the clamped end on; node i has deflection wi, slope "
            "ri and the displacements ai, bi of the faces along the beam: 4 n coordinates.",
            default=20,
        ),
        *_SIZES,
        Key(
            "core",
            _CORE,
            "Fractional Zener law of the core in shear.",
            default=_CORE.filled({}),
        ),
    ),
    make=_make,
    names=_names,
    example={
        "elements": "6",
        "initial": "{velocity: {at: {w6: 1.0}}}",
        "final_time": "0.02",
        "exact": "none",
    },
    methods="{rk: gauss, degree: 2, start: graded}",
    sweep="problem.core_thickness: [1.0e-4, 2.0e-4, 4.0e-4]",
)
