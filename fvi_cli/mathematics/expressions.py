"""Formulas written as text by strangers: a whitelist parser, and their values.

Text is parsed with Python's own grammar into a syntax tree, and only numbers, declared names,
``+ - * / **`` and a fixed list of functions survive the translation into the program of a
:class:`fvi_cli.mathematics.algebra.formulas.FormulaSystem`. No text is ever handed to the
interpreter: no attribute, no comparison, no keyword, no call of anything that is not on the list.
"""

from __future__ import annotations

import ast
import keyword
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Final, TypeVar

import numpy as np

from fvi_cli.errors import suggestion
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS, ExpressionError
from fvi_cli.mathematics.algebra.builder import Builder, Term, bound, derivatives
from fvi_cli.mathematics.algebra.formulas import FormulaSystem, compute
from fvi_cli.mathematics.algebra.syntax import syntax_tree
from fvi_cli.mathematics.arrays import Array

T = TypeVar("T")

MOST_LISTED: Final = 12  # known names that a complaint lists
CONSTANTS: Final[Mapping[str, float]] = MappingProxyType({"pi": math.pi, "e": math.e})
_ALIASES: Final[Mapping[str, str]] = MappingProxyType(
    {f"a{name}": f"arc{name}" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")}
    | {"ln": "log"}
)
FUNCTION_NAMES: Final[frozenset[str]] = frozenset({*NUMPY_FUNCTIONS, *_ALIASES})
"""Every function name an expression may contain, other spellings (``asin``, ``ln``) included."""

_BINARY: Final[Mapping[type[ast.operator], str]] = MappingProxyType(
    {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
)

NO_SYSTEM: Final = FormulaSystem(instructions=(), outputs=())


@dataclass(frozen=True)
class Expression:
    """A formula in declared variables, as data.

    Two expressions are equal when text, variables, constants and programs are. Build one with
    :meth:`parse`.
    """

    text: str  # the text as given
    variables: tuple[str, ...] = ()  # names that may occur and get their values in evaluate
    constants: tuple[tuple[str, float], ...] = ()  # further names with fixed values, sorted by name
    # the program, with the constants as variables; if omitted, the translation of the text
    system: FormulaSystem = field(repr=False, default=NO_SYSTEM)

    def __post_init__(self) -> None:
        if self.system is NO_SYSTEM:
            found = _translate(self.text, self.variables, self.constants)
            object.__setattr__(self, "system", found)

    @classmethod
    def parse(
        cls,
        text: str | float,
        variables: Sequence[str] = (),
        constants: Mapping[str, float] | None = None,
    ) -> Expression:
        """Read an expression; a number stands for itself.

        Text may hold numbers, names, ``+ - * / **``, parentheses and functions of
        :data:`FUNCTION_NAMES`. A variable ``e`` hides Euler's number.

        Raises
        ------
        ExpressionError
            If the text holds anything else, is too long or too deep, or if a constant part of it
            is not a finite real number.
        """
        if isinstance(text, bool) or not isinstance(text, str | int | float):
            raise ExpressionError(f"{text!r} is neither a number nor an expression")
        written = text if isinstance(text, str) else repr(_finite(text))
        return cls(written, tuple(variables), tuple(sorted((constants or {}).items())))

    @property
    def bound(self) -> FormulaSystem:
        """The program with the constants as numbers, for those who look at powers and factors."""
        return bound(self.system, dict(self.constants)) if self.constants else self.system

    @property
    def names(self) -> frozenset[str]:
        """Variables that occur in it."""
        return frozenset(self.system.names).intersection(self.variables)

    @property
    def functions(self) -> frozenset[str]:
        """Functions of variables that occur in it, by their NumPy names."""
        return self.system.called

    def derivative(self, name: str) -> Expression:
        """The derivative by a variable."""
        return replace(self, system=derivatives(self.system, [{name: 1.0}])[1:])

    def expand(self, formulas: Mapping[str, Expression]) -> Expression:
        """The formula with variables replaced by formulas, given by the names of the variables."""
        builder = Builder()
        terms = {
            name: builder.include(formulas[name].system)[0]
            for name in sorted(self.names.intersection(formulas))
        }
        system = builder.system(builder.include(self.system, terms))
        return replace(self, system=system) if terms else self

    def evaluate(
        self,
        values: Mapping[str, T | float],
        functions: Mapping[str, Callable[..., T]] | None = None,
    ) -> T | float:
        """Value for given variables: see :meth:`FormulaSystem.evaluate`.

        ``t**-0.5`` at 0 is infinite and ``t**0.5`` at -1 is not a number.
        """
        return self.system.evaluate({**dict(self.constants), **values}, functions)[0]


def slopes_of(
    expression: Expression, values: Mapping[str, Array | float], wanted: Iterable[str]
) -> dict[str, Array]:
    """Derivatives of a formula with respect to wanted variables, by the names of the variables.

    Only names that occur in the formula have an entry. `values` has all of its variables: numbers
    or ``(n,)``.
    """
    names = sorted(expression.names.intersection(wanted))
    system = slopes_system(expression.system, tuple(names))
    found = system.evaluate({**dict(expression.constants), **values})
    # where a formula has no value it has no slope either
    return {
        name: np.where(np.isnan(found[0]), np.nan, rate)
        for name, rate in zip(names, found[1:], strict=True)
    }


@lru_cache(maxsize=256)
def slopes_system(system: FormulaSystem, names: tuple[str, ...]) -> FormulaSystem:
    """A program followed by its derivatives with respect to some variables; scenes share them."""
    return derivatives(system, [{name: 1.0} for name in names])


def _finite(number: float, column: int | None = None) -> float:
    try:
        value = float(number)
    except OverflowError:
        value = math.inf
    if math.isnan(value):
        raise ExpressionError("nan is not a finite number", column)
    if math.isinf(value):
        raise ExpressionError("the number is larger than 1.8e308", column)
    return value


@lru_cache(maxsize=1024)
def _translate(
    text: str, variables: tuple[str, ...], constants: tuple[tuple[str, float], ...]
) -> FormulaSystem:
    given = dict(constants)
    _check_names(variables, given)
    builder = Builder()
    done: list[tuple[Term, float | None]] = []
    # depth first without recursion: the second visit of a node makes its term
    pending: list[tuple[ast.expr, str, int]] = [(syntax_tree(text), "", 0)]
    while pending:
        node, kind, count = pending.pop()
        if kind:
            _emit(done, node, kind, count)
        elif isinstance(node, ast.Constant):
            if isinstance(node.value, bool) or not isinstance(node.value, int | float):
                raise ExpressionError(f"{node.value!r} is not allowed; use real numbers", _at(node))
            number = _finite(node.value, _at(node))
            done.append((builder.number(number), number))
        elif isinstance(node, ast.Name):
            if node.id in variables or node.id in given:
                done.append((builder.variable(node.id), given.get(node.id)))
            elif node.id in CONSTANTS:
                done.append((builder.number(CONSTANTS[node.id]), CONSTANTS[node.id]))
            else:
                raise _unknown("name", node, {*variables, *given, *CONSTANTS})
        else:
            kind, operands = _operation(node)
            if kind:
                pending.append((node, kind, len(operands)))
            pending.extend((child, "", 0) for child in reversed(operands))
    return builder.system([done[0][0]])


def _check_names(variables: tuple[str, ...], constants: Mapping[str, float]) -> None:
    seen: set[str] = set()
    for name in (*variables, *constants):
        if not (name.isascii() and name.isidentifier()) or keyword.iskeyword(name):
            raise ExpressionError(
                f"{name!r} cannot be a variable; use letters, digits and _, no Python keyword"
            )
        if name in FUNCTION_NAMES or name == "pi":
            raise ExpressionError(f"{name!r} cannot be a variable; the name has a meaning already")
        if name in seen:
            raise ExpressionError(
                f"{name!r} cannot be a parameter: it has a meaning here already; write another, "
                f"such as {name}_0"
            )
        seen.add(name)
    for name, value in constants.items():
        if not math.isfinite(value):
            raise ExpressionError(f"the constant {name} = {value!r} is not finite")


def _unknown(what: str, node: ast.Name, known: Iterable[str]) -> ExpressionError:
    """The complaint about a name or function, with the nearest known ones."""
    name, every = node.id, sorted(known)
    shown = every if len(every) <= MOST_LISTED else [*every[:MOST_LISTED], "..."]
    message = f"unknown {what} {name!r}{suggestion(name, every)} (known: {', '.join(shown)})"
    return ExpressionError(message, _at(node), name)


def _at(node: ast.expr) -> int:
    return node.col_offset + 1


def _operation(node: ast.expr) -> tuple[str, list[ast.expr]]:
    """Name and operands of an operator or function; the name is empty for a unary plus."""
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        return _BINARY[type(node.op)], [node.left, node.right]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
        return "negate" if isinstance(node.op, ast.USub) else "", [node.operand]
    if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
        raise ExpressionError(
            "only numbers, names, + - * / **, parentheses and functions are allowed", _at(node)
        )
    name = node.func.id
    if name not in FUNCTION_NAMES:
        raise _unknown("function", node.func, FUNCTION_NAMES)
    is_plain = not node.keywords and not any(isinstance(a, ast.Starred) for a in node.args)
    if not is_plain or (len(node.args) < 2 if name in ("min", "max") else len(node.args) != 1):
        wanted = "two arguments or more" if name in ("min", "max") else "exactly one argument"
        raise ExpressionError(f"{name} takes {wanted}", _at(node))
    return _ALIASES.get(name, name), node.args


def _emit(done: list[tuple[Term, float | None]], node: ast.expr, kind: str, count: int) -> None:
    """Replace the operands of `node` by its result, with the value where that is fixed."""
    first, *others = done[-count:]
    del done[-count:]
    try:
        for other in others or [first]:
            pair = [first, other] if others else [first]
            terms = [term for term, _ in pair]
            numbers = [value for _, value in pair if value is not None]
            value = compute(kind, numbers) if len(numbers) == len(pair) else None
            if value is not None:
                # a part that has constants only must be finite for their values
                Builder().number(value)
            first = (terms[0].builder.apply(kind, *terms), value)
    except ExpressionError as error:
        raise ExpressionError(error.message, _at(node)) from None
    done.append(first)
