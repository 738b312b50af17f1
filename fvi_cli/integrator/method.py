"""The method of integration as a value, and its names both ways."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from fvi_cli.errors import ArgumentError, excerpt, suggestion
from fvi_cli.mathematics.lagrange import LARGEST_DEGREE
from fvi_cli.mathematics.quadrature import LARGEST_RULE, QuadratureRule, gauss_rule, lobatto_rule

RuleName = Literal["gauss", "lobatto"]
Sampling = Literal["nodes", "points"]
Start = Literal["none", "weights", "graded"]
ForcingQuadrature = Literal["galerkin", "exact"]

BDF_NAMES = tuple(f"bdf{p}" for p in range(1, 7))
RUNGE_KUTTA_NAMES = ("gauss", "lobatto-iiic")
_BASELINES: Mapping[str, tuple[str, float]] = {
    "explicit-euler": ("explicit Euler", 1.0),
    "implicit-euler": ("implicit Euler", 1.0),
    "gruenwald-letnikov": ("Grünwald-Letnikov", 1.0),
    "product-integration": ("product integration", 2.0),
}
"""Names of baselines for readers, and their orders."""
BASELINE_NAMES = tuple(_BASELINES)
EXAMPLES: Final = "gauss3, bdf2, bdf2-nodes"


@dataclass(frozen=True, kw_only=True)
class RuleSpecification:
    """A quadrature rule on [0, 1] by name and number of points.

    Raises
    ------
    ValueError
        For an unknown name, or a number of points that the rule cannot have.
    """

    rule: RuleName = "gauss"
    points: int = 1

    def __post_init__(self) -> None:
        least = {"gauss": 1, "lobatto": 2}.get(self.rule)
        if least is None or not least <= self.points <= LARGEST_RULE:
            raise ArgumentError(
                "quadrature", f"{self} is not one of gauss1 to gauss64, lobatto2 to lobatto64"
            )

    def build(self) -> QuadratureRule:
        """The nodes and weights."""
        return (gauss_rule if self.rule == "gauss" else lobatto_rule)(self.points)

    def __str__(self) -> str:
        """Name and number of points in one word, as in file names."""
        return f"{self.rule}{self.points}"


@dataclass(frozen=True, kw_only=True)
class Method:
    """A Galerkin variational integrator with convolution quadrature for the damping.

    Parameters
    ----------
    cq
        Convolution quadrature: ``bdf1`` to ``bdf6``, or the Runge-Kutta families ``gauss``
        and ``lobatto-iiic``, which bring their own points.
    degree
        Polynomial degree s of the trajectory on one step.
    quadrature
        Rule for the action; None: Gauss with s points, or the Runge-Kutta method's own points.
    sampling
        Where the fractional action is sampled: ``nodes`` (the paper) or ``points`` (the
        quadrature points; always so for Runge-Kutta).
    start
        What is done about a singular start: ``none``, ``weights`` (BDF only), or ``graded``
        (Runge-Kutta only): steps behind singular points are halved again and again.
    start_exponents
        For ``weights``: exponents on which the corrected quadrature is exact.
    forcing_quadrature
        ``galerkin`` (the action's rule) or ``exact`` (moments to round-off).

    Raises
    ------
    ValueError
        For values outside the permitted sets and combinations that make no method.
    """

    cq: str
    degree: int
    quadrature: RuleSpecification | None = None
    sampling: Sampling = "points"
    start: Start = "none"
    start_exponents: tuple[float, ...] = ()
    forcing_quadrature: ForcingQuadrature = "galerkin"

    def __post_init__(self) -> None:
        permitted: dict[str, tuple[str, ...]] = {
            "cq": BDF_NAMES + RUNGE_KUTTA_NAMES,
            "sampling": ("nodes", "points"),
            "start": ("none", "weights", "graded"),
            "forcing_quadrature": ("galerkin", "exact"),
        }
        for name, values in permitted.items():
            if (given := getattr(self, name)) not in values:
                raise ArgumentError(name, f"{given!r} is not one of {', '.join(values)}")
        if not 1 <= self.degree <= LARGEST_DEGREE:
            raise ArgumentError(
                "degree", f"{self.degree} is not allowed; it must be 1 to {LARGEST_DEGREE}"
            )
        own = self.usual_rule
        if self.is_runge_kutta and self.sampling != "points":
            raise ArgumentError("sampling", f"{self.cq} is sampled at its own points only")
        if self.is_runge_kutta and self.quadrature not in (None, own):
            raise ArgumentError("quadrature", f"{self.cq} brings its own rule, {own}")
        if self.is_runge_kutta and self.start == "weights":
            raise ArgumentError("start", "weights correct BDF only; use graded or none")
        if self.start == "graded" and self.cq != "gauss":
            raise ArgumentError("start", "graded is for rk: gauss only; use none")
        if self.start_exponents and self.start != "weights":
            raise ArgumentError("start_exponents", "only start: weights has exponents")
        if self.start == "weights" and not self.start_exponents:
            raise ArgumentError("start_exponents", "missing: the powers that weights correct")
        if len(set(self.start_exponents)) != len(self.start_exponents):
            raise ArgumentError("start_exponents", "every exponent must be given once")
        if self.quadrature is None:
            object.__setattr__(self, "quadrature", own)
        if self.rule.build().order < 2 * self.degree - 1:
            # the mass matrix of the step would be singular
            raise ArgumentError(
                "quadrature",
                f"{self.rule} is too weak for degree {self.degree}; "
                f"it must integrate polynomials of degree {2 * self.degree - 2}",
            )

    @property
    def usual_rule(self) -> RuleSpecification:
        """The rule where none is given: Gauss, or the points of the Runge-Kutta method."""
        if self.cq == "lobatto-iiic":
            return RuleSpecification(rule="lobatto", points=self.degree + 1)
        return RuleSpecification(points=self.degree)

    @property
    def rule(self) -> RuleSpecification:
        """The rule for the action."""
        return self.quadrature or self.usual_rule

    @property
    def is_runge_kutta(self) -> bool:
        """Whether the convolution quadrature is a Runge-Kutta one."""
        return self.cq in RUNGE_KUTTA_NAMES

    @property
    def bdf_order(self) -> int:
        """Order p of the backward difference formula; for no Runge-Kutta method."""
        return int(self.cq[3:])

    @property
    def stages(self) -> int:
        """Number of quadrature points of one step."""
        return self.rule.points

    @property
    def order(self) -> float:
        """Order on smooth data, of trajectory, rule, convolution quadrature and sampling.

        nan for Runge-Kutta methods other than Gauss: a fractional derivative lowers theirs.
        """
        action = min(2 * self.degree, self.rule.build().order)
        if self.is_runge_kutta:
            return action if self.cq == "gauss" else math.nan
        return min(action, self.bdf_order, 2 if self.sampling == "nodes" else action)

    @property
    def family(self) -> str:
        """Name of its family for readers: ``BDF2``, ``Gauss3``, ``Lobatto IIIC``."""
        if self.is_runge_kutta:
            return f"Gauss{self.degree}" if self.cq == "gauss" else "Lobatto IIIC"
        return f"BDF{self.bdf_order}"

    @property
    def variant(self) -> str:
        """What differs from the usual method of the family: ``nodes, degree 2``; often empty."""
        words = ["nodes"] if self.sampling == "nodes" else []
        if self.cq == "lobatto-iiic" or (self.degree > 1 and not self.is_runge_kutta):
            words.append(f"degree {self.degree}")
        if self.rule != self.usual_rule:
            words.append(f"{self.rule.points} {self.rule.rule.capitalize()} points")
        if self.start_exponents:
            words.append("weights " + ", ".join(f"t^{power:g}" for power in self.start_exponents))
        elif self.start != usual_start(self.cq):
            words.append(f"start {self.start}")
        if self.forcing_quadrature != usual_forcing(self.cq, self.sampling):
            words.append(f"{self.forcing_quadrature} forcing")
        return ", ".join(words)

    @property
    def label(self) -> str:
        """Name of the method for readers: ``BDF2 (nodes)``, ``Gauss3``; one for each method."""
        return f"{self.family} ({self.variant})" if self.variant else self.family

    @property
    def case(self) -> str:
        """Name of the method in files: ``bdf2-nodes-s1-gauss1-none``, ``gauss-s3-graded``."""
        words = [self.cq, f"s{self.degree}", self.start]
        if not self.is_runge_kutta:
            words = [self.cq, self.sampling, f"s{self.degree}", str(self.rule), self.start]
        words += (f"{power:g}".replace(".", "p") for power in self.start_exponents)
        if self.forcing_quadrature != usual_forcing(self.cq, self.sampling):
            words.append(self.forcing_quadrature)
        return "-".join(words)

    @property
    def keys(self) -> dict[str, Any]:
        """The keys of a configuration that define the method in full (:func:`make_method`)."""
        keys: dict[str, Any] = {"rk": self.cq} if self.is_runge_kutta else {"bdf": self.bdf_order}
        keys["degree"] = self.degree
        if not self.is_runge_kutta:
            keys["sampling"] = self.sampling
            keys["quadrature"] = {"rule": self.rule.rule, "points": self.rule.points}
        exponents = list(self.start_exponents)
        keys["start"] = {"weights": exponents} if exponents else self.start
        keys["forcing_quadrature"] = self.forcing_quadrature
        return keys


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """A method that users would write otherwise, for comparison.

    Parameters
    ----------
    name
        ``explicit-euler``, ``implicit-euler``, ``gruenwald-letnikov`` (central differences, order
        1 by its derivative) or ``product-integration`` (trapezoidal, order 2).

    Raises
    ------
    ValueError
        For a name that is not known.
    """

    name: str

    def __post_init__(self) -> None:
        if self.name not in BASELINE_NAMES:
            raise ArgumentError(
                "baseline", f"{self.name!r} is not one of {', '.join(BASELINE_NAMES)}"
            )

    @property
    def order(self) -> float:
        """Order on smooth data."""
        return _BASELINES[self.name][1]

    @property
    def case(self) -> str:
        """Name of the method in files."""
        return self.name

    @property
    def label(self) -> str:
        """Name of the method for readers: ``Grünwald-Letnikov``."""
        return _BASELINES[self.name][0]

    family, cq = label, case
    variant, sampling, degree, quadrature, start = "", "-", "-", "-", "-"

    @property
    def keys(self) -> dict[str, Any]:
        """The key of a configuration that defines the method."""
        return {"baseline": self.name}


AnyMethod = Method | Baseline


def usual_start(cq: str) -> Start:
    """The start where none is given: short steps behind singular points by Gauss."""
    return "graded" if cq == "gauss" else "none"


def usual_forcing(cq: str, sampling: Sampling) -> ForcingQuadrature:
    """The quadrature of the forcing where none is given."""
    return "exact" if cq in BDF_NAMES and sampling == "points" else "galerkin"


def make_method(values: Mapping[str, Any], *, start: Start | None = None) -> AnyMethod:
    """The method of the keys of a configuration, with defaults for those that are missing.

    `start` is the default of Gauss methods in place of :func:`usual_start`.

    Raises
    ------
    ValueError
        For combinations that make no method.
    """
    if "baseline" in values:
        return Baseline(name=values["baseline"])
    order, sampling = values.get("bdf"), values.get("sampling", "points")
    cq = values.get("rk", "gauss") if order is None else BDF_NAMES[order - 1]
    usual_degree = 3 if order is None else 1 if sampling == "nodes" else math.ceil(order / 2)
    degree = values.get("degree", usual_degree)
    usual = start if start and cq == "gauss" else usual_start(cq)
    chosen, exponents = values.get("start", usual), ()
    if isinstance(chosen, Mapping):
        exponents, chosen = tuple(chosen["weights"]), "weights"
    rule = values.get("quadrature")
    if rule is not None:
        given: Mapping[str, Any] = {"rule": rule} if isinstance(rule, str) else rule
        points = given.get("points") or degree + (given["rule"] == "lobatto")
        rule = RuleSpecification(rule=given["rule"], points=points)
    return Method(
        cq=cq,
        degree=degree,
        quadrature=rule,
        sampling=sampling,
        start=chosen,
        start_exponents=exponents,
        forcing_quadrature=values.get("forcing_quadrature", usual_forcing(cq, sampling)),
    )


_NAME: Final = re.compile(
    r"(?:bdf-?(?P<bdf>[1-6])|(?P<rk>gauss|lobatto-iiic)-?(?P<degree>\d{0,3}))"
    r"(?:-(?P<sampling>nodes))?(?:-(?P<start>none|graded))?"
)


def method_named(name: str, *, start: Start | None = None) -> AnyMethod:
    """The method of a name.

    ``bdf1`` to ``bdf6``; ``gauss`` or ``lobatto-iiic`` with the degree, as in ``gauss3``; or a
    baseline. ``-nodes`` and ``-none`` or ``-graded`` may follow, as in ``bdf2-nodes``. `start` is
    as for :func:`make_method`.

    Raises
    ------
    ValueError
        For a text that is not the name of a method.
    """
    plain = re.sub(r"[\s_]+", "-", name.strip().lower())
    if plain in BASELINE_NAMES:
        return Baseline(name=plain)
    found = _NAME.fullmatch(plain)
    if found is None:
        near = suggestion(name, (*BASELINE_NAMES, *(f"{rk}3" for rk in RUNGE_KUTTA_NAMES)))
        raise ValueError(
            f"{excerpt(name)!r} is not the name of a method{near} (such names are {EXAMPLES}, "
            f"bdf1 to bdf6, {', '.join(BASELINE_NAMES)})"
        )
    values: dict[str, Any] = {key: value for key, value in found.groupdict().items() if value}
    numbers = {key: int(values[key]) for key in ("bdf", "degree") if key in values}
    return make_method(values | numbers, start=start)


def as_method(method: AnyMethod | str) -> AnyMethod:
    """A method, also by its name (:func:`method_named`)."""
    return method_named(method) if isinstance(method, str) else method
