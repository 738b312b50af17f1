"""Where the forces of a scene are not smooth: kinks and roots that a motion may go through."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from fvi_cli.effects.lagrangian import TIME
from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.algebra.formulas import FormulaSystem, Instruction
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression

LINES, SAMPLES, ZOOMS = 6, 2401, 6
TOUCHED = 1e-9
"""Part of its usual size below which the least value of a function is zero."""
_OF_ONE = ("abs", "sign", "cbrt")
_OF_TWO = ("min", "max", "select")


@functools.lru_cache(maxsize=8)
def has_kinks(scene: Scene) -> bool:
    """Whether forces have kinks, or roots of what comes to zero, where a motion may pass.

    Energies are followed along random straight lines through the space of positions, velocities
    and time: where the argument of ``abs``, ``sign`` or ``cbrt``, or the difference of those of
    ``min`` or ``max``, changes its sign on them, or that of a root touches zero, motions go through
    such places. What vanishes at single points of the plane alone, such as a distance, is met by no
    line. A force is followed over its own pieces.
    """
    random = np.random.default_rng(20)
    for system, parameters, names in _energies(scene):
        place = np.zeros(len(names))
        place[: scene.dimension] = scene.initial_position
        for _ in range(LINES):
            line = _line(system, parameters, names, place, random.standard_normal(len(names)))
            # near and far alike, on both sides
            if line.has_kinks(1e-9 * np.sinh(np.linspace(-45.0, 45.0, SAMPLES))):
                return True
    return _force_has_kinks(scene)


def _energies(
    scene: Scene,
) -> Iterable[tuple[FormulaSystem, Mapping[str, Array | float], list[str]]]:
    potential, lagrangian = scene.potential, scene.lagrangian
    if isinstance(potential, ExpressionPotential):
        yield potential.energy_expression.system, potential.parameters, [*potential.coordinates]
    elif lagrangian is not None:
        names = [*lagrangian.coordinates, *lagrangian.velocities, TIME]
        yield lagrangian.value, lagrangian.parameters, names


def _force_has_kinks(scene: Scene) -> bool:
    if scene.forcing is None:
        return False
    ends = [0.0, *scene.break_points, scene.final_time]
    for piece, begin, end in zip(scene.forcing.pieces, ends[:-1], ends[1:], strict=False):
        for component, _ in piece.distinct:
            if not isinstance(component, Expression):
                continue
            line = _line(component.system, {}, [TIME], np.array([begin]), np.ones(1))
            if line.has_kinks(np.linspace(0.0, end - begin, SAMPLES + 2)[1:-1]):
                return True
    return False


def _signed(instruction: Instruction) -> tuple[int, ...]:
    """Places of what has another sign on the other side of a kink; of two, their difference."""
    if instruction[0] in _OF_ONE:
        return cast(tuple[int, ...], instruction[1:2])
    return cast(tuple[int, ...], instruction[1:3]) if instruction[0] in _OF_TWO else ()


def _rooted(instruction: Instruction) -> tuple[int, ...]:
    """The place of what a root is taken of."""
    kind = instruction[0]
    is_root = kind in ("sqrt", "power") or (
        kind == "**" and not float(cast(float, instruction[2])).is_integer()
    )
    return cast(tuple[int, ...], instruction[1:2]) if is_root else ()


def _line(
    system: FormulaSystem,
    parameters: Mapping[str, Array | float],
    names: list[str],
    place: Array,
    direction: Array,
) -> _Line:
    """A line for the arguments of all kinks and roots of a program."""

    def found(of: Callable[[Instruction], tuple[int, ...]]) -> list[tuple[int, ...]]:
        return [places for one in system.needed if (places := of(system.instructions[one]))]

    return _Line(
        system=system,
        parameters=parameters,
        names=names,
        place=place,
        direction=direction,
        signed=found(_signed),
        rooted=found(_rooted),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Line:
    """The arguments of kinks and roots of a formula along a straight line."""

    system: FormulaSystem
    parameters: Mapping[str, Array | float]
    names: list[str]
    place: Array
    direction: Array
    signed: list[tuple[int, ...]]
    rooted: list[tuple[int, ...]]

    def _values(self, places: list[tuple[int, ...]], along: Array) -> list[Array]:
        """Values, or differences of two, at points along the line."""
        outputs = tuple(one for places_of_one in places for one in places_of_one)
        system = FormulaSystem(self.system.instructions, outputs)
        variables = {
            name: at + along * rate
            for name, at, rate in zip(self.names, self.place, self.direction, strict=True)
        }
        found = iter(system.evaluate({**self.parameters, **variables}, NUMPY_FUNCTIONS))
        values = [[np.broadcast_to(next(found), along.shape) for _ in one] for one in places]
        with np.errstate(all="ignore"):
            return [one[0] if len(one) == 1 else one[0] - one[1] for one in values]

    def has_kinks(self, along: Array) -> bool:
        for one in self._values(self.signed, along):
            if (one == 0).any() or ((one[np.isfinite(one)] > 0).any() and (one <= 0).any()):
                return True
        rooted = self._values(self.rooted, along)
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
            (values,) = self._values(self.rooted[index : index + 1], along)
        return False
