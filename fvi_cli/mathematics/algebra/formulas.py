"""Formulas as straight-line programs: built from a closed set of nodes, compiled once.

A program is data: numbers, names of variables, operators and functions of a fixed list, each with
the places of its operands. It is written as Python source of one statement a node and compiled; no
text of a user is part of that source, and the function it makes sees the arithmetic functions of
its algebra and nothing else.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import CodeType, FunctionType
from typing import Any, Final, TypeVar, cast

import numpy as np

from fvi_cli.mathematics.algebra.arithmetic import (
    INNER_FUNCTIONS,
    KINKED,
    NUMPY_FUNCTIONS,
    ExpressionError,
    value_of,
)
from fvi_cli.mathematics.arrays import Array

T = TypeVar("T")
Instruction = tuple[str | float | int, ...]
"""``("number", value)``, ``("variable", name)``, ``("**", base, number)``, or the name of an
operator or function with the places of its operands."""

OPERATORS: Final = ("+", "-", "*", "/")
LARGEST_WHOLE_POWER: Final = 1e9  # smaller integral exponents are of type int
_EVERY: Final = {**NUMPY_FUNCTIONS, **INNER_FUNCTIONS}
_OF_NUMBERS: Final[Mapping[str, Callable[..., Any]]] = {
    **_EVERY,
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "**": np.power,
    "negate": np.negative,
}


@dataclass(frozen=True)
class FormulaSystem:
    """Several values computed by one program, in which equal parts occur once."""

    instructions: tuple[Instruction, ...]  # the program, operands before their users
    outputs: tuple[int, ...]  # places of the values

    @cached_property
    def needed(self) -> tuple[int, ...]:
        """Places that the outputs depend on, ascending."""
        found = set(self.outputs)
        for place in range(len(self.instructions) - 1, -1, -1):
            if place in found:
                found.update(operands(self.instructions[place]))
        return tuple(sorted(found))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Variables that occur, in the order of the program."""
        every = (self.instructions[place] for place in self.needed)
        return tuple(str(one[1]) for one in every if one[0] == "variable")

    @cached_property
    def called(self) -> frozenset[str]:
        """Functions that occur, including those that only derivatives call."""
        return frozenset(str(self.instructions[place][0]) for place in self.needed) & _EVERY.keys()

    @cached_property
    def kinked(self) -> frozenset[str]:
        """Variables on which functions with kinks depend."""
        every = (self.instructions[place] for place in self.needed)
        used = tuple(place for one in every if one[0] in KINKED for place in operands(one))
        return frozenset(FormulaSystem(self.instructions, used).names)

    def constants(
        self, parameters: Mapping[str, float], variables: Collection[str]
    ) -> list[float] | None:
        """The values of all outputs by parameters, or None if one of the variables occurs.

        Raises
        ------
        ExpressionError
            If one of the values is not a finite number.
        """
        if not set(variables).isdisjoint(self.names):
            return None
        values = [float(one) for one in self.evaluate(parameters)]
        if not np.isfinite(values).all():
            raise ExpressionError("a derivative is constant, but not a finite real number")
        return values

    def __getitem__(self, which: slice) -> FormulaSystem:
        """The program of some outputs."""
        return FormulaSystem(self.instructions, self.outputs[which])

    def evaluate(
        self,
        values: Mapping[str, T | float],
        functions: Mapping[str, Callable[..., T]] | None = None,
    ) -> list[T | float]:
        """The values for given variables: arrays or numbers, one value per output.

        For other kinds of numbers, give the `functions` that occur. Integral exponents arrive
        as ``int``. Floating-point arithmetic never warns or raises here. Arrays broadcast; a
        value is a ``float`` where no variable takes part or all are numbers.

        Raises
        ------
        ExpressionError
            If the value of one of :attr:`names` is missing.
        """
        given = [value_of(name, values) for name in self.names]
        run = self.compiled if functions is None else self.compiled_with(functions)
        with np.errstate(all="ignore"):
            return cast(list[T | float], run(*given))

    @cached_property
    def compiled(self) -> Callable[..., list[Any]]:
        """The program as a function of values for each of :attr:`names`, without checks."""
        return self.compiled_with({})

    def compiled_with(self, functions: Mapping[str, Callable[..., T]]) -> Callable[..., list[Any]]:
        """The program with other functions in the place of NumPy's."""
        code = _compiled(_source(self))
        return FunctionType(code, {"__builtins__": {}, **_EVERY, **functions})

    def __getstate__(self) -> dict[str, object]:
        """What is pickled: the program, without the caches computed from it."""
        return {"instructions": self.instructions, "outputs": self.outputs}


def operands(instruction: Instruction) -> tuple[int, ...]:
    """Places of the operands of an instruction."""
    kind = instruction[0]
    if kind in ("number", "variable"):
        return ()
    return cast(tuple[int, ...], instruction[1:2] if kind == "**" else instruction[1:])


def _source(system: FormulaSystem) -> str:
    """The program as Python source, in which registers are used again when they are free."""
    last = {o: place for place in system.needed for o in operands(system.instructions[place])}
    last |= dict.fromkeys(system.outputs, len(system.instructions))
    names: dict[int, str] = {}
    parameters: list[str] = []
    free: list[str] = []
    lines: list[str] = []
    for place in system.needed:
        instruction = system.instructions[place]
        kind = instruction[0]
        if kind == "number":
            names[place] = f"({float(instruction[1])!r})"
        elif kind == "variable":
            names[place] = f"v{len(parameters)}"
            parameters.append(names[place])
        else:
            used = operands(instruction)
            text = _statement(instruction, [names[one] for one in used])
            free += [names[o] for o in set(used) if last[o] == place and names[o][0] == "r"]
            names[place] = free.pop() if free else f"r{len(lines)}"
            lines.append(f" {names[place]} = {text}\n")
    found = ", ".join(names[place] for place in system.outputs)
    return f"def formula({', '.join(parameters)}):\n{''.join(lines)} return [{found}]\n"


def _statement(instruction: Instruction, used: Sequence[str]) -> str:
    kind = str(instruction[0])
    if kind in OPERATORS:
        return f"{used[0]} {kind} {used[1]}"
    if kind == "negate":
        return f"-{used[0]}"
    if kind == "**":
        exponent = float(instruction[2])
        if exponent == 2.0:
            return f"square({used[0]})"
        is_whole = exponent.is_integer() and abs(exponent) < LARGEST_WHOLE_POWER
        if exponent in (3, 4):
            # power takes fifty times as long as products
            return " * ".join([used[0]] * int(exponent))
        return f"{used[0]} ** ({int(exponent) if is_whole else exponent!r})"
    if kind not in _EVERY:
        raise ExpressionError(f"{kind!r} is not a node of a formula")
    return f"{kind}({', '.join(used)})"


@functools.lru_cache(maxsize=1024)
def _compiled(source: str) -> CodeType:
    """The code of the one function in a source that :func:`_source` has written."""
    module = compile(source, "<formula>", "exec")
    return next(one for one in module.co_consts if isinstance(one, CodeType))


def compute(kind: str, values: Sequence[float]) -> float:
    """Value of an operator or function of numbers; it may be infinite or not a number."""
    # NumPy's numbers never raise and never turn complex; 9**9**9 overflows at once
    numbers = [np.float64(value) for value in values]
    if kind == "**" and values[1] == 2:
        kind, numbers = "square", numbers[:1]
    with np.errstate(all="ignore"):
        return float(_OF_NUMBERS[kind](*numbers))


class PointFormulas:
    """Fast evaluation of a program at many points.

    Floating-point errors are treated as the caller's ``np.errstate`` says.

    Variables are the names of the components of points. Parameters, the other names, are numbers or
    arrays that broadcast with a component: points ``(q, n, k)`` of q members go with ``(q, 1)``.
    """

    def __init__(
        self,
        system: FormulaSystem,
        variables: Sequence[str],
        parameters: Mapping[str, float | Array],
    ) -> None:
        places = {name: place for place, name in enumerate(variables)}
        self._given: list[Any] = [
            places[name] if name in places else value_of(name, parameters) for name in system.names
        ]
        self._run = system.compiled
        self._count = len(system.outputs)

    def __call__(self, *points: Array) -> Array:
        """The values ``(..., number of outputs)`` at points ``(..., k)``.

        Several arrays count as one array with the components of all.
        """
        components = [
            np.ascontiguousarray(one[..., index])
            for one in points
            for index in range(one.shape[-1])
        ]
        values = self._run(*[components[k] if type(k) is int else k for k in self._given])
        shape = points[0].shape[:-1]
        if self._count == 1:
            (only,) = values
            # an array with a base is a view of the points
            if isinstance(only, np.ndarray) and only.base is None and only.shape == shape:
                return only[..., None]
        found = np.empty((*shape, self._count))
        for index, value in enumerate(values):
            found[..., index] = value
        return found
