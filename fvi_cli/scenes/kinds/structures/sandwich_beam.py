"""``sandwich-beam``: a clamped beam of two elastic faces with a viscoelastic core."""

from __future__ import annotations

from typing import Any, Final, Unpack

from fvi_cli.effects.laws.cole_cole import fractional_zener
from fvi_cli.effects.scene import Scene
from fvi_cli.keys.records import Key, Record
from fvi_cli.keys.scalars import Integer, Number
from fvi_cli.scenes.data import SceneData
from fvi_cli.scenes.kinds.kind import SceneKind, Values, scene_record
from fvi_cli.scenes.structures.sandwich_beam import (
    SandwichBeam,
    beam_coordinates,
    beam_matrices,
    beam_scene,
)

MOST_ELEMENTS: Final = 5000


def _length(name: str, meaning: str, default: float) -> Key:
    return Key(name, Number(above=0.0), meaning, unit="length", default=default)


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
    own = {name: given.pop(name) for name in SandwichBeam.__dataclass_fields__}
    return _scene(SandwichBeam(**own), elements, core, **given)


def _scene(
    beam: SandwichBeam, elements: int, core: dict[str, Any], **data: Unpack[SceneData]
) -> Scene:
    mass, faces, shear = beam_matrices(beam, elements)
    try:
        law = fractional_zener(**core, coefficient=shear)
    except ValueError as error:
        raise ValueError(f"core.{error}") from None
    return beam_scene(mass, faces, law, **data)


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
        _length("length", "Of the beam.", 0.1778),
        _length("width", "Of the beam.", 0.0127),
        _length("face_thickness", "Of each face.", 1.524e-3),
        _length("core_thickness", "Of the core.", 1.27e-4),
        Key(
            "face_modulus",
            Number(above=0.0),
            "Young's modulus of the faces.",
            unit="force per length^2",
            default=6.9e10,
        ),
        Key(
            "face_density",
            Number(above=0.0),
            "Of the faces.",
            unit="mass per length^3",
            default=2766.0,
        ),
        Key(
            "core_density",
            Number(above=0.0),
            "Of the core.",
            unit="mass per length^3",
            default=968.0,
        ),
        Key(
            "core",
            _CORE,
            "Fractional Zener law of the core in shear.",
            default={"order": 0.675, "time": 8.23e-9, "relaxed": 3.504e5, "unrelaxed": 3.062e9},
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
