"""Names and keys of methods, their defaults, and the combinations that a mapping means."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, Final, Literal, get_args

from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.method import (
    BASELINE_NAMES,
    BDF_NAMES,
    EXAMPLES,
    RUNGE_KUTTA_NAMES,
    AnyMethod,
    ForcingQuadrature,
    Method,
    Sampling,
    Start,
    keys_of_name,
    make_method,
)
from fvi_cli.keys.containers import ByForm, ListOf, OneOrMany
from fvi_cli.keys.cursor import Cursor, is_complete
from fvi_cli.keys.nodes import MappingNode
from fvi_cli.keys.scalars import Choice, Integer, Number, Schema, Shape
from fvi_cli.keys.settings import Setting, key, record_of
from fvi_cli.mathematics.lagrange import LARGEST_DEGREE
from fvi_cli.mathematics.quadrature import LARGEST_RULE


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


MOST_METHODS: Final = 500
# names in a configuration for fields of Method that are called differently
_KEY_OF_FIELD: Final = {"start_exponents": "start"}


class Rule(Setting):
    """A quadrature rule."""

    rule: Literal["gauss", "lobatto"] = key("Family of the rule.")
    points: Annotated[int | None, Integer(least=1, most=LARGEST_RULE)] = key(
        "Number of points; default: degree for gauss, degree + 1 for lobatto.", default=None
    )


class Weights(Setting):
    """Starting weights."""

    weights: Annotated[
        tuple[float, ...], ListOf(shape=Number(least=0.0), most=20, example="[2.5]")
    ] = key("Exponents of t on which the corrected quadrature is exact.")


def _several(shape: Shape) -> OneOrMany:
    return OneOrMany(shape=shape, most=100)


_RULES: Final = ByForm(single=Choice(words=("gauss", "lobatto")), mappings=(record_of(Rule),))
_STARTS: Final = ByForm(
    single=Choice(words=("none", "graded")),
    mappings=(record_of(Weights),),
)
_REFUSED: Final = {
    "order": "not a key: write bdf for the order of the BDF; Gauss of degree m has order 2 m",
    "euler": "not a key: write baseline: explicit-euler or implicit-euler",
    "gauss": "not a key: write rk: gauss, degree: 3",
    "cq": "not a key: write bdf: 1 to 6, or rk: gauss",
}


class MethodKeys(Setting, refused=_REFUSED):
    """A method, or the combinations of several values."""

    bdf: Annotated[Any, _several(Integer(least=1, most=len(BDF_NAMES)))] = key(
        "Order of the BDF convolution quadrature.", default=None
    )
    rk: Annotated[Any, _several(Choice(words=RUNGE_KUTTA_NAMES))] = key(
        "Runge-Kutta convolution quadrature; `gauss` is the default when no family is given.",
        default=None,
    )
    baseline: Annotated[Any, _several(Choice(words=BASELINE_NAMES))] = key(
        "A method of another kind, for comparison; it takes no other key.",
        default=None,
    )
    sampling: Annotated[Any, _several(Choice(words=get_args(Sampling)))] = key(
        "Where the fractional action is sampled: nodes (the paper) or quadrature points.",
        default=None,
    )
    degree: Annotated[Any, _several(Integer(least=1, most=LARGEST_DEGREE))] = key(
        "Polynomial degree of the trajectory on a step. Default: ceil(p/2) for bdf: p, "
        "1 with sampling: nodes, 3 for rk.",
        default=None,
    )
    quadrature: Annotated[Any, _several(_RULES)] = key(
        "Rule for the action. Default: gauss with as many points as the degree.", default=None
    )
    start: Annotated[Any, _several(_STARTS)] = key(
        "What is done about a singular start; graded: steps behind it and behind break points "
        "are halved again and again (rk: gauss only). Default: graded for rk: gauss without "
        "ladder.grading, else none.",
        default=None,
    )
    forcing_quadrature: Annotated[Any, _several(Choice(words=get_args(ForcingQuadrature)))] = key(
        "How the forcing is integrated. Default: exact for bdf at points, else galerkin.",
        default=None,
    )


METHODS: Final = OneOrMany(
    shape=ByForm(single=MethodWord(), mappings=(record_of(MethodKeys),), name="Method")
)


@dataclass(frozen=True, kw_only=True)
class ListedMethod:
    """A method, and the cursor at its entry."""

    method: AnyMethod
    at: Cursor


def read_methods(
    given: object, at: Cursor, usual: Mapping[str, list[Any]], *, start: Start = "graded"
) -> list[ListedMethod]:
    """Every combination under ``method``; wrong ones are left out with a complaint."""
    if not at.has("method"):
        absent = MappingNode(place=at.node.place, entries={})
        here = replace(at, node=absent, path=(*at.path, "method"))
        return list(_combinations(usual, here, start))
    at = at.under("method")
    found: list[ListedMethod] = []
    read = given if isinstance(given, list) else []
    for values, entry in zip(read, at.items() or [at], strict=False):
        if isinstance(values, Mapping) and is_complete(values):
            found.extend(_combinations(values, entry, start))
    if len(found) > MOST_METHODS:
        at.refuse(f"{len(found)} methods in all; at most {MOST_METHODS} are allowed")
        return []
    cases: dict[str, ListedMethod] = {}
    for listed_method in found:
        case = listed_method.method.case
        if case in cases:
            listed_method.at.refuse(f"{case} is given twice")
        cases.setdefault(case, listed_method)
    return list(cases.values())


def _combinations(
    values: Mapping[str, list[Any]], at: Cursor, start: Start
) -> Iterator[ListedMethod]:
    count = math.prod(len(choices) for choices in values.values())
    if count > MOST_METHODS:
        at.refuse(f"{count} combinations; at most {MOST_METHODS} are allowed")
        return
    if not _is_coherent(values, at):
        return
    for indices in itertools.product(*(range(len(choices)) for choices in values.values())):
        chosen = dict(zip(values, indices, strict=True))
        try:
            method = make_method(
                {key: values[key][index] for key, index in chosen.items()}, start=start
            )
        except ArgumentError as error:
            _complain(error, chosen, at)
            continue
        yield ListedMethod(method=method, at=at)


def _is_coherent(values: Mapping[str, list[Any]], at: Cursor) -> bool:
    """Whether the keys belong to one family of methods."""
    before = len(at.complaints)
    families = [key for key in ("bdf", "rk", "baseline") if key in values]
    for extra in families[1:]:
        at.refuse_key(
            extra, f"not together with {families[0]}; write two list entries under method"
        )
    if families == ["baseline"]:
        for key in values:
            if key != "baseline":
                at.refuse_key(key, "a baseline takes no other key")
    return len(at.complaints) == before


def _complain(error: ArgumentError, chosen: Mapping[str, int], at: Cursor) -> None:
    """Add the complaint of a method at its key."""
    key = _KEY_OF_FIELD.get(error.key, error.key)
    if key == "cq":
        key = "rk" if "rk" in chosen else "bdf"
    if key in chosen:
        at.under(key, chosen[key]).refuse(error.message)
    else:
        at.refuse(error.message, key)


def objection_to_grading(method: AnyMethod) -> str:
    """Why a method needs equal steps, and what to do; empty if it does not."""
    if not isinstance(method, Method) or method.cq != "gauss":
        return f"{method.label} needs equal steps; leave grading out, or use rk: gauss"
    if method.start == "graded":
        return f"{method.label} makes its own mesh; leave grading out, or give start: none"
    return ""
