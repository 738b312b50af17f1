"""What pydantic finds wrong, in the words of a configuration."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from types import UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from fvi_cli.errors import ArgumentError, excerpt, listed, suggestion
from fvi_cli.scenes.keys.advice import KEYS, VALUES
from fvi_cli.scenes.keys.values import (
    WORD,
    ByForm,
    KeyPath,
    OneOrMany,
    Wrong,
    in_words,
    key_of,
    known_keys,
    number_text,
)

_NUMBER: Final = "; numbers have a decimal point, and no unit, quotes or names"
_TYPES: Final[Mapping[str, str]] = {
    "list_type": "a list",
    "dict_type": "a mapping",
    "string_type": "a text",
    "bool_type": "true or false",
    "int_type": "an integer",
    "int_from_float": "an integer",
    "float_type": "a number",
    "finite_number": "a finite number",
}
_PATTERNS: Final[Mapping[str, str]] = {
    WORD: "letters, digits and _, beginning with a letter",
    r"^problem\.": "a key of the problem, such as problem.stiffness",
}


def mistakes_of(error: ValidationError, value: Any, model: Any) -> Iterator[Wrong]:
    """The mistakes in a value that was validated against a model."""
    for detail in error.errors(include_url=False):
        yield from _mistakes(detail, value, model)


def first_mistake(error: ValidationError, value: Any, model: Any) -> ArgumentError:
    """The first of the mistakes as an error of Python."""
    first = next(mistakes_of(error, value, model))
    return ArgumentError(".".join(map(str, first.path)), first.message, at_key=first.of_key)


def _mistakes(detail: ErrorDetails, whole: Any, model: Any) -> Iterator[Wrong]:
    path, value, kind = key_path(detail["loc"], whole), detail["input"], detail["type"]
    context = detail.get("ctx", {})
    if kind == "wrong":
        for one in context["found"]:
            yield one._replace(path=key_path((*path, *one.path), whole))
    elif kind == "value_error" and isinstance(raised := context["error"], ArgumentError):
        inner = (int(part) if part.isdecimal() else part for part in raised.path)
        yield Wrong((*path, *inner), raised.message, of_key=raised.at_key)
    elif kind == "value_error":
        yield Wrong(path, str(context["error"]))
    elif kind == "extra_forbidden":
        yield Wrong(path, _about_key(path, model, whole), of_key=True)
    elif kind in ("too_short", "too_long"):
        least, most = context.get("min_length"), context.get("max_length")
        bound = f"at most {most}" if kind == "too_long" else f"at least {least}"
        noun = "entry" if (most if kind == "too_long" else least) == 1 else "entries"
        yield Wrong(path, f"it must have {bound} {noun}, not {context['actual_length']}")
    elif kind == "missing":
        about = _meaning(hint_at(model, path, whole))
        yield Wrong(path, f"missing{f': {about}' if about else ''}")
    elif kind == "form" and context["key"] and isinstance(value, dict):
        word = value.get(context["key"])
        expected = f"it must be {context['expected']}"
        at = (*path, context["key"])
        if context["key"] in value:
            yield Wrong(at, f"{describe(word)} is not allowed; {expected}{_near(word, expected)}")
        else:
            yield Wrong(at, f"missing; {expected}")
    else:
        expected = _expected(detail, path, model, whole)
        shown = describe(value)
        hint = _NUMBER if kind in ("float_type", "int_type") and isinstance(value, str) else ""
        hint = hint or (_near(value, expected) if "literal" in kind or kind == "form" else "")
        yield Wrong(path, f"{shown} is not allowed; it must be {expected}{hint}")


def _expected(detail: ErrorDetails, path: KeyPath, model: Any, whole: Any) -> str:
    """What is allowed, in words."""
    kind, context = detail["type"], detail.get("ctx", {})
    if kind == "form":
        return str(context["expected"])
    if kind == "literal_error":
        others = _other_forms(hint_at(model, path, whole))
        return ", or ".join([context["expected"], *others])
    if kind.startswith("model"):
        hint = branch(hint_at(model, path, whole), {})
        return f"a mapping with {listed(known_keys(hint))}"
    if kind == "string_pattern_mismatch":
        return _PATTERNS.get(context["pattern"], "letters, digits, - and _")
    if kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal"):
        return re.sub(r"^Input should be", "a number", detail["msg"])
    message = re.sub(
        r"^(Input|String|List|Dictionary|Value) should (be |have |)", "", detail["msg"]
    )
    return _TYPES.get(kind, message)


def _other_forms(hint: Any) -> list[str]:
    """What is allowed beside words where a value may have one of several forms."""
    inner, *marks = get_args(hint) or (None,)
    if not any(isinstance(one, ByForm) for one in marks):
        return []
    return [in_words(one) for one in get_args(inner) if get_origin(one) is not Literal]


def key_path(location: KeyPath, value: Any) -> KeyPath:
    """A location of pydantic without the branches of unions and the numbers of single entries."""
    path: list[str | int] = []
    for part in location:
        if isinstance(part, str) and (part == "[key]" or re.fullmatch(r"<\d+>", part)):
            continue
        if isinstance(part, int) and isinstance(value, dict | str | int | float | bool):
            continue
        path.append(part)
        value = inside(value, part)
    return tuple(path)


def inside(value: Any, part: str | int) -> Any:
    """The value under a key or number; None where there is none."""
    if isinstance(value, dict):
        return value.get(part)
    is_there = isinstance(value, list) and isinstance(part, int) and part < len(value)
    return value[part] if is_there else None


def hint_at(model: Any, path: KeyPath, value: Any) -> Any:
    """The annotation of what stands at a key path of a value; None where there is none."""
    hint = model
    for part in path:
        hint = branch(hint, value)
        if isinstance(hint, type) and issubclass(hint, BaseModel):
            fields = {key_of(name, field): field for name, field in hint.model_fields.items()}
            field = fields.get(str(part))
            if field is None:
                return None
            hint = Annotated[(field.annotation, *field.metadata, field.description or "")]
        elif get_origin(hint) in (list, dict):
            hint = get_args(hint)[-1]
        else:
            return None
        value = inside(value, part)
    return hint


def branch(hint: Any, value: Any) -> Any:
    """What an annotation means for a value: a model, a list, or a mapping."""
    if get_origin(hint) is Annotated:
        inner, *marks = get_args(hint)
        chooser = next((one for one in marks if isinstance(one, ByForm)), None)
        if chooser is not None:
            number = chooser.choose(get_args(inner), value)
            return None if number < 0 else branch(get_args(inner)[number], value)
        if any(isinstance(one, OneOrMany) for one in marks) and not isinstance(value, list):
            return branch(get_args(inner)[0], value)
        return branch(inner, value)
    if get_origin(hint) in (Union, UnionType):
        some = [one for one in get_args(hint) if one is not type(None)]
        return branch(some[0], value) if len(some) == 1 else None
    return hint


def _about_key(path: KeyPath, model: Any, value: Any) -> str:
    """What to do about a key that is not known."""
    word = str(path[-1])
    outer = value
    for part in path[:-1]:
        outer = inside(outer, part)
    known = known_keys(branch(hint_at(model, path[:-1], value), outer))
    parents = [one for one in path[:-1] if isinstance(one, str)]
    advice = KEYS.get(f"{parents[-1] if parents else ''}.{word}") or KEYS.get(word)
    if advice and not (advice.startswith("write ") and advice.split()[1].strip(",:") not in known):
        return f"not a key here: {advice}"
    return f"not known{suggestion(word, known)} (known here: {listed(known)})"


def _meaning(hint: Any) -> str:
    """The description of a key, which is the last of its marks."""
    marks = get_args(hint)
    return next((one.rstrip(".") for one in reversed(marks) if isinstance(one, str)), "")


def _near(value: Any, expected: str) -> str:
    """Advice about a word that is not allowed."""
    if not isinstance(value, str):
        return ""
    word = re.sub(r"[\s_]+", "-", value.strip().lower())
    if advice := VALUES.get(word):
        return f"; {advice}"
    return suggestion(word, re.findall(r"[\w-]+", expected))


def describe(value: Any) -> str:
    """A value in words."""
    if value is None:
        return "an empty value"
    if isinstance(value, dict):
        return f"a mapping with {excerpt(listed(map(str, value)))}" if value else "an empty mapping"
    if isinstance(value, list):
        return "a list"
    if isinstance(value, bool):
        return str(value).lower()
    return f"the text {excerpt(value)!r}" if isinstance(value, str) else number_text(value)
