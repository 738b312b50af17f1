r"""Derivatives of formulas, as formulas.

At a kink the derivative is the mean of both sides, :math:`|x|' = \operatorname{sign} x` with
:math:`\operatorname{sign} 0 = 0`, and where :math:`a = b` both :math:`\min(a, b)` and
:math:`\max(a, b)` have :math:`(a' + b')/2`: a subgradient where the function is convex. Elsewhere
it is that of the side which is taken, whatever the other one is: ``min(exp(800*x), 5)`` has
derivative 0 where the exponential overflows. ``sign`` has derivative 0 everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.algebra.builder import Builder, Term
from fvi_cli.mathematics.algebra.formulas import FormulaSystem, operands

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
"""Of y = function(x) by x."""


def derivatives(
    system: FormulaSystem, directions: Sequence[Mapping[str, float | str]]
) -> FormulaSystem:
    """All outputs of a program, then their derivatives along every direction.

    A direction has rates, numbers or names of further variables, by names of variables.

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
    """Derivatives at the places of a program; what is missing is 0."""
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
    # what is left is log_times
    return da * b("log") + a / b * db
