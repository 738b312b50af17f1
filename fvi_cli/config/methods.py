"""Keys of methods, their names, and the combinations that lists in them mean."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Final, Literal, TypeVar

from pydantic import AfterValidator, Field

from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.method import (
    EXAMPLES,
    AnyMethod,
    ForcingQuadrature,
    Sampling,
    Start,
    make_method,
    method_named,
)
from fvi_cli.mathematics.lagrange import LARGEST_DEGREE
from fvi_cli.mathematics.quadrature import LARGEST_RULE
from fvi_cli.scenes.keys.mistakes import Wrong, refused
from fvi_cli.scenes.keys.values import BY_FORM, ONE_OR_MANY, Keys, NotNegative, key, plain

T = TypeVar("T")
MOST_METHODS: Final = 500
FAMILIES: Final = ("bdf", "rk", "baseline")


class Rule(Keys):
    """A quadrature rule."""

    rule: Literal["gauss", "lobatto"] = key("Family of the rule.")
    points: Annotated[int, Field(ge=1, le=LARGEST_RULE)] | None = key(
        "Number of points; default: degree for gauss, degree + 1 for lobatto.", None
    )


class Weights(Keys):
    """Starting weights."""

    weights: list[NotNegative] = key(
        "Exponents of t on which the corrected quadrature is exact.", min_length=1, max_length=20
    )


Many = Annotated[list[T], Field(min_length=1, max_length=100), ONE_OR_MANY]
AnyRule = Annotated[Literal["gauss", "lobatto"] | Rule, BY_FORM]
AnyStart = Annotated[Literal["none", "graded"] | Weights, BY_FORM]


class MethodKeys(Keys):
    """A method, or the combinations of several values."""

    bdf: Many[Annotated[int, Field(ge=1, le=6)]] | None = key(
        "Order of the BDF convolution quadrature.", None
    )
    rk: Many[Literal["gauss", "lobatto-iiic"]] | None = key(
        "Runge-Kutta convolution quadrature; gauss is the default when no family is given.", None
    )
    baseline: (
        Many[
            Literal["explicit-euler", "implicit-euler", "gruenwald-letnikov", "product-integration"]
        ]
        | None
    ) = key("A method of another kind, for comparison; it takes no other key.", None)
    degree: Many[Annotated[int, Field(ge=1, le=LARGEST_DEGREE)]] | None = key(
        "Polynomial degree of the trajectory on a step. Default: ceil(p/2) for bdf: p, 1 with "
        "sampling: nodes, 3 for rk.",
        None,
    )
    sampling: Many[Sampling] | None = key(
        "Where the fractional action is sampled: nodes (the paper) or quadrature points.", None
    )
    quadrature: Many[AnyRule] | None = key(
        "Rule for the action. Default: gauss with as many points as the degree.", None
    )
    start: Many[AnyStart] | None = key(
        "What is done about a singular start; graded: steps behind it and behind break points are "
        "halved again and again (rk: gauss only). Default: graded for rk: gauss without "
        "ladder.grading, else none.",
        None,
    )
    forcing_quadrature: Many[ForcingQuadrature] | None = key(
        "How the forcing is integrated. Default: exact for bdf at points, else galerkin.", None
    )

    def mistakes(self) -> Iterator[Wrong]:
        """Keys of two families, and combinations that make no method."""
        given = [name for name, values in self if values is not None]
        families = [name for name in FAMILIES if name in given]
        for other in families[1:]:
            message = f"not together with {families[0]}; write two list entries under method"
            yield Wrong((other,), message, of_key=True)
        for name in given if families == ["baseline"] else ():
            if name != "baseline":
                yield Wrong((name,), "a baseline takes no other key", of_key=True)
        number = math.prod(len(values) for _, values in self if values is not None)
        if number > MOST_METHODS:
            yield Wrong((), f"{number} combinations; at most {MOST_METHODS} are allowed")
            return
        for combination in self.combinations() if len(families) < 2 else ():
            try:
                make_method(combination)
            except ArgumentError as error:
                name = {"start_exponents": "start", "cq": "rk"}.get(error.key, error.key)
                yield Wrong((name,), error.message)

    def combinations(self) -> Iterator[dict[str, Any]]:
        """Every combination of the given values."""
        given = {
            name: [plain(one) if isinstance(one, Keys) else one for one in values]
            for name, values in self
            if values is not None
        }
        for values in itertools.product(*given.values()):
            yield dict(zip(given, values, strict=True))


def _check_name(name: str) -> str:
    try:
        method_named(name)
    except ValueError as error:
        raise refused(Wrong((), str(error))) from None
    return name


MethodWord = Annotated[str, AfterValidator(_check_name), Field(examples=EXAMPLES.split(", "))]
Methods = Annotated[
    list[Annotated[MethodWord | MethodKeys, BY_FORM]], Field(min_length=1), ONE_OR_MANY
]


def methods_of(given: Sequence[str | MethodKeys], start: Start) -> Iterator[tuple[int, AnyMethod]]:
    """Every combination under ``method``, with the number of its entry.

    `start` is that of Gauss methods without one of their own.
    """
    for number, entry in enumerate(given):
        if isinstance(entry, str):
            yield number, method_named(entry, start=start)
            continue
        for combination in entry.combinations():
            yield number, make_method(combination, start=start)
