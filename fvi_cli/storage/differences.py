"""The keys of a configuration in which two runs differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from fvi_cli.storage.digests import INPUT
from fvi_cli.studies.members import value_in_words

_CONFIG_KEYS = {
    "norm": "report.norm",
    "store_every": "store.every",
    "n_steps": "ladder.steps",
    "method.name": "method.baseline",
}
_ABSENT = object()


def changed_keys(old: Mapping[str, Any], new: Mapping[str, Any]) -> tuple[str, ...]:
    """The key paths of a configuration at which the specifications of two runs differ."""
    before, after = configured(old), configured(new)
    differing = [key for key in after if before.get(key, _ABSENT) != after[key]]
    return (*differing, *(key for key in before if key not in after))


def difference_in_words(base: Mapping[str, Any], own: Mapping[str, Any]) -> str:
    """``problem.stiffness = 2, report.norm = final``: values of `own` that `base` does not have."""
    values = configured(own)
    texts = [
        f"{key} = {value_in_words(values[key])}" if key in values else f"no {key}"
        for key in changed_keys(base, own)
    ]
    return ", ".join(texts)


def configured(specification: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a specification by the key paths of a configuration."""
    found: dict[str, Any] = {}
    for path, value in _leaves(specification):
        if path == "method.cq":
            family, _, number = str(value).partition("bdf")
            is_bdf = not family and number.isdecimal()
            found["method.bdf" if is_bdf else "method.rk"] = int(number) if is_bdf else value
        else:
            found[_CONFIG_KEYS.get(path, path).removesuffix(f".{INPUT}")] = value
    return found


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping) and value:
        for key, inner in value.items():
            yield from _leaves(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and value:
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{path}.{index}")
    else:
        yield path, value
