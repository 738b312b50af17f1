"""Derivatives of formulas by their own numbers: exponents, frequencies, parameters.

A parameter of a scene moves some of the numbers in its formulas, whose structure stays. How fast
they move is found by differences of these numbers; what that does to the values of a formula is
differentiated as a formula, so that it is right however long the times are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece
from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.effects.sampled import FunctionForce, SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.algebra.builder import Builder, Term
from fvi_cli.mathematics.algebra.derivatives import derivatives
from fvi_cli.mathematics.algebra.formulas import FormulaSystem, operands
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression


@dataclass(frozen=True, kw_only=True, eq=False)
class NumberedFormula:
    """A program and the numbers in it.

    Parameters
    ----------
    system
        The program.
    parameters
        Values of the names in it that are numbers.
    """

    system: FormulaSystem
    parameters: Mapping[str, Any]

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
        """What it has in common with the same formula of other numbers."""
        masked = tuple(
            one[:-1] if one[0] in ("number", "**") else one for one in self.system.instructions
        )
        return masked, self.system.outputs, tuple(self._names)

    def rate(self, rates: Array) -> tuple[FormulaSystem, dict[str, float]]:
        """The derivative of all outputs as its numbers move, and the values of names in it."""
        names, numbers = self._names, self.numbers
        count = numbers.size - len(names)
        moving = tuple(int(k) for k in np.flatnonzero(rates))
        given = [f"#{k}" for k in range(count)] + names
        values = {**self.parameters}
        for k in moving:
            values |= {given[k]: float(numbers[k]), f"d{given[k]}'": float(rates[k])}
        return _rate_system(self.system, tuple(given[k] for k in moving)), values


def _numbered(system: FormulaSystem) -> list[int]:
    return [place for place in system.needed if system.instructions[place][0] in ("number", "**")]


@lru_cache(maxsize=256)
def _rate_system(system: FormulaSystem, moving: tuple[str, ...]) -> FormulaSystem:
    builder = Builder()
    terms: dict[int, Term] = {}
    names = {place: f"#{k}" for k, place in enumerate(_numbered(system))}
    for place in system.needed:
        kind, *rest = system.instructions[place]
        used = [terms[one] for one in operands(system.instructions[place])]
        if place in names:
            name = names[place]
            number = builder.variable(name) if name in moving else builder.number(float(rest[-1]))
            terms[place] = number if kind == "number" else builder.apply("**", *used, number)
        elif kind == "variable":
            terms[place] = builder.variable(str(rest[0]))
        else:
            terms[place] = builder.apply(str(kind), *used)
    again = builder.system([terms[place] for place in system.outputs])
    return derivatives(again, [{name: f"d{name}'" for name in moving}])[len(system.outputs) :]


def formulas_of(scene: Scene) -> list[NumberedFormula]:
    """The formulas of a scene: of its potential or Lagrangian, and of its forces, one by one."""
    found = []
    if isinstance(scene.potential, ExpressionPotential):
        system = scene.potential.gradient_system
        found.append(NumberedFormula(system=system, parameters=scene.potential.parameters))
    if scene.lagrangian is not None:
        own = scene.lagrangian
        found.append(NumberedFormula(system=own.first, parameters=own.parameters))
    for piece in () if scene.forcing is None else scene.forcing.pieces:
        for component, _ in piece.distinct:
            formula = component if isinstance(component, Expression) else component.formula
            if formula is not None:
                constants = dict(formula.constants)
                found.append(NumberedFormula(system=formula.system, parameters=constants))
    return found


def structure_of(scene: Scene) -> tuple[object, ...]:
    """What scenes have in common whose formulas differ in their numbers only."""
    pieces = []
    for piece in () if scene.forcing is None else scene.forcing.pieces:
        for component, places in piece.distinct:
            samples: object = None
            if isinstance(component, SampledForce):
                samples = (component.knots.tobytes(), component.coefficients.shape)
            elif isinstance(component, FunctionForce):
                samples = component.function
            pieces.append((piece.until, tuple(places), samples))
    shapes = tuple(one.shape for one in formulas_of(scene))
    return (type(scene.potential), scene.lagrangian is None, tuple(pieces), shapes)


def numbers_of(scene: Scene) -> list[Array]:
    """The numbers of all formulas of a scene, then the coefficients of samples and functions."""
    found = [one.numbers for one in formulas_of(scene)]
    for piece in () if scene.forcing is None else scene.forcing.pieces:
        for component, _ in piece.distinct:
            if isinstance(component, SampledForce):
                found.append(component.coefficients)
            elif isinstance(component, FunctionForce):
                found.append(np.array(component.factor))
    return found


def with_formulas_of(scene: Scene, other: Scene) -> Scene:
    """A scene with the formulas of another one in place of its own."""
    changes: dict[str, object] = {"forcing": other.forcing}
    if isinstance(scene.potential, ExpressionPotential):
        stiffness = scene.potential.stiffness
        changes["potential"] = replace(other.potential, stiffness=stiffness)  # type: ignore[type-var]
    if scene.lagrangian is not None and other.lagrangian is not None:
        changes["lagrangian"] = replace(other.lagrangian, stiffness=scene.lagrangian.stiffness)
    return replace(scene, **changes)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneRates:
    """How the formulas of a scene change with a parameter.

    Parameters
    ----------
    scene
        The scene.
    rates
        Of :func:`numbers_of` it.
    """

    scene: Scene
    rates: list[Array]

    def forces(self, position: Array, velocity: Array, time: Array | float) -> tuple[Array, Array]:
        """What happens to momenta and forces at points, both ``(..., d)``."""
        d = self.scene.dimension
        momentum, force = np.zeros((2, *position.shape))
        if self.scene.lagrangian is None and not isinstance(
            self.scene.potential, ExpressionPotential
        ):
            return momentum, force
        (formula, rates) = formulas_of(self.scene)[0], self.rates[0]
        if not rates.any():
            return momentum, force
        system, values = formula.rate(rates)
        if self.scene.lagrangian is not None:
            found = self.scene.lagrangian.evaluate(system, position, velocity, time, values)
            return found[..., :d], found[..., d:]
        potential = self.scene.potential
        assert isinstance(potential, ExpressionPotential)
        for index, value in enumerate(potential.evaluate(system, position, values)):
            force[..., index] = -np.asarray(value)
        return momentum, force

    def forcing(self) -> Forcing | None:
        """What happens to the force of the time; None: nothing."""
        scene = self.scene
        if scene.forcing is None:
            return None
        count = sum(len(piece.distinct) for piece in scene.forcing.pieces)
        formulas = formulas_of(scene)
        of_time = iter(zip(formulas, self.rates, strict=False))
        if scene.lagrangian is not None or isinstance(scene.potential, ExpressionPotential):
            next(of_time)
        further = iter(self.rates[len(formulas) :])
        pieces, is_still = [], True
        for piece in scene.forcing.pieces:
            components: list[ForceComponent] = [_NOTHING] * scene.dimension
            for component, places in piece.distinct:
                own = component if isinstance(component, Expression) else component.formula
                formula = None if own is None else _expression_rate(*next(of_time))
                changed: ForceComponent = formula or _NOTHING
                if not isinstance(component, Expression):
                    rate = next(further)
                    is_still = is_still and not rate.any()
                    if isinstance(component, SampledForce):
                        changed = replace(component, coefficients=rate, formula=formula)
                    else:
                        changed = replace(component, factor=float(rate), formula=formula)
                is_still = is_still and formula is None
                for place in places:
                    components[place] = changed
            pieces.append(ForcingPiece(components=tuple(components), until=piece.until))
        return None if is_still or not count else Forcing(pieces=tuple(pieces))


_NOTHING = Expression.parse("0", variables=("t",))


def _expression_rate(formula: NumberedFormula, rates: Array) -> Expression | None:
    if not rates.any():
        return None
    system, values = formula.rate(rates)
    return Expression(
        "the derivative of a force", ("t",), tuple(sorted(values.items())), system=system
    )
