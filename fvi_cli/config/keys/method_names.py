"""Names of methods, in configurations as in Python."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, get_args

from fvi_cli.integrator.method import (
    BASELINE_NAMES,
    ForcingQuadrature,
    History,
    Sampling,
)
from fvi_cli.keys.complaints import excerpt, suggestion
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Schema, Shape
from fvi_cli.mathematics.lagrange import LARGEST_DEGREE

EXAMPLES: Final = "gauss3, radau-iia2, bdf2, bdf2-nodes"
_FAMILY: Final = re.compile(
    r"bdf-?(?P<bdf>[1-6])|(?:(?P<gauss>gauss)|(?P<radau>radau(?:-?iia)?)|lobatto(?:-?iiic)?)"
    r"(?:-?(?P<degree>\d{1,3}))?"
)
_WORDS: Final[Mapping[str, tuple[str, ...]]] = {
    "sampling": get_args(Sampling),
    "start": ("none", "graded"),
    "forcing_quadrature": get_args(ForcingQuadrature),
    "history": get_args(History),
}
_NUMBERED: Final = re.compile(r"(s|gauss|lobatto)(\d{1,3})")


def keys_of_name(name: str) -> dict[str, Any]:
    """Keys of a method, with their values, that its name stands for.

    Raises
    ------
    ValueError
        For a name that says no method.
    """
    words_of = re.sub(r"[\s_]+", "-", name.strip().lower())
    if words_of in BASELINE_NAMES:
        return {"baseline": words_of}
    plain = re.sub(r"[\s_]", "", name.lower())
    family = _FAMILY.match(plain)
    words = plain[family.end() :].split("-") if family else [""]
    if family is None or words[0]:
        raise ValueError(_no_method(name))
    values: dict[str, Any] = {}
    if family["bdf"]:
        values["bdf"] = int(family["bdf"])
    else:
        short = "gauss" if family["gauss"] else "radau-iia" if family["radau"] else "lobatto-iiic"
        values["rk"] = short
        if family["degree"]:
            values["degree"] = int(family["degree"])
    for word in words[1:]:
        key, value = _entry_of(word)
        if not key or key in values:
            raise ValueError(_no_method(name))
        values[key] = value
    if not 1 <= values.get("degree", 1) <= LARGEST_DEGREE:
        raise ValueError(f"the degree in {excerpt(name)!r} must be from 1 to {LARGEST_DEGREE}")
    return values


def _entry_of(word: str) -> tuple[str, Any]:
    """Key and value that a part of a name stands for; no key where it stands for none."""
    numbered = _NUMBERED.fullmatch(word)
    if numbered is None:
        return next((key for key, words in _WORDS.items() if word in words), ""), word
    what, number = numbered[1], int(numbered[2])
    return ("degree", number) if what == "s" else ("quadrature", {"rule": what, "points": number})


def _no_method(name: str) -> str:
    if re.fullmatch(r"(?i)bdf-?\d+", name.strip()):
        return f"{excerpt(name)!r} is not the name of a method; there are bdf1 to bdf6"
    near = suggestion(name, (*BASELINE_NAMES, "gauss3", "radau-iia2", "lobatto-iiic2", "bdf2"))
    return (
        f"{excerpt(name)!r} is not the name of a method{near} (such names are {EXAMPLES}, "
        f"bdf2-nodes-s1-gauss1-none, {', '.join(BASELINE_NAMES)})"
    )


@dataclass(frozen=True, kw_only=True)
class MethodWord(Shape):
    """The name of a method, read as its keys."""

    expected: str = f"the name of a method, such as {EXAMPLES}"

    def read(self, at: Cursor) -> Any:
        """Every key with a list of one value."""
        if not isinstance(at.scalar, str):
            return at.needs(self.expected)
        try:
            return {key: [value] for key, value in keys_of_name(at.scalar).items()}
        except ValueError as error:
            return at.refuse(str(error))

    def schema(self, defs: Schema) -> Schema:
        """The shape in JSON schema."""
        return {"type": "string", "examples": EXAMPLES.split(", ")}
