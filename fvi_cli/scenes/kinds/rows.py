"""Structures: by matrices, chains of masses, buildings, strings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import Field

from fvi_cli.mathematics.algebra.builder import Builder
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.forces import GROUND_ACCELERATION, TimeFunction
from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.scenes.keys.values import BY_FORM, Count, Fraction, Keys, Positive, key
from fvi_cli.scenes.kinds.kind import SceneKind
from fvi_cli.scenes.kinds.laws import Term
from fvi_cli.scenes.kinds.oscillators import DampedOscillator
from fvi_cli.scenes.records.matrices import Numbers
from fvi_cli.scenes.structures import (
    Ends,
    Rayleigh,
    chain,
    frame,
    string,
)

USUAL_STOREYS: Final = 3
BASE_SHEAR: Final = "base_shear"
RAYLEIGH: Final = key(
    "Damping (a M + b K) D^gamma x, by its factors or by the ratios of two modes of M and K.", None
)


class Structure(DampedOscillator):
    """A structure by its matrices."""

    equation = "M x'' + sum mu D^gamma x + K x = f(t) - M r a(t)"
    forces = ("forcing", "ground_acceleration")
    kind: Literal["structure"] = key("Which equation.", "structure")  # type: ignore[assignment]
    rayleigh: Rayleigh | None = RAYLEIGH
    ground_acceleration: TimeFunction = GROUND_ACCELERATION
    ground_direction: Annotated[float | list[float] | Numbers, BY_FORM] = key(
        "r: how far every coordinate goes with a ground that moves by 1; a list that is shorter is "
        "a pattern, which is repeated.",
        1.0,
    )


class Chain(SceneKind):
    """Equal masses in a row with springs and dampers between neighbours."""

    equation = (
        "mass x_i'' + (stiffness + sum c D^gamma) (2 x_i - x_(i-1) - x_(i+1)) + sum mu "
        "D^gamma x_i = f_i(t)"
    )
    make = staticmethod(chain)
    dampers_key = "dampers"
    kind: Literal["chain"] = key("Which equation.", "chain")
    masses: Count = key(
        "Number n of masses; the coordinates are x1 ... xn (x if there is one).", 10
    )
    mass: Positive = key("Mass.", 1.0, unit="unit of mass")
    stiffness: float = key("k of the spring between neighbours.", 1.0, unit="mass per time^2")
    ends: Ends = key(
        "Which ends of the chain are tied to a wall by a spring and its dampers.", "both"
    )
    dampers: list[Term] = key("Dampers, c D^gamma or any law, parallel to every spring.", [])

    def count(self) -> int:
        """Number of masses."""
        return self.masses


_Storeys = Annotated[list[Positive], Field(min_length=1, max_length=1000)]
PerStorey = Annotated[Positive | _Storeys | Numbers, BY_FORM]
_MASS: Final = (
    "Mass of every storey: a number, a list from the ground up, or {file: building.csv, column: "
    "mass}; default: 1."
)
_MASSES: Final = ("masses", "mass")
_STIFFNESSES: Final = ("stiffnesses", "stiffness")
_SHEAR: Final = "Shear stiffness of every storey, likewise; default: 1."


class FrameKind(SceneKind):
    """A building of storeys that shear, shaken by the ground."""

    equation = (
        "mass_i x_i'' + s_i - s_(i+1) + sum mu D^gamma x_i = f_i(t) - mass_i a(t), s_i = "
        "(stiffness_i + sum c D^gamma) (x_i - x_(i-1))"
    )
    make = staticmethod(frame)
    forces = ("forcing", "ground_acceleration")
    dampers_key = "dampers"
    kind: Literal["frame"] = key("Which equation.", "frame")
    storeys: Count | None = key(
        "Number n of storeys; x1 ... xn are their displacements against the ground. Default: the "
        "length of the lists below, or 3.",
        None,
    )
    mass: PerStorey | None = key(_MASS, None, unit="unit of mass")
    masses: PerStorey | None = key("The same under another name.", None, unit="unit of mass")
    stiffness: PerStorey | None = key(_SHEAR, None, unit="mass per time^2")
    stiffnesses: PerStorey | None = key(
        "The same under another name.", None, unit="mass per time^2"
    )
    dampers: list[Term] = key(
        "Dampers of any law between floors: in one storey, or in every one.",
        [],
        unit="coefficient: mass times time^(gamma-2)",
    )
    rayleigh: Rayleigh | None = RAYLEIGH
    ground_acceleration: TimeFunction = GROUND_ACCELERATION

    def mistakes(self) -> Iterator[Wrong]:
        """Two words for one property, and numbers that are not one above 0 for each storey."""
        yield from super().mistakes()
        for words in (_MASSES, _STIFFNESSES):
            given = [word for word in words if getattr(self, word) is not None]
            if len(given) > 1:
                yield Wrong((given[0],), f"give this or {given[1]}, not both", of_key=True)
            elif given and (numbers := self._of_storeys(words)).size not in (1, self.count()):
                yield Wrong((given[0],), f"{numbers.size} numbers for {self.count()} storeys")
            elif given and not (numbers > 0).all():
                yield Wrong((given[0],), "every number must be above 0")

    def _of_storeys(self, words: tuple[str, ...]) -> Array:
        """A property: a number, or one for each storey from the ground up."""
        given: Any = next((one for word in words if (one := getattr(self, word)) is not None), 1.0)
        return np.asarray(given.value if isinstance(given, Numbers) else given, dtype=float)

    def count(self) -> int:
        """Number of storeys."""
        lists = [one.size for one in map(self._of_storeys, (_MASSES, _STIFFNESSES)) if one.ndim]
        return self.storeys or (*lists, USUAL_STOREYS)[0]

    def own(self) -> dict[str, Any]:
        """The values of its own keys."""
        return {
            "storeys": self.count(),
            "mass": self._of_storeys(_MASSES),
            "stiffness": self._of_storeys(_STIFFNESSES),
            "dampers": super().own()["dampers"],
            "rayleigh": self.rayleigh,
        }

    def numbers(self) -> Mapping[str, float]:
        """The masses of the storeys, ``mass_1``, ..."""
        each = np.broadcast_to(self._of_storeys(_MASSES), self.count()).tolist()
        return {f"mass_{n}": one for n, one in enumerate(each, start=1)}

    def ready_quantities(self) -> Mapping[str, Expression]:
        """Drifts, absolute accelerations (with the ground), and the force of the foundation."""
        return frame_quantities(self.coordinate_names())


@lru_cache(maxsize=8)
def frame_quantities(coordinates: tuple[str, ...]) -> Mapping[str, Expression]:
    r"""Quantities of a building by name, in its coordinates from the ground up.

    ``drift_i`` is :math:`x_i - x_{i-1}`, ``acceleration_i`` :math:`x_i'' + a`, and ``base_shear``
    :math:`\sum m_i (x_i'' + a)`, the force of the foundation.
    """
    ground, found, below = "ground_acceleration", {}, "0"
    # built without text, since the sum of a tall building would exceed the longest text
    builder = Builder()
    shear = builder.number(0.0)
    for number, name in enumerate(coordinates, start=1):
        drift = name if below == "0" else f"{name} - {below}"
        found[f"drift_{number}"] = Expression.parse(drift, variables=coordinates)
        own, below = (f"a{name}", ground), name
        found[f"acceleration_{number}"] = Expression.parse(" + ".join(own), variables=own)
        absolute = builder.variable(f"a{name}") + builder.variable(ground)
        shear = shear + builder.variable(f"mass_{number}") * absolute
    system = builder.system([shear])
    found[BASE_SHEAR] = Expression(BASE_SHEAR, system.names, (), system)
    return MappingProxyType(found)


class Pluck(Keys):
    """A triangle, the initial shape of a plucked string."""

    at: Fraction = key("Place, as a fraction of the length (no unit).", 0.5)
    height: float = key("Height there.", 0.0, unit="length")


class String(SceneKind):
    """The sine modes of a string that is held at both ends."""

    equation = (
        "u_tt + sum mu D^gamma u - sum eta D^gamma u_ss = wave_speed^2 u_ss in sine modes "
        "x1, x2, ..."
    )
    make = staticmethod(string)
    dampers_key = "internal_damping"
    kind: Literal["string"] = key("Which equation.", "string")
    modes: Count = key("Number n of sine modes; the coordinates x1 ... xn are their amplitudes.", 8)
    wave_speed: Positive = key("c, the speed of waves.", 1.0, unit="length per time")
    length: Positive = key("L, the distance of the ends.", 1.0, unit="length")
    pluck: Pluck = key("A triangle that is added to the initial position.", Pluck())
    internal_damping: list[Term] = key(
        "Terms -eta D^gamma u_ss of the material, or any law; eta is their coefficient.", []
    )

    def count(self) -> int:
        """Number of modes."""
        return self.modes

    def own(self) -> dict[str, Any]:
        """The values of its own keys."""
        return {**super().own(), "pluck": (self.pluck.at, self.pluck.height)}
