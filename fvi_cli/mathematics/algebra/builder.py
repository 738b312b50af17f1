r"""Build programs, also from other programs: derivatives of formulas, as formulas.

At a kink the derivative is the mean of both sides, :math:`|x|' = \operatorname{sign} x` with
:math:`\operatorname{sign} 0 = 0`, and where :math:`a = b` both :math:`\min(a, b)` and
:math:`\max(a, b)` have :math:`(a' + b')/2`: a subgradient where the function is convex. Elsewhere
it is the derivative of the argument that is taken, whatever the other one is: the derivative of
``min(exp(800*x), 5)`` is 0 where the exponential overflows. ``sign`` has derivative 0 everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, cast

from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.algebra.formulas import FormulaSystem, Instruction, compute, operands

MOST_INSTRUCTIONS: Final = 100_000
"""Longest program; second derivatives of a formula of n variables are longer by a factor of n^2."""


class Builder:
    """A program that grows: equal parts are stored once, operations on numbers are done at once."""

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
        """Add a number.

        Raises
        ------
        ExpressionError
            If the number is not finite.
        """
        if math.isnan(value):
            raise ExpressionError("this constant is not a real number")
        if math.isinf(value):
            raise ExpressionError("this constant is infinite or larger than 1.8e308")
        return self._add("number", float(value))

    def variable(self, name: str) -> Term:
        """Add a variable."""
        return self._add("variable", name)

    def apply(self, kind: str, *terms: Term) -> Term:
        """Add an operator, ``negate``, ``**`` or a function of terms, without simplifying.

        Raises
        ------
        ExpressionError
            If all terms are numbers and the result is not finite.
        """
        values = [one.value for one in terms]
        if all(value is not None for value in values):
            return self.number(compute(kind, cast(list[float], values)))
        if kind == "**" and values[1] is not None:
            return self._add(kind, terms[0].place, values[1])
        return self._add("power" if kind == "**" else kind, *(one.place for one in terms))

    def terms(
        self,
        system: FormulaSystem,
        bound: Mapping[str, float | Term] | None = None,
    ) -> dict[int, Term]:
        """Copy another program into this one; the new terms by the places of that program.

        `bound` replaces variables by numbers or by terms of this builder.
        """
        found: dict[int, Term] = {}
        values = bound or {}
        for place in system.needed:
            kind, *rest = system.instructions[place]
            number: Term | None = None
            if kind in ("number", "**"):
                number = self.number(float(rest[-1]))
            elif kind == "variable" and rest[0] in values:
                value = values[str(rest[0])]
                number = value if isinstance(value, Term) else self.number(float(value))
            if kind in ("number", "variable"):
                found[place] = self.variable(str(rest[0])) if number is None else number
                continue
            used = [found[one] for one in operands(system.instructions[place])]
            found[place] = self.apply(str(kind), *used, *([] if number is None else [number]))
        return found

    def include(
        self, system: FormulaSystem, bound: Mapping[str, float | Term] | None = None
    ) -> list[Term]:
        """Copy another program into this one as :meth:`terms` does; the terms of its outputs."""
        found = self.terms(system, bound)
        return [found[place] for place in system.outputs]

    def system(self, terms: Iterable[Term]) -> FormulaSystem:
        """The program whose outputs are these terms."""
        outputs = tuple(one.place for one in terms)
        return FormulaSystem(instructions=tuple(self.instructions), outputs=outputs)


def bound(system: FormulaSystem, values: Mapping[str, float]) -> FormulaSystem:
    """The program with numbers in the place of some variables."""
    builder = Builder()
    return builder.system(builder.include(system, values))


def negative(system: FormulaSystem) -> FormulaSystem:
    """The program with the signs of all outputs changed."""
    builder = Builder()
    return builder.system([-one for one in builder.include(system)])


def terms_with(system: FormulaSystem, name: str) -> tuple[FormulaSystem, FormulaSystem]:
    """Split a sum into two programs: of the terms with a variable, and of the terms without it."""
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


@dataclass(frozen=True)
class Term:
    """One place of a growing program; operators leave out zeros and ones."""

    builder: Builder
    place: int

    @property
    def value(self) -> float | None:
        """Its value if it is a number, else None."""
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
            if one.value in (-1.0, 0.0, 1.0):
                return -rest if one.value < 0 else rest if one.value else one
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
        """A function of this term and others."""
        return self.builder.apply(name, self, *others)


_RULES: Final[Mapping[str, Callable[[Term, Term], Term | float]]] = MappingProxyType(
    {
        "sqrt": lambda x, y: 0.5 / y,
        "cbrt": lambda x, y: 1.0 / (3.0 * y**2),
        "exp": lambda x, y: y,
        "expm1": lambda x, y: x("exp"),
        "log": lambda x, y: 1.0 / x,
        "log1p": lambda x, y: 1.0 / (1.0 + x),
        "sin": lambda x, y: x("cos"),
        "cos": lambda x, y: -x("sin"),
        "tan": lambda x, y: 1.0 + y**2,
        "sinh": lambda x, y: x("cosh"),
        "cosh": lambda x, y: x("sinh"),
        "tanh": lambda x, y: 1.0 - y**2,
        "arcsin": lambda x, y: 1.0 / (1.0 - x**2)("sqrt"),
        "arccos": lambda x, y: -1.0 / (1.0 - x**2)("sqrt"),
        "arctan": lambda x, y: 1.0 / (1.0 + x**2),
        "arcsinh": lambda x, y: 1.0 / (1.0 + x**2)("sqrt"),
        "arccosh": lambda x, y: 1.0 / (x**2 - 1.0)("sqrt"),
        "arctanh": lambda x, y: 1.0 / (1.0 - x**2),
        "abs": lambda x, y: x("sign"),
        "sign": lambda x, y: 0.0,
        "gamma": lambda x, y: y * x("digamma"),
    }
)
"""The derivative of y = function(x) with respect to x, from x and y."""


def derivatives(
    system: FormulaSystem, directions: Sequence[Mapping[str, float | str]]
) -> FormulaSystem:
    """All outputs of a program, then their derivatives along every direction.

    A direction maps names of variables to rates: numbers, or names of further variables.

    Raises
    ------
    ExpressionError
        If a function has no derivative here.
    """
    builder = Builder()
    terms = builder.terms(system)
    found = [terms[place] for place in system.outputs]
    for direction in directions:
        rates = _rates(system, direction, terms, builder)
        found += [rates.get(place, builder.number(0.0)) for place in system.outputs]
    return builder.system(found)


def _rates(
    system: FormulaSystem,
    direction: Mapping[str, float | str],
    terms: Mapping[int, Term],
    builder: Builder,
) -> dict[int, Term]:
    """Derivatives at the places of a program; places that are missing have derivative 0."""
    rates: dict[int, Term] = {}
    for place in system.needed:
        kind, *rest = instruction = system.instructions[place]
        used = operands(instruction)
        if kind == "variable" and rest[0] in direction:
            rate = direction[str(rest[0])]
            given = builder.variable(rate) if isinstance(rate, str) else builder.number(rate)
        elif any(one in rates for one in used):
            parts = [terms[one] for one in used]
            if kind == "**":
                parts.append(builder.number(float(rest[1])))
            moving = [rates.get(one, builder.number(0.0)) for one in used]
            given = _rate(str(kind), parts, moving, terms[place])
        else:
            continue
        if given.value != 0:
            rates[place] = given
    return rates


def _rate(kind: str, terms: Sequence[Term], rates: Sequence[Term], value: Term) -> Term:
    """The chain rule for one instruction."""
    if kind in _RULES:
        return rates[0] * _RULES[kind](terms[0], value)
    if kind == "negate":
        return -rates[0]
    if kind in ("**", "power"):
        base, exponent = terms
        found = exponent * base ** (exponent - 1.0) * rates[0]
        if len(rates) > 1:
            found = found + value("log_times", base) * rates[1]
        return found
    if kind in ("min", "max"):
        chosen = terms if kind == "min" else terms[::-1]
        return chosen[0]("select", chosen[1], *rates)
    if kind == "select":
        return terms[0]("select", terms[1], rates[2], rates[3])
    if kind == "digamma":
        raise ExpressionError("the function 'gamma' cannot be differentiated twice here")
    (a, b), (da, db) = terms, rates
    if kind == "+":
        return da + db
    if kind == "-":
        return da - db
    if kind == "*":
        return da * b + a * db
    if kind == "/":
        return (da - value * db) / b
    # the one remaining kind is log_times
    return da * b("log") + a / b * db
