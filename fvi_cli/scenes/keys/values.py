"""Mappings of configurations as models, types of single values, and unions.

A plain union of pydantic tries all its branches and reports the mistakes of each. :class:`ByForm`
and :class:`ByWord` choose one branch from the value, so that every mistake is told once.
"""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import UnionType
from typing import Annotated, Any, Literal, Self, TypeVar, Union, get_args, get_origin

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ModelWrapValidatorHandler,
    PlainValidator,
    ValidationError,
    model_validator,
)
from pydantic_core import core_schema

from fvi_cli.effects.matrices import symmetric_form
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.expressions import CONSTANTS, FUNCTION_NAMES, Expression
from fvi_cli.scenes.keys.mistakes import (
    KeyPath,
    Wrong,
    key_of,
    mistakes_of,
    number_text,
    refused,
    wrong_argument,
)

T = TypeVar("T")
WORD = r"^[A-Za-z]\w*$"


class Keys(BaseModel):
    """A mapping with known keys; numbers are finite, and no value is converted to another type."""

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, defer_build=True, allow_inf_nan=False
    )

    def mistakes(self) -> Iterator[Wrong]:
        """What is wrong between keys that are all right by themselves."""
        return iter(())

    @model_validator(mode="wrap")
    @classmethod
    def _check(cls, value: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        try:
            model = handler(value)
            found = list(model.mistakes())
        except ValidationError as error:
            found = list(mistakes_of(error, cls))
        if found:
            raise refused(*found)
        return model


def plain(model: BaseModel) -> dict[str, Any]:
    """The JSON values of a model with its defaults; what is None is left out."""
    return model.model_dump(by_alias=True, exclude_none=True, warnings="none")


def key(description: str, default: Any = ..., *, unit: str = "", **limits: Any) -> Any:
    """A key of a mapping.

    Parameters
    ----------
    description
        What it means, for the page of keys and for editors.
    default
        Its value where it is not given; a key without one is required.
    unit
        The unit of the value, in words.
    **limits
        Of pydantic's ``Field``, such as ``gt=0``.
    """
    extra: Any = {"unit": unit} if unit else None
    return Field(default, description=description, json_schema_extra=extra, **limits)


def from_key(description: str, default: Any = ...) -> Any:
    """The key ``from``, which is no name in Python."""
    return Field(default, description=description, alias="from")


def keys_of(model: Any) -> list[str]:
    """The keys of a model; none of anything else."""
    fields = getattr(model, "model_fields", {})
    return [key_of(name, field) for name, field in fields.items()]


def _union(
    branches: Iterable[Any], choose: Callable[[Any], int], expected: str, key_name: str = ""
) -> Any:
    """A union of which one branch is tried, that with the chosen number; -1: none."""
    return core_schema.tagged_union_schema(
        {f"<{number}>": branch for number, branch in enumerate(branches)},
        # values that are written are models, those that are read are not
        discriminator=lambda one: None if isinstance(one, BaseModel) else f"<{choose(one)}>",
        custom_error_type="form",
        custom_error_message="{expected}",
        custom_error_context={"expected": expected, "key": key_name},
    )


class ByForm:
    """Chooses a branch of a union by the form of the value: one value, a list or a mapping.

    Among several models of mappings, the one that shares most keys with the value is chosen.
    """

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        branches = get_args(source)
        forms = [form_of(one) for one in branches]

        def choose(value: Any) -> int:
            form = type(value) if type(value) in (list, dict, *forms) else None
            fitting = [number for number, one in enumerate(forms) if one is form]
            if form is dict and len(fitting) > 1:
                shared = [len({*keys_of(branches[n])} & value.keys()) for n in fitting]
                return fitting[shared.index(max(shared))] if any(shared) else -1
            return fitting[0] if fitting else -1

        expected = " or ".join(dict.fromkeys(map(in_words, branches)))
        return _union(map(handler.generate_schema, branches), choose, expected)


class ByWord:
    """Chooses a model by the word under a key."""

    def __init__(self, key_name: str, *, usual: str = "") -> None:
        self.key_name, self.usual = key_name, usual

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        branches = get_args(source)
        words = [word_of(one, self.key_name) for one in branches]

        def choose(value: Any) -> int:
            is_mapping = isinstance(value, Mapping)
            word = value.get(self.key_name, self.usual) if is_mapping else None
            return words.index(word) if word in words else -1

        models = map(handler.generate_schema, branches)
        return _union(models, choose, ", ".join(words), self.key_name)


class OneOrMany:
    """Marks a list that may be written as its single entry."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> Any:
        several = handler(source)
        entry = handler.generate_schema(get_args(source)[0])
        alone = core_schema.no_info_after_validator_function(lambda one: [one], entry)
        return _union([alone, several], lambda value: int(isinstance(value, list)), "")


BY_FORM, ONE_OR_MANY = ByForm(), OneOrMany()


def word_of(model: type[BaseModel], key_name: str) -> str:
    """The word that a key of a model must be."""
    return str(get_args(model.model_fields[key_name].annotation)[0])


def form_of(branch: Any) -> type | None:
    """``list``, ``dict`` or, of words, ``str``; None of numbers and formulas."""
    if branch == Formula:
        return None
    while get_origin(branch) in (Annotated, Union, UnionType):
        branch = get_args(branch)[0]
    if isinstance(branch, type) and issubclass(branch, BaseModel):
        return dict
    origin = get_origin(branch)
    if origin is Literal or branch is str:
        return str
    return origin if origin in (list, dict) else None


def in_words(branch: Any) -> str:
    """A branch of a union in words that continue *it must be*."""
    form = form_of(branch)
    if form is dict:
        return f"a mapping with {', '.join(keys_of(branch)) or 'names'}"
    if get_origin(branch) is Literal:
        return " or ".join(get_args(branch))
    number = "a number or an expression" if branch == Formula else "a number"
    return "a list" if form is list else "a text" if form is str else number


_NAMES = re.compile(r"(?<![\w.])[A-Za-z_]\w*(?!\w*\s*\()")


def _formula(value: Any) -> str:
    """The text of a formula, or of a number; which names it may hold is checked elsewhere."""
    if type(value) in (int, float) and math.isfinite(value):
        return number_text(value)
    if not isinstance(value, str):
        raise ValueError("it must be a finite number or an expression")
    Expression.parse(value, tuple(sorted(names_in(value))))
    return value


@functools.lru_cache(maxsize=1024)
def names_in(formula: str) -> frozenset[str]:
    """The names in a formula, without functions and constants."""
    return frozenset(_NAMES.findall(formula)) - FUNCTION_NAMES - CONSTANTS.keys()


def wrong_formula(path: KeyPath, formula: str, names: Iterable[str]) -> Iterator[Wrong]:
    """The mistake in a formula that may hold these names, if it has one."""
    try:
        Expression.parse(formula, tuple(names))
    except ExpressionError as error:
        yield wrong_argument(error, *path)


def _symmetric(value: list[list[float]]) -> list[list[float]]:
    symmetric_form(value, "")
    return value


def _increasing(value: list[Any]) -> list[Any]:
    for number in range(1, len(value)):
        if not value[number] > value[number - 1]:
            message = f"{value[number]:g} is not greater than {value[number - 1]:g} before it"
            raise ArgumentError(str(number), message)
    return value


Formula = Annotated[str, PlainValidator(_formula, json_schema_input_type=float | str)]
FormulaOrMany = Annotated[Formula | list[Formula], BY_FORM]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(gt=0, lt=1)]
Order = Annotated[float, Field(gt=0, lt=2)]
Count = Annotated[int, Field(ge=1, le=1000)]
Name = Annotated[str, Field(pattern=WORD)]
Pair = Annotated[list[T], Field(min_length=2, max_length=2)]
Matrix = Annotated[list[list[float]], Field(min_length=1), AfterValidator(_symmetric)]
Increasing = Annotated[list[T], Field(min_length=1), AfterValidator(_increasing)]


class Range(Keys):
    """Equally spaced numbers, or numbers with equal ratios."""

    from_: float = from_key("The first number.")
    to: float = key("The last number.")
    number: int = key("How many, both ends included.", ge=2, le=100_000)
    spacing: Literal["linear", "log"] = key("Equal distances, or equal ratios.", "linear")

    def mistakes(self) -> Iterator[Wrong]:
        """Ends that are equal, too large, or have no logarithm."""
        if self.from_ == self.to:
            yield Wrong(("to",), f"{self.to:g} is the same as from")
        for name, value in (("from", self.from_), ("to", self.to)):
            if self.spacing == "log" and value <= 0:
                message = f"{value:g} is not allowed with spacing: log; it must be greater than 0"
                yield Wrong((name,), message)

    def values(self) -> list[float]:
        """The numbers; the first and the last are exactly ``from`` and ``to``."""
        spaced = np.linspace if self.spacing == "linear" else np.geomspace
        return [float(one) for one in spaced(self.from_, self.to, self.number)]
