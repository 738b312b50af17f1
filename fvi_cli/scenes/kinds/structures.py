"""Structures given by matrices of finite-element programs, and a clamped sandwich beam."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Final

from fvi_cli.effects.laws.cole_cole import fractional_zener
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.containers import ByForm, ListOf
from fvi_cli.keys.scalars import Integer, Number
from fvi_cli.keys.settings import Fraction, NotNegative, Positive, Setting, as_plain, key
from fvi_cli.scenes.forces import GROUND_ACCELERATION, GroundMotion
from fvi_cli.scenes.kinds.damping_keys import NUMBER_OR_SYMMETRIC
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.kinds.shared_keys import MASS_MATRIX, MOST_COORDINATES
from fvi_cli.scenes.structures.rayleigh import Rayleigh
from fvi_cli.scenes.structures.sandwich_beam import beam_coordinates, beam_matrices, beam_scene
from fvi_cli.scenes.structures.structure import Proportional, structure

_DIRECTION: Final = ByForm(
    single=Number(), several=ListOf(shape=Number(), most=MOST_COORDINATES, example="[1, 0]")
)
_RATIOS: Final = ListOf(shape=Number(least=0.0), least=0, example="[0.02, 0.05]")


class Structure(SceneKind):
    """A structure by its matrices."""

    kind = "structure"
    equation = "M x'' + sum mu D^gamma x + K x = f(t) - M r a(t)"
    make = staticmethod(structure)
    forces = ("forcing", "ground_acceleration")
    example: ClassVar = {
        "mass": "[[2.0, 0.0], [0.0, 1.0]]",
        "stiffness": "[[300.0, -100.0], [-100.0, 100.0]]",
        "damping": "[{order: 0.5, coefficient: 4.0, acts_on: [x2 - x1]}]",
        "proportional": "{mass: 0.1, stiffness: 0.001, order: 0.5}",
        "rayleigh": "{ratios: [0.02, 0.02], modes: [1, 2]}",
        "ground_acceleration": "t**3*exp(-t)*sin(3*t)",
        "final_time": "4.0",
    }
    sweep = "problem.damping.0.coefficient: [0.5, 1.0, 2.0]"

    mass: Annotated[Any, MASS_MATRIX] = key(
        "M: a matrix, {file: M.mtx} or a number.", unit="unit of mass"
    )
    stiffness: Annotated[Any, NUMBER_OR_SYMMETRIC] = key(
        "K: a matrix, {file: K.mtx} or a number.", unit="mass per time^2"
    )
    proportional: Proportional | None = key(
        "Damping (a M + b K) D^gamma x, of Rayleigh for order 1.", default=None
    )
    rayleigh: Rayleigh | None = key(
        "Damping (a M + b K) x' by the ratios of two modes of M and K.", default=None
    )
    modal_damping: Annotated[tuple[NotNegative, ...], _RATIOS] = key(
        "Damping ratios of the first modes of M and K, viscous damping; no unit.", default=[]
    )
    ground_acceleration: GroundMotion = GROUND_ACCELERATION
    ground_direction: Annotated[float | tuple[float, ...], _DIRECTION] = key(
        "r: how far every coordinate goes with a ground that moves by 1.", default=1.0
    )


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


class SandwichBeam(SceneKind):
    """A clamped beam."""

    kind = "sandwich-beam"
    equation = (
        "M x'' + G(D) K_v x + sum mu D^gamma x + K x = f(t), G(s) = relaxed + (unrelaxed - "
        "relaxed) (s time)^order / (1 + (s time)^order)"
    )
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
        """Names of the coordinates, four for every node."""
        return beam_coordinates(int(self.elements))

    def make_scene(self, **data: Any) -> Scene:
        """The scene of the matrices and the law."""
        sizes = self.own_values()
        core = sizes.pop("core")
        mass, faces, shear = beam_matrices(**sizes)
        try:
            law = fractional_zener(**vars(core), coefficient=shear)
        except ArgumentError as error:
            raise error.below("core") from None
        return beam_scene(mass, faces, law, **data)
