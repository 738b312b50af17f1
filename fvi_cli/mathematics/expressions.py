"""Formulas written as text by strangers: a whitelist parser, and evaluation on any algebra.

Text is parsed with Python's own grammar into a syntax tree, and only numbers, declared names,
``+ - * / **`` and a fixed list of functions survive the translation into a short program for a
stack machine; ``min`` and ``max`` become the ``abs`` that is in them. Nothing is ever handed to the
interpreter: no attribute, no comparison, no keyword, no call of anything that is not on the list.
"""

from __future__ import annotations

import ast
import contextlib
import difflib
import keyword
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from types import MappingProxyType
from typing import Final, TypeVar, cast

import numpy as np

from fvi_cli.mathematics.algebra.arithmetic import (
    BESIDE_REAL,
    NUMPY_FUNCTIONS,
    ExpressionError,
    call,
    combine,
    value_of,
)
from fvi_cli.mathematics.algebra.syntax import syntax_tree
from fvi_cli.mathematics.arrays import Array, ComplexArray

T = TypeVar("T")
Instruction = tuple[str, float | str]

COMPLEX_STEP: Final = 2.0**-100
LARGEST_DEPTH: Final = 500
MOST_NODES: Final = 5_000

CONSTANTS: Final[Mapping[str, float]] = MappingProxyType({"pi": math.pi, "e": math.e})
_ALIASES: Final[Mapping[str, str]] = MappingProxyType(
    {f"a{name}": f"arc{name}" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")}
    | {"ln": "log"}
)
_JUMPS: Final = "; give a force that jumps in pieces, so that the jump can lie on a step"
_ADVICE: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(("heaviside", "step"), _JUMPS),
        **{f"{name}imum": f"; did you mean {name!r}?" for name in ("min", "max")},
    }
)


EXTREMA: Final[Mapping[str, str]] = MappingProxyType({"max": "+", "min": "-"})
"""Functions of several arguments: of two it is half of a + b, plus or minus abs(a - b)."""

FUNCTION_NAMES: Final[frozenset[str]] = frozenset({*NUMPY_FUNCTIONS, *_ALIASES, *EXTREMA})
"""Every function name an expression may contain, other spellings (``asin``, ``ln``) included."""

_BINARY: Final[Mapping[type[ast.operator], str]] = MappingProxyType(
    {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
)


@dataclass(frozen=True)
class Expression:
    r"""A formula in declared variables, as data.

    Two expressions are equal when text, variables and constants are. Build one with
    :meth:`parse`.

    Parameters
    ----------
    text
        The text as given.
    variables
        Names that may occur and get their values in :meth:`evaluate`.
    constants
        Further names with fixed values, sorted by name.
    """

    text: str
    variables: tuple[str, ...] = ()
    constants: tuple[tuple[str, float], ...] = ()
    _program: tuple[Instruction, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_program", _translate(self))

    @classmethod
    def parse(
        cls,
        text: str | float,
        variables: Sequence[str] = (),
        constants: Mapping[str, float] | None = None,
    ) -> Expression:
        """Read an expression; a number stands for itself.

        Parameters
        ----------
        text
            Numbers, names, ``+ - * / **``, parentheses and functions of :data:`FUNCTION_NAMES`.
        variables
            Names that may occur. A variable ``e`` hides Euler's number.
        constants
            Further names with their values.

        Raises
        ------
        ExpressionError
            If the text holds anything else, is too long or too deep, or if a constant part of it
            is not a finite real number.
        """
        if isinstance(text, bool) or not isinstance(text, str | int | float):
            raise ExpressionError(f"{text!r} is neither a number nor an expression")
        if not isinstance(text, str):
            text = _number_as_text(text)
        named = tuple(sorted((constants or {}).items()))
        return cls(text, tuple(variables), named)

    @property
    def names(self) -> frozenset[str]:
        """Variables that occur in it."""
        return frozenset(str(value) for kind, value in self._program if kind == "variable")

    @property
    def program(self) -> tuple[Instruction, ...]:
        """Instructions of a stack machine: ``(kind, number or name)``.

        The kinds are ``number``, ``variable``, ``call``, ``negate`` and the operators.
        """
        return self._program

    @property
    def functions(self) -> frozenset[str]:
        """Functions of variables that occur in it, by their NumPy names."""
        return frozenset(str(value) for kind, value in self._program if kind == "call")

    @property
    def is_constant(self) -> bool:
        """Whether no variable occurs."""
        return not self.names

    def evaluate(
        self, values: Mapping[str, T | float], functions: Mapping[str, Callable[..., T]]
    ) -> T | float:
        """Value for given variables, on any algebra with ``+ - * / **``.

        Integral exponents arrive as ``int``, all other constants as ``float``. Parts that hold
        only floating-point numbers are evaluated in double precision whatever the algebra is.
        Floating-point arithmetic never warns or raises here: ``t**-0.5`` at 0 is infinite and
        ``t**0.5`` at -1 is not a number.

        Parameters
        ----------
        values
            A value for every name in :attr:`names`; arrays broadcast.
        functions
            The elementary functions on the algebra, for arrays :data:`NUMPY_FUNCTIONS`.

        Returns
        -------
        T | float
            A ``float`` if the expression is constant or every value was a number.

        Raises
        ------
        ExpressionError
            If a value or a function is missing.
        """
        stack: list[T | float] = []
        with np.errstate(all="ignore"):
            for kind, value in self._program:
                if kind == "number":
                    stack.append(cast(float, value))
                elif kind == "variable":
                    stack.append(value_of(cast(str, value), values))
                elif kind == "call":
                    stack.append(call(cast(str, value), stack.pop(), functions))
                elif kind == "negate":
                    stack.append(-stack.pop())  # type: ignore[operator]
                else:
                    right = stack.pop()
                    left = stack.pop()
                    stack.append(combine(kind, left, right))
        return stack.pop()


def slopes_of(
    expression: Expression, values: Mapping[str, Array | float], wanted: Iterable[str]
) -> dict[str, Array]:
    """Derivatives of a formula by those of its variables that are wanted, by complex steps.

    Parameters
    ----------
    expression
        The formula.
    values
        Of all its variables, numbers or arrays of shape ``(n,)``.
    wanted
        Names; those that do not occur in it are left out.
    """
    found = {}
    for name in expression.names.intersection(wanted):
        beside = {**values, name: np.asarray(values[name]) + 1j * COMPLEX_STEP}
        value = expression.evaluate(cast(Mapping[str, ComplexArray], beside), BESIDE_REAL)
        found[name] = np.imag(np.asarray(value)) / COMPLEX_STEP
    return found


def _number_as_text(number: float) -> str:
    try:
        value = float(number)
    except OverflowError:
        raise ExpressionError("the number is larger than 1.8e308") from None
    if not math.isfinite(value):
        raise ExpressionError(f"{value!r} is not a finite number")
    return repr(value)


@lru_cache(maxsize=256)
def _translate(expression: Expression) -> tuple[Instruction, ...]:
    _check_names(expression)
    program: list[Instruction] = []
    tree = syntax_tree(expression.text)
    # Depth first without recursion: the second visit of a node emits its instruction.
    pending: list[tuple[ast.expr, int, bool]] = [(tree, 1, False)]
    nodes = 0
    while pending:
        node, depth, operands_done = pending.pop()
        if operands_done:
            _emit(program, node)
            continue
        nodes += 1
        if depth > LARGEST_DEPTH or max(nodes, len(program)) > MOST_NODES:
            raise ExpressionError(
                f"too long: at most {MOST_NODES} numbers, names and operators, nested at most "
                f"{LARGEST_DEPTH} deep"
            )
        if isinstance(node, ast.Constant):
            program.append(("number", _literal(node)))
        elif isinstance(node, ast.Name):
            program.append(_name(node, expression))
        else:
            pending.append((node, depth, True))
            pending.extend((child, depth + 1, False) for child in reversed(_operands(node)))
    return tuple(program)


def _check_names(expression: Expression) -> None:
    variables = expression.variables
    names = (*variables, *(name for name, _ in expression.constants))
    for name in names:
        if not (name.isascii() and name.isidentifier()) or keyword.iskeyword(name):
            raise ExpressionError(
                f"{name!r} cannot be a variable; use letters, digits and _, no Python keyword"
            )
        if name in FUNCTION_NAMES or name == "pi":
            raise ExpressionError(f"{name!r} cannot be a variable; the name has a meaning already")
    if len(set(names)) != len(names):
        raise ExpressionError(f"a name is declared twice in {list(names)}")
    for name, value in expression.constants:
        if not math.isfinite(value):
            raise ExpressionError(f"the constant {name} = {value!r} is not finite")


def _literal(node: ast.Constant) -> float:
    value = node.value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ExpressionError(f"{value!r} is not allowed; use real numbers", node.col_offset)
    with contextlib.suppress(OverflowError):
        if math.isfinite(number := float(value)):
            return number
    raise ExpressionError("the number is larger than 1.8e308", node.col_offset)


def _name(node: ast.Name, expression: Expression) -> Instruction:
    name = node.id
    if name in expression.variables:
        return ("variable", name)
    constants = {**CONSTANTS, **dict(expression.constants)}
    if name in constants:
        return ("number", float(constants[name]))
    if name in FUNCTION_NAMES:
        raise ExpressionError(f"the function {name!r} needs an argument: {name}(...)", _col(node))
    known = [*expression.variables, *constants]
    raise ExpressionError(_unknown("name", name, known), _col(node))


def _unknown(what: str, name: str, known: Sequence[str]) -> str:
    nearest = difflib.get_close_matches(name, known, n=1)
    guess = f"; did you mean {nearest[0]!r}?" if nearest else ""
    return f"unknown {what} {name!r}{_ADVICE.get(name, guess)} (known: {', '.join(sorted(known))})"


def _col(node: ast.expr) -> int:
    # Column 0 of the source is the added parenthesis, so this already counts from 1.
    return max(node.col_offset, 1)


def _operands(node: ast.expr) -> list[ast.expr]:
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        return [node.left, node.right]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
        return [node.operand]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        name = node.func.id
        if name not in FUNCTION_NAMES:
            raise ExpressionError(_unknown("function", name, sorted(FUNCTION_NAMES)), _col(node))
        is_plain = not node.keywords and not any(isinstance(a, ast.Starred) for a in node.args)
        if name in EXTREMA and (len(node.args) < 2 or not is_plain):
            raise ExpressionError(f"{name} takes two arguments or more: {name}(a, b)", _col(node))
        if name not in EXTREMA and (len(node.args) != 1 or not is_plain):
            raise ExpressionError(f"{name} takes exactly one argument", _col(node))
        return node.args
    raise ExpressionError(
        "only numbers, names, + - * / **, parentheses and functions are allowed", _col(node)
    )


def _emit(program: list[Instruction], node: ast.expr) -> None:
    """Append what `node` does, folding it when its operands are numbers."""
    instruction: Instruction
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in EXTREMA:
        for _ in node.args[1:]:
            _emit_extremum(program, EXTREMA[node.func.id])
        return
    if isinstance(node, ast.BinOp):
        instruction, count = (_BINARY[type(node.op)], ""), 2
    elif isinstance(node, ast.UnaryOp):
        if isinstance(node.op, ast.UAdd):
            return
        instruction, count = ("negate", ""), 1
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        instruction, count = ("call", _ALIASES.get(node.func.id, node.func.id)), 1
    else:
        raise ExpressionError("not allowed", _col(node))
    operands = program[-count:]
    if len(operands) < count or any(kind != "number" for kind, _ in operands):
        program.append(instruction)
        return
    folded = _fold(instruction, [cast(float, value) for _, value in operands], _col(node))
    del program[-count:]
    program.append(("number", folded))


def _emit_extremum(program: list[Instruction], sign: str) -> None:
    """Put the larger or the smaller in place of the last two values of a program."""
    second = _begin_of_last(program)
    first = _begin_of_last(program[:second])
    both = program[first:]
    if all(kind == "number" for kind, _ in both):
        chosen = (max if sign == "+" else min)(cast(float, value) for _, value in both)
        program[first:] = [("number", chosen)]
        return
    program.append(("+", ""))
    program.extend(both)
    program.extend([("-", ""), ("call", "abs"), (sign, ""), ("number", 0.5), ("*", "")])
    if len(program) > MOST_NODES:
        raise ExpressionError("min and max are nested too deeply")


def _begin_of_last(program: Sequence[Instruction]) -> int:
    """Where the instructions begin that compute the last value."""
    begin, missing = len(program), 1
    while missing:
        begin -= 1
        kind = program[begin][0]
        missing += -1 if kind in ("number", "variable") else 0 if kind in ("call", "negate") else 1
    return begin


def _fold(instruction: Instruction, operands: list[float], column: int) -> float:
    # Every number is a float already, so that 9**9**9 overflows at once instead of growing.
    with np.errstate(all="ignore"):
        kind, name = instruction
        if kind == "call":
            result = call(str(name), operands[0], NUMPY_FUNCTIONS)
        elif kind == "negate":
            result = -operands[0]
        else:
            result = combine(kind, operands[0], operands[1])
    value = float(cast(float, result))
    if math.isnan(value):
        raise ExpressionError("this constant is not a real number", column)
    if math.isinf(value):
        raise ExpressionError("this constant is infinite or larger than 1.8e308", column)
    return value
