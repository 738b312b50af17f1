"""The page of all keys of a configuration, made from what checks them."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from types import UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from fvi_cli.config.models import ExperimentKeys
from fvi_cli.errors import listed
from fvi_cli.scenes.keys.mistakes import key_of
from fvi_cli.scenes.keys.values import Formula, OneOrMany

_HEAD: Final = """# Configuration, key by key

Made by `python docs/site/reference.py` from what checks configurations; for editors there is the
same as [JSON schema](../how-to/inputs.md#keys-completed-while-you-type). A key that is required is
so wherever its mapping is given. A file is one experiment, or has a `name` and a list `experiments`
of them.
"""
_BOUNDS: Final = {
    Gt: "above {0.gt}",
    Ge: "at least {0.ge}",
    Lt: "below {0.lt}",
    Le: "at most {0.le}",
}
_WORDS: Final = {
    float: "number",
    int: "integer",
    str: "text",
    bool: "true, false",
    Any: "any value",
}


def configuration_reference() -> str:
    """Every key of a configuration as a Markdown page: one table for every mapping."""
    lines = [_HEAD]
    waiting: list[type[BaseModel]] = [ExperimentKeys]
    shown: set[type[BaseModel]] = set()
    while waiting:
        model = waiting.pop(0)
        if model in shown:
            continue
        shown.add(model)
        lines += _table(model)
        inner = [
            one for name in _own(model) for one in _models(model.model_fields[name].annotation)
        ]
        waiting = [*inner, *_bases(model), *waiting]
    return "\n".join(lines)


def _bases(model: type[BaseModel]) -> list[type[BaseModel]]:
    return [one for one in model.__bases__ if getattr(one, "model_fields", {})]


def _own(model: type[BaseModel]) -> list[str]:
    """The fields that a model does not have from another one."""
    inherited = {name for base in _bases(model) for name in base.model_fields}
    declared = model.__annotations__
    return [name for name in model.model_fields if name not in inherited or name in declared]


def _title(model: type[BaseModel]) -> str:
    """What the page calls a mapping: the word that chooses it, or its name in words."""
    for name in ("kind", "law"):
        field = model.model_fields.get(name)
        if field is not None and get_origin(field.annotation) is Literal:
            return f"{name}: {get_args(field.annotation)[0]}"
    words = "".join(f" {c.lower()}" if c.isupper() else c for c in model.__name__.lstrip("_"))
    return words.removesuffix(" keys").removesuffix(" settings").strip()


def _table(model: type[BaseModel]) -> Iterator[str]:
    yield from (f"## {_title(model)}", "", inspect.getdoc(model) or "", "")
    if equation := getattr(model, "equation", ""):
        yield from (f"    {equation}", "")
    if bases := _bases(model):
        yield from (f"Also the keys of {listed(map(_words, bases))}.", "")
    yield from ("| key | may be | default | meaning |", "|---|---|---|---|")
    for name in _own(model):
        field = model.model_fields[name]
        extra = field.json_schema_extra
        unit = f" Unit: {extra['unit']}." if isinstance(extra, dict) else ""
        may_be = _words(Annotated[(field.annotation, *field.metadata, None)])
        cells = (f"`{key_of(name, field)}`", may_be, _default(field), f"{field.description}{unit}")
        yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"
    yield ""


def _default(field: Any) -> str:
    """The default as it would be written; of mappings, that they may be left out."""
    if field.default is PydanticUndefined:
        return "required"
    if field.default is None or isinstance(field.default, BaseModel):
        return "-"
    value = field.default
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _words(hint: Any) -> str:
    """What an annotation allows, in words."""
    if hint is Formula:
        return "number or expression"
    if get_origin(hint) is Annotated:
        inner, *marks = get_args(hint)
        bounds = [b for m in marks for b in (getattr(m, "metadata", None) or [m])]
        limits = [_BOUNDS[type(one)].format(one) for one in bounds if type(one) in _BOUNDS]
        is_many = any(isinstance(one, OneOrMany) for one in marks)
        text = f"{_words(get_args(inner)[0])}, or a list" if is_many else _words(inner)
        return f"{text} {' and '.join(limits)}" if limits else text
    if get_origin(hint) in (Union, UnionType):
        some = [_words(one) for one in get_args(hint) if one is not type(None)]
        return "; ".join(dict.fromkeys(some))
    if get_origin(hint) is Literal:
        return ", ".join(f"`{one}`" for one in get_args(hint))
    if get_origin(hint) is list:
        return f"list of ({_words(get_args(hint)[0])})"
    if get_origin(hint) is dict:
        return f"mapping to ({_words(get_args(hint)[1])})"
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        title = _title(hint)
        return f"[{title}](#{title.replace(': ', '-').replace(' ', '-')})"
    return _WORDS.get(hint, str(hint))


def _models(hint: Any) -> list[type[BaseModel]]:
    """The mappings inside of an annotation."""
    if isinstance(hint, type) and issubclass(hint, BaseModel):
        return [hint]
    return [model for one in get_args(hint) for model in _models(one)]
