"""Where the forces of a scene are not smooth: kinks and roots that a motion may go through."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from fvi_cli.effects.lagrangian import TIME, velocity_name
from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression

LINES, SAMPLES, ZOOMS = 6, 2401, 6
TOUCHED = 1e-9
"""Part of its usual size below which the least value of a function is zero."""
WITH_KINKS = ("abs", "sign", "cbrt")


@dataclass(eq=False)
class _Traced:
    """An array that notes of which others kinks and roots are taken."""

    value: Array
    signed: list[Array]
    rooted: list[Array]

    def _made(self, value: object) -> _Traced:
        return _Traced(np.asarray(value, dtype=float), self.signed, self.rooted)

    def __add__(self, other: object) -> _Traced:
        return self._made(self.value + _plain(other))

    __radd__ = __add__

    def __sub__(self, other: object) -> _Traced:
        return self._made(self.value - _plain(other))

    def __rsub__(self, other: object) -> _Traced:
        return self._made(_plain(other) - self.value)

    def __mul__(self, other: object) -> _Traced:
        return self._made(self.value * _plain(other))

    __rmul__ = __mul__

    def __truediv__(self, other: object) -> _Traced:
        return self._made(self.value / _plain(other))

    def __rtruediv__(self, other: object) -> _Traced:
        return self._made(_plain(other) / self.value)

    def __neg__(self) -> _Traced:
        return self._made(-self.value)

    def __pow__(self, other: object) -> _Traced:
        exponent = _plain(other)
        if np.ndim(exponent) or not float(exponent).is_integer():
            self.rooted.append(self.value)
        return self._made(self.value**exponent)

    def __rpow__(self, other: object) -> _Traced:
        return self._made(_plain(other) ** self.value)

    def call(self, name: str) -> _Traced:
        if name in WITH_KINKS:
            self.signed.append(self.value)
        elif name == "sqrt":
            self.rooted.append(self.value)
        return self._made(NUMPY_FUNCTIONS[name](self.value))


def _plain(value: object) -> Array:
    return value.value if isinstance(value, _Traced) else np.asarray(value, dtype=float)


def _call(name: str, argument: _Traced) -> _Traced:
    return argument.call(name)


def _functions() -> Mapping[str, Callable[[_Traced], _Traced]]:
    return {name: partial(_call, name) for name in NUMPY_FUNCTIONS}


Formula = Callable[[Mapping[str, object], Mapping[str, Callable[..., object]]], object]


def has_kinks(scene: Scene) -> bool:
    """Whether forces have kinks, or roots of what comes to zero, where a motion may pass.

    Energies are followed along random straight lines through the space of positions, velocities
    and time: where the argument of ``abs``, ``sign`` or ``cbrt`` changes its sign on them, or that
    of a root touches zero, motions go through such places. What vanishes at single points of the
    plane alone, such as a distance, is met by no line. A force is followed over its own pieces.
    """
    random = np.random.default_rng(20)
    names: list[str] = []
    energy: Formula | None = None
    if isinstance(scene.potential, ExpressionPotential):
        potential = scene.potential
        names = list(potential.coordinates)
        fixed = dict(potential.parameters)
        expression = potential.energy_expression

        def energy(values, functions):  # type: ignore[no-untyped-def]
            return expression.evaluate({**fixed, **values}, functions)

    elif scene.lagrangian is not None:
        lagrangian = scene.lagrangian
        names = [*lagrangian.coordinates, *map(velocity_name, lagrangian.coordinates), TIME]
        energy = lagrangian.value.evaluate
    if energy is not None:
        place = np.zeros(len(names))
        place[: scene.dimension] = scene.initial_position
        for _ in range(LINES):
            line = _Line(energy, names, place, random.standard_normal(len(names)))
            # near and far alike, on both sides
            if line.has_kinks(1e-9 * np.sinh(np.linspace(-45.0, 45.0, SAMPLES))):
                return True
    return _force_has_kinks(scene)


def _force_has_kinks(scene: Scene) -> bool:
    if scene.forcing is None:
        return False
    ends = [0.0, *scene.break_points, scene.final_time]
    for piece, begin, end in zip(scene.forcing.pieces, ends[:-1], ends[1:], strict=False):
        for component, _ in piece.distinct:
            if isinstance(component, Expression) and component.functions | _powers(component):
                line = _Line(component.evaluate, [TIME], np.array([begin]), np.ones(1))
                inside = np.linspace(0.0, end - begin, SAMPLES + 2)[1:-1]
                if line.has_kinks(inside):
                    return True
    return False


def _powers(expression: Expression) -> set[str]:
    return {"**"} & {str(kind) for kind, _ in expression.program}


@dataclass(eq=False)
class _Line:
    """A formula along a straight line."""

    formula: Formula
    names: list[str]
    place: Array
    direction: Array
    functions: Mapping[str, Callable[..., object]] = field(default_factory=_functions)

    def arguments(self, along: Array) -> tuple[list[Array], list[Array]]:
        """What kinks and roots are taken of, at points along the line."""
        signed: list[Array] = []
        rooted: list[Array] = []
        values = {
            name: _Traced(at + along * rate, signed, rooted)
            for name, at, rate in zip(self.names, self.place, self.direction, strict=True)
        }
        with np.errstate(all="ignore"):
            self.formula(values, self.functions)
        return signed, rooted

    def has_kinks(self, along: Array) -> bool:
        signed, rooted = self.arguments(along)
        if any((one[np.isfinite(one)] > 0).any() and (one <= 0).any() for one in signed):
            return True
        if any((one == 0).any() for one in signed):
            return True
        return any(self._touches(index, along, one) for index, one in enumerate(rooted))

    def _touches(self, index: int, along: Array, values: Array) -> bool:
        """Whether what a root is taken of comes to zero and turns back."""
        usual = float(np.nanmedian(np.abs(values)))
        for _ in range(ZOOMS):
            # where it is negative the motion cannot be
            inside = np.where(np.isfinite(values) & (values >= 0), values, np.inf)
            least = int(inside.argmin())
            if not 0 < least < values.size - 1 or not np.isfinite(inside[least]):
                return False
            if not (values[least - 1] >= 0 and values[least + 1] >= 0):
                return False
            if inside[least] <= TOUCHED * usual:
                return True
            along = np.linspace(along[least - 1], along[least + 1], 65)
            values = np.broadcast_to(self.arguments(along)[1][index], along.shape)
        return False
