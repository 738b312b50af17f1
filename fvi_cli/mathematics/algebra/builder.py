"""Programs that grow, and programs made of others."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, cast

from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.algebra.formulas import FormulaSystem, Instruction, compute, operands

MOST_INSTRUCTIONS: Final = 100_000
"""Of a program; second derivatives of a long formula grow with the square of its variables."""


class Builder:
    """A program that grows: equal parts are one, numbers are computed at once."""

    def __init__(self) -> None:
        self.instructions: list[Instruction] = []
        self._places: dict[object, int] = {}

    def _add(self, *instruction: str | float | int) -> Term:
        # 0.0 and -0.0 are equal, but not the same
        key = repr(instruction) if instruction[0] == "number" else instruction
        if key not in self._places:
            if len(self.instructions) >= MOST_INSTRUCTIONS:
                raise ExpressionError(
                    f"too long: with its derivatives more than {MOST_INSTRUCTIONS} operations"
                )
            self._places[key] = len(self.instructions)
            self.instructions.append(instruction)
        return Term(self, self._places[key])

    def number(self, value: float) -> Term:
        """A number.

        Raises
        ------
        ExpressionError
            If it is not finite.
        """
        if math.isnan(value):
            raise ExpressionError("this constant is not a real number")
        if math.isinf(value):
            raise ExpressionError("this constant is infinite or larger than 1.8e308")
        return self._add("number", float(value))

    def variable(self, name: str) -> Term:
        """A variable."""
        return self._add("variable", name)

    def apply(self, kind: str, *terms: Term) -> Term:
        """An operator, ``negate``, ``**`` or a function of terms, as it stands.

        Raises
        ------
        ExpressionError
            If it is a number that is not finite.
        """
        values = [one.value for one in terms]
        if all(value is not None for value in values):
            return self.number(compute(kind, cast(list[float], values)))
        if kind == "**" and values[1] is not None:
            return self._add(kind, terms[0].place, values[1])
        return self._add("power" if kind == "**" else kind, *(one.place for one in terms))

    def terms(
        self, system: FormulaSystem, bound: Mapping[str, float] | None = None
    ) -> dict[int, Term]:
        """Another program in this one, by its places; numbers may take the place of variables."""
        found: dict[int, Term] = {}
        for place in system.needed:
            kind, *rest = system.instructions[place]
            if kind == "number" or (kind == "variable" and rest[0] in (bound or {})):
                value = rest[0] if kind == "number" else (bound or {})[str(rest[0])]
                found[place] = self.number(float(value))
            elif kind == "variable":
                found[place] = self.variable(str(rest[0]))
            else:
                used = [found[one] for one in operands(system.instructions[place])]
                exponent = [self.number(float(rest[1]))] if kind == "**" else []
                found[place] = self.apply(str(kind), *used, *exponent)
        return found

    def include(
        self, system: FormulaSystem, bound: Mapping[str, float] | None = None
    ) -> list[Term]:
        """The outputs of another program; numbers may take the place of its variables."""
        found = self.terms(system, bound)
        return [found[place] for place in system.outputs]

    def system(self, terms: Iterable[Term]) -> FormulaSystem:
        """The program of some terms."""
        outputs = tuple(one.place for one in terms)
        return FormulaSystem(instructions=tuple(self.instructions), outputs=outputs)


def bound(system: FormulaSystem, values: Mapping[str, float]) -> FormulaSystem:
    """The program with numbers in the place of some variables."""
    builder = Builder()
    return builder.system(builder.include(system, values))


def negative(system: FormulaSystem) -> FormulaSystem:
    """The program of the outputs with another sign."""
    builder = Builder()
    return builder.system([-one for one in builder.include(system)])


def terms_with(system: FormulaSystem, name: str) -> tuple[FormulaSystem, FormulaSystem]:
    """The terms of a sum in which a variable occurs, and the others."""
    builder = Builder()
    found = builder.terms(system)
    sums = [builder.number(0.0), builder.number(0.0)]
    pending = [(system.outputs[0], 1)]
    while pending:
        place, sign = pending.pop()
        kind, *used = system.instructions[place]
        if kind in ("+", "-", "negate"):
            signs = (sign, -sign) if kind == "-" else (-sign,) if kind == "negate" else (sign, sign)
            pending += zip(map(int, used), signs, strict=True)
            continue
        which = int(name not in FormulaSystem(system.instructions, (place,)).names)
        sums[which] = sums[which] + found[place] if sign > 0 else sums[which] - found[place]
    return builder.system(sums[:1]), builder.system(sums[1:])


def join(*systems: FormulaSystem) -> FormulaSystem:
    """One program for the outputs of several."""
    builder = Builder()
    return builder.system([term for one in systems for term in builder.include(one)])


@dataclass(frozen=True)
class Term:
    """One place of a growing program; operators leave out zeros and ones."""

    builder: Builder
    place: int

    @property
    def value(self) -> float | None:
        """The number that it is; None: it is none."""
        kind, *rest = self.builder.instructions[self.place]
        return float(rest[0]) if kind == "number" else None

    def _lift(self, other: Term | float) -> Term:
        return other if isinstance(other, Term) else self.builder.number(other)

    def __neg__(self) -> Term:
        if self.builder.instructions[self.place][0] == "negate":
            return Term(self.builder, *operands(self.builder.instructions[self.place]))
        return self.builder.apply("negate", self)

    def __add__(self, other: Term | float) -> Term:
        other = self._lift(other)
        if self.value == 0 or other.value == 0:
            return self if other.value == 0 else other
        return self.builder.apply("+", self, other)

    def __sub__(self, other: Term | float) -> Term:
        other = self._lift(other)
        if self.value == 0 or other.value == 0:
            return self if other.value == 0 else -other
        if self.builder.instructions[other.place][0] == "negate":
            return self + -other
        return self.builder.apply("-", self, other)

    def __mul__(self, other: Term | float) -> Term:
        other = self._lift(other)
        for one, rest in ((self, other), (other, self)):
            if one.value in (0.0, 1.0):
                return one if one.value == 0 else rest
        return self.builder.apply("*", self, other)

    def __truediv__(self, other: Term | float) -> Term:
        other = self._lift(other)
        return self if self.value == 0 or other.value == 1 else self.builder.apply("/", self, other)

    def __pow__(self, other: Term | float) -> Term:
        other = self._lift(other)
        if other.value in (0.0, 1.0):
            return self if other.value == 1 else self.builder.number(1.0)
        return self.builder.apply("**", self, other)

    def __radd__(self, other: float) -> Term:
        return self._lift(other) + self

    def __rsub__(self, other: float) -> Term:
        return self._lift(other) - self

    def __rmul__(self, other: float) -> Term:
        return self._lift(other) * self

    def __rtruediv__(self, other: float) -> Term:
        return self._lift(other) / self

    def __call__(self, name: str, *others: Term) -> Term:
        """A function of it."""
        return self.builder.apply(name, self, *others)
