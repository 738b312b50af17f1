"""Methods by their names, and by the keys that these stand for."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, Final, get_args

from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.method import (
    BASELINE_NAMES,
    BDF_NAMES,
    AnyMethod,
    Baseline,
    ForcingQuadrature,
    Method,
    RuleSpecification,
    Sampling,
    Start,
)
from fvi_cli.keys.complaints import excerpt, suggestion
from fvi_cli.mathematics.lagrange import LARGEST_DEGREE

EXAMPLES: Final = "gauss3, bdf2, bdf2-nodes"
_FAMILY: Final = re.compile(
    r"bdf-?(?P<bdf>[1-6])|(?:(?P<gauss>gauss)|lobatto(?:-?iiic)?)"
    r"(?:-?(?P<degree>\d{1,3}))?"
)
_WORDS: Final[Mapping[str, tuple[str, ...]]] = {
    "sampling": get_args(Sampling),
    "start": ("none", "graded"),
    "forcing_quadrature": get_args(ForcingQuadrature),
}
_NUMBERED: Final = re.compile(r"(s|gauss|lobatto)(\d{1,3})")


def method_named(name: str) -> AnyMethod:
    """The method of a short name, or of the name that it has in files.

    ``bdf1`` to ``bdf6``; ``gauss`` or ``lobatto-iiic`` with the degree, as in ``gauss3``; or a
    baseline. What differs from the defaults is joined by ``-``: ``nodes`` or ``points``, ``s2``
    (the degree), ``gauss2`` or ``lobatto3`` (the rule), ``none`` or ``graded``, ``galerkin`` or
    ``exact``. ``bdf2-nodes``, ``gauss-s3-graded`` and ``Gauss3`` are such names.

    Raises
    ------
    ValueError
        For a text that is not the name of a method.
    """
    try:
        values = keys_of_name(name)
    except ValueError as error:
        raise ValueError(f"method: {error}") from None
    return make_method(values)[0]


def as_method(method: AnyMethod | str) -> AnyMethod:
    """A method, also by its name (:func:`method_named`)."""
    if isinstance(method, Method | Baseline):
        return method
    if not isinstance(method, str):
        raise TypeError(
            f"method: {excerpt(repr(method))} is no method; write a name such as 'gauss3'"
        )
    return method_named(method)


def keys_of_name(name: str) -> dict[str, Any]:
    """Keys of a method, with their values, that its name stands for."""
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
        values["rk"] = "gauss" if family["gauss"] else "lobatto-iiic"
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
    """Key and value that a part of a name stands for; an empty key if there is none."""
    numbered = _NUMBERED.fullmatch(word)
    if numbered is None:
        return next((key for key, words in _WORDS.items() if word in words), ""), word
    what, number = numbered[1], int(numbered[2])
    return ("degree", number) if what == "s" else ("quadrature", {"rule": what, "points": number})


def _no_method(name: str) -> str:
    if re.fullmatch(r"(?i)bdf-?\d+", name.strip()):
        return f"{excerpt(name)!r} is not the name of a method; there are bdf1 to bdf6"
    number = re.search(r"[1-6]", name)
    # as tables write it: BDF2 points, degree 1
    sampled = re.match(r"(?i)bdf([1-6])[- ]?(node|point)", name.strip())
    if sampled:
        meant = f"bdf{sampled[1]}" + "-nodes" * (sampled[2].lower() == "node")
        return f"{excerpt(name)!r} is not the name of a method; write {meant}"
    degree = number[0] if number else "3"
    families = (f"{one}{degree}" for one in ("gauss", "lobatto-iiic", "bdf"))
    near = suggestion(name, (*BASELINE_NAMES, *families))
    return (
        f"{excerpt(name)!r} is not the name of a method{near} (such names are {EXAMPLES}, "
        f"bdf2-nodes-s1-gauss1-none, {', '.join(BASELINE_NAMES)})"
    )


def make_method(
    values: Mapping[str, Any], *, usual_start: Start = "graded"
) -> tuple[AnyMethod, dict[str, Any]]:
    """The method with its defaults, and the keys that define it in full.

    `usual_start` is the default start of Runge-Kutta methods.
    """
    if "baseline" in values:
        return Baseline(name=values["baseline"]), {"baseline": values["baseline"]}
    sampling = values.get("sampling", "points")
    resolved: dict[str, Any]
    if "bdf" in values:
        order, nodes = values["bdf"], sampling == "nodes"
        cq, resolved = BDF_NAMES[order - 1], {"bdf": order}
        degree = values.get("degree", 1 if nodes else math.ceil(order / 2))
        usual_start, usual_quadrature = "none", "galerkin" if nodes else "exact"
    else:
        cq = values.get("rk", "gauss")
        resolved = {"rk": cq}
        degree = values.get("degree", 3)
        usual_start, usual_quadrature = usual_start if cq == "gauss" else "none", "galerkin"
    start = values.get("start", usual_start)
    exponents: tuple[float, ...] = ()
    if start == "graded" and cq != "gauss":
        raise ArgumentError("start", "graded is for rk: gauss only; use none")
    if isinstance(start, Mapping):
        exponents, start = tuple(start["weights"]), "weights"
        if len(set(exponents)) != len(exponents):
            raise ArgumentError("start", "every exponent must be given once")
    rule = values.get("quadrature")
    if rule is not None:
        given: Mapping[str, Any] = {"rule": rule} if isinstance(rule, str) else rule
        points = given.get("points") or degree + (given["rule"] == "lobatto")
        rule = RuleSpecification(rule=given["rule"], points=points)
    method = Method(
        cq=cq,
        degree=degree,
        quadrature=rule,
        sampling=sampling,
        start=start,
        start_exponents=exponents,
        forcing_quadrature=values.get("forcing_quadrature", usual_quadrature),
    )
    resolved["degree"] = degree
    if "bdf" in values:
        resolved["sampling"] = sampling
        resolved["quadrature"] = {"rule": method.rule.rule, "points": method.rule.points}
    resolved["start"] = {"weights": list(exponents)} if exponents else start
    resolved["forcing_quadrature"] = method.forcing_quadrature
    return method, resolved
