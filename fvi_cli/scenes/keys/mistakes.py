"""What pydantic finds wrong, in the words of a configuration."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from fvi_cli.errors import ArgumentError, excerpt, listed, suggestion
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError

KeyPath = tuple[str | int, ...]

_BRANCH: Final = re.compile(r"<\d+>|\[key\]")
"""What pydantic adds to places: the branch of a union, and that a key is meant."""
_NUMBER: Final = "; numbers have a decimal point, and no unit, quotes or names"


class Wrong(NamedTuple):
    """A mistake in a value: where below it, and what."""

    path: KeyPath
    message: str
    column: int | None = None  # where in a text, from 1
    of_key: bool = False  # the key should not be there; its place is meant, not that of its value


def refused(*found: Wrong) -> PydanticCustomError:
    """An error to raise in validators, with all mistakes."""
    return PydanticCustomError("wrong", "{message}", {"message": found[0].message, "found": found})


def wrong_argument(error: ValueError, *path: str | int) -> Wrong:
    """The error of a function, at the key path that it names below another one."""
    if isinstance(error, ExpressionError):
        return Wrong(path, error.message, error.column)
    if not isinstance(error, ArgumentError):
        return Wrong(path, str(error))
    inner = (int(part) if part.isdecimal() else part for part in error.path)
    return Wrong((*path, *inner), error.message, of_key=error.at_key)


def first_mistake(error: ValidationError) -> ArgumentError:
    """The first of the mistakes as an error of Python."""
    first = next(mistakes_of(error))
    return ArgumentError(".".join(map(str, first.path)), first.message, at_key=first.of_key)


def mistakes_of(error: ValidationError, model: type[BaseModel] | None = None) -> Iterator[Wrong]:
    """The mistakes in a value, or in the keys of a model and what they hold."""
    fields = getattr(model, "model_fields", {})
    known = {key_of(name, field): field.description or "" for name, field in fields.items()}
    for detail in error.errors(include_url=False):
        path = tuple(one for one in detail["loc"] if not _BRANCH.fullmatch(str(one)))
        for one in _mistakes(detail, known):
            yield one._replace(path=(*path, *one.path))


def _mistakes(detail: ErrorDetails, known: dict[str, str]) -> Iterator[Wrong]:
    """The mistakes in a value, relative to it; `known` are the keys with their descriptions."""
    value, kind, context = detail["input"], detail["type"], detail.get("ctx", {})
    if kind == "wrong":
        yield from context["found"]
    elif kind == "value_error":
        yield wrong_argument(context["error"])
    elif kind == "extra_forbidden":
        word = str(detail["loc"][-1])
        words = f"not known{suggestion(word, known)} (known here: {listed(known)})"
        yield Wrong((), words, of_key=True)
    elif kind == "missing":
        yield Wrong((), f"missing: {known[str(detail['loc'][-1])]}".rstrip(".: "))
    elif kind == "form" and context["key"] and isinstance(value, dict):
        expected = f"it must be {context['expected']}"
        given = value.get(context["key"])
        near = _near(given, context["expected"])
        found = f"{describe(given)} is not allowed" if context["key"] in value else "missing"
        yield Wrong((context["key"],), f"{found}; {expected}{near}")
    else:
        expected = re.sub(r"^\w+ should ", "", detail["msg"])
        if kind == "form":
            expected = f"be {context['expected']}"
        if kind.startswith("model"):
            expected = f"be a mapping with {listed(known)}"
        hint = _NUMBER if kind in ("float_type", "int_type") and isinstance(value, str) else ""
        hint = hint or (_near(value, expected) if "literal" in kind or kind == "form" else "")
        yield Wrong((), f"{describe(value)} is not allowed; it must {expected}{hint}")


def _near(value: Any, expected: str) -> str:
    """The nearest of the words that are allowed."""
    return suggestion(value, re.findall(r"[\w-]+", expected)) if isinstance(value, str) else ""


def key_of(name: str, field: Any) -> str:
    """The key of a field."""
    return field.alias or name


def describe(value: Any) -> str:
    """A value as it could be written, shortened."""
    return excerpt(json.dumps(value, default=str, ensure_ascii=False))


def number_text(value: float) -> str:
    """The shortest text of a number: ``8`` of 8 and of 8.0."""
    is_whole = math.isfinite(value) and abs(value) < 1e15 and value == int(value)
    return str(int(value)) if is_whole else repr(float(value))
