"""``sandwich-beam``: a clamped beam of two elastic faces with a viscoelastic core."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Final

from fvi_cli.effects.laws.cole_cole import fractional_zener
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.scalars import Integer
from fvi_cli.keys.settings import Fraction, NotNegative, Positive, Setting, as_plain, key, keys_of
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.structures.sandwich_beam import beam_coordinates, beam_matrices, beam_scene

MOST_ELEMENTS: Final = 5000
_PRESSURE: Final = "force per length^2"


class Core(Setting):
    """Fractional Zener law of the core in shear."""

    order: Fraction = key("a of the law (no unit).", default=0.675)
    time: Positive = key("Relaxation time tau.", unit="time", default=8.23e-9)
    relaxed: NotNegative = key("Shear modulus of slow motions.", unit=_PRESSURE, default=3.504e5)
    unrelaxed: Positive = key(
        "Shear modulus of fast motions, at least the relaxed one.", unit=_PRESSURE, default=3.062e9
    )


def _make(elements: int, core: Core, **given: Any) -> Scene:
    own = {name: given.pop(name) for name in _SIZES}
    mass, faces, shear = beam_matrices(elements, **own)
    try:
        law = fractional_zener(**vars(core), coefficient=shear)
    except ArgumentError as error:
        raise error.below("core") from None
    return beam_scene(mass, faces, law, **given)


class SandwichBeam(SceneKind):
    """A clamped beam."""

    kind = "sandwich-beam"
    equation = (
        "M x'' + G(D) K_v x + sum mu D^gamma x + K x = f(t), G(s) = relaxed + (unrelaxed - "
        "relaxed) (s time)^order / (1 + (s time)^order)"
    )
    make = staticmethod(_make)
    example: ClassVar = {
        "elements": "6",
        "initial": "{velocity: {at: {w6: 1.0}}}",
        "final_time": "0.02",
        "exact": "none",
    }
    methods = "{rk: gauss, degree: 2, start: graded}"
    sweep = "problem.core_thickness: [1.0e-4, 2.0e-4, 4.0e-4]"

    elements: Annotated[int, Integer(least=1, most=MOST_ELEMENTS)] = key(
        "Number n of finite elements from the clamped end on; node i has deflection wi, slope "
        "ri and the displacements ai, bi of the faces along the beam: 4 n coordinates.",
        default=20,
    )
    length: Positive = key("Of the beam.", unit="length", default=0.1778)
    width: Positive = key("Of the beam.", unit="length", default=0.0127)
    face_thickness: Positive = key("Of each face.", unit="length", default=1.524e-3)
    core_thickness: Positive = key("Of the core.", unit="length", default=1.27e-4)
    face_modulus: Positive = key("Young's modulus of the faces.", unit=_PRESSURE, default=6.9e10)
    face_density: Positive = key("Of the faces.", unit="mass per length^3", default=2766.0)
    core_density: Positive = key("Of the core.", unit="mass per length^3", default=968.0)
    core: Core = key("Fractional Zener law of the core in shear.", default=as_plain(Core.of({})))

    def own_names(self) -> tuple[str, ...]:
        """Four for every node."""
        return beam_coordinates(int(self.elements))


_SIZES: Final = tuple(one.name for one in keys_of(SandwichBeam)[1:8])
"""What the matrices are made of."""
