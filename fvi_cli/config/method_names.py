"""Methods by their names; what a name does not say is as in a configuration."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final, get_args

from fvi_cli.config.keys.methods import make_method
from fvi_cli.integrator.method import (
    BASELINE_NAMES,
    AnyMethod,
    Baseline,
    ForcingQuadrature,
    History,
    Sampling,
)

_FAMILY: Final = re.compile(
    r"bdf(?P<bdf>[1-6])|(?P<rk>gauss|radau-iia|lobatto-iiic)(?P<degree>\d*)"
)
_WORDS: Final[Mapping[str, tuple[str, ...]]] = {
    "sampling": get_args(Sampling),
    "start": ("none", "graded"),
    "forcing_quadrature": get_args(ForcingQuadrature),
    "history": get_args(History),
}
_NUMBERED: Final = re.compile(r"(s|gauss|lobatto)(\d+)")


def method_named(name: str) -> AnyMethod:
    """The method of a short name, or of the name that it has in files.

    Parameters
    ----------
    name
        ``bdf1`` to ``bdf6``; ``gauss``, ``radau-iia`` or ``lobatto-iiic`` with the degree, as in
        ``gauss3``; or a baseline. What is to be other than by default is joined by ``-``:
        ``nodes`` or ``points``, ``s2`` (the degree), ``gauss2`` or ``lobatto3`` (the rule),
        ``none`` or ``graded``, ``galerkin``, ``exact`` or ``projected``, ``direct``
        or ``exponentials``. ``bdf2-nodes``, ``gauss-s3-graded`` and ``Gauss3`` are such names.

    Raises
    ------
    ValueError
        For a name that says no method.
    """
    plain = name.strip().lower().replace(" ", "")
    if plain in BASELINE_NAMES:
        return Baseline(name=plain)
    values: dict[str, Any] = {}
    family = _FAMILY.match(plain)
    words = plain[family.end() :].split("-") if family else [""]
    if family is None or words[0]:
        raise ValueError(_no_method(name))
    if family["bdf"]:
        values["bdf"] = int(family["bdf"])
    else:
        values["rk"] = family["rk"]
        if family["degree"]:
            values["degree"] = int(family["degree"])
    for word in words[1:]:
        key, value = _entry_of(word)
        if not key or key in values:
            raise ValueError(_no_method(name))
        values[key] = value
    method, _ = make_method(values)
    return method


def _entry_of(word: str) -> tuple[str, Any]:
    """Key and value that a part of a name stands for; no key where it stands for none."""
    numbered = _NUMBERED.fullmatch(word)
    if numbered is None:
        return next((key for key, words in _WORDS.items() if word in words), ""), word
    what, number = numbered[1], int(numbered[2])
    return ("degree", number) if what == "s" else ("quadrature", {"rule": what, "points": number})


def _no_method(name: str) -> str:
    return (
        f"method: {name!r} is not the name of a method; such names are gauss3, radau-iia2, bdf2, "
        f"bdf2-nodes, bdf2-nodes-s1-gauss1-none, {', '.join(BASELINE_NAMES)}"
    )
