"""Derivatives of formulas, exactly: the only room that knows SymPy, imported when called for.

Nothing here reads text: formulas arrive parsed by the whitelist of
:class:`fvi_cli.mathematics.expressions.Expression`, are built up as trees node by node, and leave
as data again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, Final

from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.algebra.formulas import (
    OPERATORS,
    Builder,
    FormulaSystem,
    Term,
    operands,
)
from fvi_cli.mathematics.expressions import Expression

Symbolic = Any
"""A SymPy expression."""

# Beyond these a formula is left as it stands; it is then perhaps not recognised as constant.
EXPANDED_OPERATIONS: Final = 250
EXPANDED_EXPONENT: Final = 6
TRIGONOMETRIC_OPERATIONS: Final = 120
# Second derivatives grow with the square of these.
DEEPEST: Final = 24
MOST_FACTORS: Final = 16
MOST_PARTS: Final = 3_000

_SAME_NAME: Final = ("exp", "log", "sin", "cos", "tan", "sinh", "cosh", "tanh", "sign")
_OTHER_NAME: Final[Mapping[str, str]] = {
    "asin": "arcsin",
    "acos": "arccos",
    "atan": "arctan",
    "asinh": "arcsinh",
    "acosh": "arccosh",
    "atanh": "arctanh",
    "Abs": "abs",
    "Select": "select",
}


def symbol(name: str) -> Symbolic:
    """The real variable `name`."""
    import sympy

    return sympy.Symbol(name, real=True)


def symbolic(expression: Expression) -> Symbolic:
    """The tree of a parsed expression.

    Raises
    ------
    ExpressionError
        If a function occurs whose derivative is not known here, or the formula is too large to be
        differentiated twice.
    """
    try:
        formula = _tree(expression)
    except RecursionError:
        raise ExpressionError(f"nested more than {DEEPEST} deep") from None
    _check_size(formula)
    return formula


def _check_size(formula: Symbolic) -> None:
    pending, parts = [(formula, 1)], 0
    while pending:
        part, depth = pending.pop()
        parts += 1
        if depth > DEEPEST:
            raise ExpressionError(f"nested more than {DEEPEST} deep")
        if part.is_Mul and len(part.args) > MOST_FACTORS:
            raise ExpressionError(f"a product of more than {MOST_FACTORS} factors")
        if parts > MOST_PARTS:
            raise ExpressionError(f"more than {MOST_PARTS} numbers, names and operations")
        pending.extend((argument, depth + 1) for argument in part.args)


def _tree(expression: Expression) -> Symbolic:
    import sympy

    system, constants = expression.system, dict(expression.constants)
    found: dict[int, Symbolic] = {}
    for place in system.needed:
        kind, *rest = system.instructions[place]
        used = [found[one] for one in operands(system.instructions[place])]
        if kind == "number":
            found[place] = _number(float(rest[0]))
        elif kind == "variable":
            name = str(rest[0])
            found[place] = _number(constants[name]) if name in constants else symbol(name)
        elif kind in ("**", "power"):
            exponent = used[1] if kind == "power" else _number(float(rest[1]))
            found[place] = sympy.Pow(used[0], _exponent(exponent))
        elif kind in OPERATORS:
            left, right = used
            if kind == "/" and right == 0:
                raise ExpressionError("it divides by zero")
            found[place] = {
                "+": lambda a, b: a + b,
                "-": lambda a, b: a - b,
                "*": lambda a, b: a * b,
                "/": lambda a, b: a / b,
            }[str(kind)](left, right)
        else:
            found[place] = -used[0] if kind == "negate" else _function(str(kind), *used)
    return found[system.outputs[0]]


def _number(value: float) -> Symbolic:
    """Floating point, so that (2 x)**n never makes an integer with n digits."""
    import sympy

    return sympy.Integer(int(value)) if value in (-1.0, 0.0, 1.0) else sympy.Float(value, 30)


def _exponent(value: Symbolic) -> Symbolic:
    import sympy

    if value.is_Float and abs(value) < 1e6 and float(2 * value).is_integer():
        return sympy.Rational(int(2 * value), 2)
    return value


def _function(name: str, argument: Symbolic, *others: Symbolic) -> Symbolic:
    import sympy

    if name in ("min", "max"):
        pair = (argument, *others)
        return _selection()(*pair, *(pair if name == "min" else pair[::-1]))
    if name in _SAME_NAME:
        return getattr(sympy, name)(argument)
    for theirs, ours in _OTHER_NAME.items():
        if name == ours:
            return getattr(sympy, theirs)(argument)
    if name == "sqrt":
        return sympy.sqrt(argument)
    if name == "cbrt":
        return sympy.sign(argument) * sympy.Abs(argument) ** sympy.Float(1 / 3, 30)
    if name == "expm1":
        return sympy.exp(argument) - 1
    if name == "log1p":
        return sympy.log(1 + argument)
    raise ExpressionError(f"the function {name!r} cannot be differentiated here")


@lru_cache(maxsize=1)
def _selection() -> Any:
    """``select(a, b, x, y)``: x where a < b, y where a > b, whose derivative is that of each."""
    import sympy

    class Select(sympy.Function):  # type: ignore[misc]
        @classmethod
        def eval(cls, a: Symbolic, b: Symbolic, x: Symbolic, y: Symbolic) -> Symbolic | None:
            if x == y:
                return x
            if a.is_number and b.is_number:
                return (x + y) / 2 if a == b else x if a < b else y
            return None

        def _eval_is_real(self) -> bool:
            return True

        def _eval_derivative(self, by: Symbolic) -> Symbolic:
            a, b, x, y = self.args
            return Select(a, b, x.diff(by), y.diff(by))

    return Select


def multiplied_out(formula: Symbolic) -> Symbolic:
    """The formula without products of sums, or as it stands where that would be long."""
    import sympy

    if formula.count_ops() > EXPANDED_OPERATIONS:
        return formula
    powers = [power.exp for power in formula.atoms(sympy.Pow) if power.base.is_Add]
    if not all(e.is_Integer and 0 < e <= EXPANDED_EXPONENT for e in powers):
        return formula
    return sympy.expand(formula)


def settled(formula: Symbolic) -> Symbolic:
    """The formula, multiplied out if that makes variables drop out of it."""
    import sympy

    if not formula.free_symbols:
        return formula
    expanded = multiplied_out(formula)
    if len(expanded.free_symbols) < len(formula.free_symbols):
        return expanded
    if formula.count_ops() <= TRIGONOMETRIC_OPERATIONS and formula.has(sympy.sin, sympy.cos):
        simpler = sympy.trigsimp(formula)
        if len(simpler.free_symbols) < len(formula.free_symbols):
            return simpler
    return formula


def constant(formula: Symbolic) -> float | None:
    """Its value if no variable is left in it.

    Raises
    ------
    ExpressionError
        If that value is not a finite real number.
    """
    if formula.free_symbols:
        return None
    value = complex(formula.evalf())
    if value.imag != 0 or value.real != value.real or abs(value.real) == float("inf"):
        raise ExpressionError(f"a derivative is {formula}, which is not a finite real number")
    return value.real


def terms_with(formula: Symbolic, variable: Symbolic) -> tuple[Symbolic, Symbolic]:
    """The terms of a sum in which `variable` occurs, and the others."""
    import sympy

    inside, outside = sympy.Integer(0), sympy.Integer(0)
    for term in sympy.Add.make_args(formula):
        if term.has(variable):
            inside += term
        else:
            outside += term
    return inside, outside


def compile_formulas(formulas: Sequence[Symbolic]) -> FormulaSystem:
    """One program for all of `formulas`, in which equal parts occur once.

    Raises
    ------
    ExpressionError
        If something occurs that is not real or not known.
    """
    program = _Program()
    return program.builder.system([program.term(formula) for formula in formulas])


def as_expression(formula: Symbolic, variables: Sequence[str]) -> Expression:
    """The formula as an expression in these variables."""
    return Expression(str(formula), tuple(variables), system=compile_formulas([formula]))


class _Program:
    """A program, and the terms of the parts that are in it already."""

    def __init__(self) -> None:
        self.builder = Builder()
        self._known: dict[Symbolic, Term] = {}

    def term(self, formula: Symbolic) -> Term:
        """The term of `formula`, after adding what is missing."""
        if formula not in self._known:
            self._known[formula] = self._compile(formula)
        return self._known[formula]

    def _compile(self, formula: Symbolic) -> Term:
        if formula.is_Symbol:
            return self.builder.variable(str(formula.name))
        if formula.is_number:
            return self.builder.number(_number_value(formula))
        if formula.is_Add:
            return self._sum(formula)
        if formula.is_Mul:
            return self._product(formula)
        if formula.is_Pow:
            return self._power(formula.base, formula.exp)
        if _is_impulse(formula):
            return self.builder.number(0.0)
        name = _function_name(formula)
        return self.builder.apply(name, *(self.term(argument) for argument in formula.args))

    def _sum(self, formula: Symbolic) -> Term:
        # a term that begins with a minus is subtracted, but not the first
        first, *others = sorted(formula.args, key=_is_negative)
        total = self.term(first)
        for one in others:
            total = total - self.term(-one) if _is_negative(one) else total + self.term(one)
        return total

    def _product(self, formula: Symbolic) -> Term:
        number, rest = formula.as_coeff_Mul()
        over: list[Symbolic] = []
        under: list[Symbolic] = []
        for factor in rest.args if rest.is_Mul else (rest,):
            divides = factor.is_Pow and factor.exp.is_number and factor.exp.is_negative
            (under if divides else over).append(factor.base**-factor.exp if divides else factor)
        total = self.builder.number(_number_value(number))
        for factor in over:
            total = total * self.term(factor)
        for factor in under:
            total = total / self.term(factor)
        return total

    def _power(self, base: Symbolic, exponent: Symbolic) -> Term:
        if not exponent.is_number:
            return self.builder.apply("power", self.term(base), self.term(exponent))
        value = _number_value(exponent)
        if value == 0.5:
            return self.term(base)("sqrt")
        if value < 0:
            return 1.0 / self.term(base**-exponent)
        return self.term(base) ** value


def _is_negative(term: Symbolic) -> bool:
    return bool(term.could_extract_minus_sign())


def _is_impulse(formula: Symbolic) -> bool:
    """Derivatives of kinks: zero except at one point."""
    return type(formula).__name__ == "DiracDelta"


def _number_value(formula: Symbolic) -> float:
    value = constant(formula)
    if value is None:  # pragma: no cover - numbers hold no variable
        raise ExpressionError(f"{formula} is not a number")
    return value


def _function_name(formula: Symbolic) -> str:
    name = type(formula).__name__
    if name in _SAME_NAME:
        return name
    if name in _OTHER_NAME:
        return _OTHER_NAME[name]
    raise ExpressionError(f"a derivative holds {name}, which has no real value here")
