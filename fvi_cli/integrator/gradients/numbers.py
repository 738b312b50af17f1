"""The numbers of a scene, and the derivatives of its forces with respect to them.

Numbers inside formulas (exponents, frequencies, parameters) are included. A parameter of a scene
changes numbers, but not the structure. The rates of the numbers are found by differences; formulas
are then differentiated exactly with respect to their numbers, so that derivatives are right at
times of any size.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece, formula_of
from fvi_cli.effects.matrices import dense, times
from fvi_cli.effects.potential import (
    ExpressionPotential,
    QuadraticPotential,
    SuppliedPotential,
)
from fvi_cli.effects.sampled import FunctionForce, SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.algebra.builder import Builder, derivatives
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression


@dataclass(frozen=True, kw_only=True, eq=False)
class NumberedFormula:
    """A program and the numbers in it."""

    system: FormulaSystem
    parameters: Mapping[str, Any]  # values of the names in it that are numbers

    @property
    def numbers(self) -> Array:
        """Its numbers in the order of the program, exponents among them, then the parameters."""
        found = [float(self.system.instructions[place][-1]) for place in _numbered(self.system)]
        return np.array([*found, *(float(self.parameters[name]) for name in self._names)])

    @property
    def _names(self) -> list[str]:
        return sorted(set(self.parameters).intersection(self.system.names))

    @property
    def shape(self) -> tuple[object, ...]:
        """The structure: equal for the same formula with other numbers."""
        masked = tuple(
            one[:-1] if one[0] in ("number", "**") else one for one in self.system.instructions
        )
        return masked, self.system.outputs, tuple(self._names)

    def rate(self, rates: Array) -> tuple[FormulaSystem, dict[str, float]]:
        """The derivative of all outputs for rates of the numbers, and the values of its names."""
        names, numbers = self._names, self.numbers
        given = [f"#{k}" for k in range(numbers.size - len(names))] + names
        moving = tuple(int(k) for k in np.flatnonzero(rates))
        values = {**self.parameters}
        for k in moving:
            values |= {given[k]: float(numbers[k]), f"d{given[k]}'": float(rates[k])}
        return _rate_system(self.system, tuple(given[k] for k in moving)), values


def _numbered(system: FormulaSystem) -> list[int]:
    return [place for place in system.needed if system.instructions[place][0] in ("number", "**")]


@lru_cache(maxsize=256)
def _rate_system(system: FormulaSystem, moving: tuple[str, ...]) -> FormulaSystem:
    builder = Builder()
    names = {place: f"#{k}" for k, place in enumerate(_numbered(system)) if f"#{k}" in moving}
    terms = builder.terms(system, named=names)
    again = builder.system([terms[place] for place in system.outputs])
    return derivatives(again, [{name: f"d{name}'" for name in moving}])[len(system.outputs) :]


def _mechanics(scene: Scene) -> NumberedFormula | None:
    """The formulas of a potential or Lagrangian."""
    if scene.lagrangian is not None:
        own = scene.lagrangian
        return NumberedFormula(system=own.first, parameters=own.parameters)
    if isinstance(scene.potential, ExpressionPotential):
        potential = scene.potential
        return NumberedFormula(system=potential.gradient_system, parameters=potential.parameters)
    return None


def _matrices(scene: Scene) -> list[Array]:
    """Mass and stiffness; the mass that a scene has with a Lagrangian is not one of its numbers."""
    holder: Any = scene.lagrangian or scene.potential
    form = (
        holder.form
        if isinstance(holder, QuadraticPotential)
        else getattr(holder, "stiffness", None)
    )
    zero = np.zeros((scene.dimension,) * 2)
    mass = zero if scene.lagrangian is not None else scene.inertia.mass
    return [mass, zero if form is None else dense(form)]


def _formula(component: ForceComponent) -> NumberedFormula | None:
    if (own := formula_of(component)) is None:
        return None
    return NumberedFormula(system=own.system, parameters=dict(own.constants))


def _components(scene: Scene) -> Iterator[tuple[ForcingPiece, ForceComponent, list[int]]]:
    for piece in () if scene.forcing is None else scene.forcing.pieces:
        for component, places in piece.distinct:
            yield piece, component, places


def numbers_of(scene: Scene) -> tuple[list[object], list[Array]]:
    """The structure, equal for scenes that differ in numbers only, and the numbers.

    The numbers are those of mass and stiffness, of the formulas of a potential or Lagrangian, and
    for every component of the force of its formula and the coefficients of samples and functions.
    """
    mechanics = _mechanics(scene)
    structure: list[object] = [scene.lagrangian is None, mechanics and mechanics.shape]
    if isinstance(scene.potential, SuppliedPotential):
        # its numbers are not known: another object is another structure
        structure.append(id(scene.potential.functions))
    numbers = _matrices(scene)
    numbers.append(np.zeros(0) if mechanics is None else mechanics.numbers)
    for piece, component, places in _components(scene):
        formula = _formula(component)
        structure += [piece.until, places, formula and formula.shape]
        numbers.append(np.zeros(0) if formula is None else formula.numbers)
        if isinstance(component, SampledForce):
            structure.append((component.knots.tobytes(), component.coefficients.shape))
            numbers.append(component.coefficients)
        elif isinstance(component, FunctionForce):
            structure.append(component.function)
            numbers.append(np.array(component.factor))
    return structure, numbers


def rates_of_forces(
    scene: Scene, rates: Sequence[Array], position: Array, velocity: Array, time: Array | float
) -> tuple[Array, Array]:
    """Derivatives of momenta and conservative forces for rates of the numbers, ``(..., d)``."""
    momentum, force = np.zeros_like(velocity), np.zeros_like(position)
    if rates[0].any():
        momentum = np.asarray(times(velocity, rates[0]))
    if rates[1].any():
        force = -np.asarray(times(position, rates[1]))
    mechanics = _mechanics(scene)
    if mechanics is None or not rates[2].any():
        return momentum, force
    system, values = mechanics.rate(rates[2])
    with np.errstate(all="ignore"):
        if scene.lagrangian is not None:
            found = scene.lagrangian.evaluate(system, position, velocity, time, values)
            return momentum + found[..., : scene.dimension], force + found[..., scene.dimension :]
        assert isinstance(scene.potential, ExpressionPotential)
        for index, value in enumerate(scene.potential.evaluate(system, position, values)):
            force[..., index] -= value
    return momentum, force


def rate_of_forcing(scene: Scene, rates: Sequence[Array]) -> Forcing | None:
    """Derivative of the forcing for rates of the numbers; None if it is zero."""
    if scene.forcing is None or not any(one.any() for one in rates[3:]):
        return None
    moving = iter(rates[3:])
    found: dict[int, list[ForceComponent]] = {}
    for piece, component, places in _components(scene):
        formula, own = _formula(component), next(moving)
        changed: Expression | None = None
        if formula is not None and own.any():
            system, values = formula.rate(own)
            known = tuple(sorted(values.items()))
            changed = Expression("the derivative of a force", ("t",), known, system=system)
        every: ForceComponent = changed or _ZERO
        if isinstance(component, SampledForce):
            every = replace(component, coefficients=next(moving), formula=changed)
        elif isinstance(component, FunctionForce):
            every = replace(component, factor=float(next(moving)), formula=changed)
        components = found.setdefault(id(piece), [_ZERO] * scene.dimension)
        for place in places:
            components[place] = every
    pieces = [
        ForcingPiece(components=tuple(found[id(piece)]), until=piece.until)
        for piece in scene.forcing.pieces
    ]
    return Forcing(pieces=tuple(pieces))


_ZERO = Expression.parse("0", variables=("t",))
