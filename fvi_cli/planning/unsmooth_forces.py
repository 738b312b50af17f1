"""Forces that are not smooth: kinks and roots through which a motion may pass."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from fvi_cli.effects.forcing import formula_of
from fvi_cli.effects.lagrangian import TIME
from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.algebra.arithmetic import KINKED
from fvi_cli.mathematics.algebra.dependence import arguments_of
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array

LINES, SAMPLES, ZOOMS = 6, 2401, 6
TOUCHED = 1e-9
"""A least value of a function below this share of its usual size counts as zero."""
_SIGNED = (*KINKED, "cbrt")
_ROOTS = ("sqrt", "power", "**")

Line = Callable[[Array], Mapping[str, Array | float]]
"""From places along a straight line to the values of all variables there."""


@functools.lru_cache(maxsize=8)
def has_kinks(scene: Scene) -> bool:
    """Whether a motion may pass kinks of forces, or zeros of the argument of a root.

    Energies are evaluated along random straight lines through the space of positions, velocities
    and time. A motion may pass a kink if on a line the argument of ``abs``, ``sign`` or ``cbrt``,
    or the difference of the arguments of ``min`` or ``max``, changes its sign, or the argument of a
    root touches zero. Arguments that vanish only at single points of the plane, such as a distance,
    vanish on no line. Forces are evaluated over their own pieces in time.
    """
    random = np.random.default_rng(20)
    for system, parameters, names in _energies(scene):
        place = np.zeros(len(names))
        place[: scene.dimension] = scene.initial_position
        for _ in range(LINES):
            line = _line_through(parameters, names, place, random.standard_normal(len(names)))
            # sample points near and far on both sides
            if _meets_kinks(system, line, 1e-9 * np.sinh(np.linspace(-45.0, 45.0, SAMPLES))):
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


def _line_through(
    parameters: Mapping[str, Array | float], names: list[str], place: Array, direction: Array
) -> Line:
    rates = list(zip(names, place, direction, strict=True))
    return lambda along: {**parameters, **{name: at + along * rate for name, at, rate in rates}}


def _force_has_kinks(scene: Scene) -> bool:
    if scene.forcing is None:
        return False
    ends = [0.0, *scene.break_points, scene.final_time]
    for piece, begin, end in zip(scene.forcing.pieces, ends[:-1], ends[1:], strict=False):
        inside = np.linspace(0.0, end - begin, SAMPLES + 2)[1:-1]
        for component, _ in piece.distinct:
            if (formula := formula_of(component)) is not None:
                line = _line_through(dict(formula.constants), [TIME], np.array([begin]), np.ones(1))
                if _meets_kinks(formula.system, line, inside):
                    return True
    return False


def _meets_kinks(system: FormulaSystem, line: Line, along: Array) -> bool:
    for one in _arguments(system, _SIGNED, line, along):
        if (one == 0).any() or ((one[np.isfinite(one)] > 0).any() and (one <= 0).any()):
            return True
    roots = _arguments(system, _ROOTS, line, along)
    return any(_touches_zero(system, line, along, index, one) for index, one in enumerate(roots))


def _arguments(
    system: FormulaSystem, kinds: tuple[str, ...], line: Line, along: Array
) -> list[Array]:
    """Arguments of functions at places along a line."""
    found = arguments_of(system, kinds).evaluate(line(along))
    return [np.broadcast_to(one, along.shape) for one in found]


def _touches_zero(
    system: FormulaSystem, line: Line, along: Array, index: int, values: Array
) -> bool:
    """Whether the argument of a root, with `values` along a line, touches zero without crossing."""
    usual = float(np.nanmedian(np.abs(values)))
    for _ in range(ZOOMS):
        # no motion enters the region where the argument is negative
        inside = np.where(np.isfinite(values) & (values >= 0), values, np.inf)
        least = int(inside.argmin())
        if not 0 < least < values.size - 1 or not np.isfinite(inside[least]):
            return False
        if not (values[least - 1] >= 0 and values[least + 1] >= 0):
            return False
        if inside[least] <= TOUCHED * usual:
            return True
        along = np.linspace(along[least - 1], along[least + 1], 65)
        values = _arguments(system, _ROOTS, line, along)[index]
    return False
