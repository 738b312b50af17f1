"""The method of integration as a value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.lagrange import LARGEST_DEGREE
from fvi_cli.mathematics.quadrature import QuadratureRule, gauss_rule, lobatto_rule

RuleName = Literal["gauss", "lobatto"]
Sampling = Literal["nodes", "points"]
Start = Literal["none", "weights", "graded"]
ForcingQuadrature = Literal["galerkin", "exact"]

BDF_NAMES = tuple(f"bdf{p}" for p in range(1, 7))
RUNGE_KUTTA_NAMES = ("gauss", "lobatto-iiic")
EULER_NAMES = ("explicit-euler", "implicit-euler")
BASELINE_NAMES = (*EULER_NAMES, "gruenwald-letnikov", "product-integration")

_FAMILIES: Mapping[str, str] = {"gauss": "Gauss", "lobatto-iiic": "Lobatto IIIC "}
_LABELS: Mapping[str, str] = {
    "explicit-euler": "explicit Euler",
    "implicit-euler": "implicit Euler",
    "gruenwald-letnikov": "Grünwald-Letnikov",
    "product-integration": "product integration",
}
_BASELINE_ORDERS: Mapping[str, float] = {
    "explicit-euler": 1.0,
    "implicit-euler": 1.0,
    "gruenwald-letnikov": 1.0,
    "product-integration": 2.0,
}


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
        if self.rule not in ("gauss", "lobatto"):
            raise ArgumentError("quadrature", f"{self.rule!r} is not one of gauss, lobatto")
        least = 2 if self.rule == "lobatto" else 1
        if not least <= self.points <= 64:
            raise ArgumentError(
                "quadrature", f"{self.points} points; {self.rule} takes {least} to 64"
            )

    def build(self) -> QuadratureRule:
        """The nodes and weights."""
        return (gauss_rule if self.rule == "gauss" else lobatto_rule)(self.points)

    @property
    def label(self) -> str:
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
            if getattr(self, name) not in values:
                raise ArgumentError(
                    name, f"{getattr(self, name)!r} is not one of {', '.join(values)}"
                )
        if not 1 <= self.degree <= LARGEST_DEGREE:
            raise ArgumentError(
                "degree", f"{self.degree} is not allowed; it must be 1 to {LARGEST_DEGREE}"
            )
        if self.is_runge_kutta:
            own = self._own_rule()
            if self.sampling != "points":
                raise ArgumentError("sampling", f"{self.cq} is sampled at its own points only")
            if self.quadrature not in (None, own):
                raise ArgumentError("quadrature", f"{self.cq} brings its own rule, {own.label}")
            if self.start == "weights":
                raise ArgumentError("start", "weights correct BDF only; use graded or none")
            object.__setattr__(self, "quadrature", own)
        elif self.start == "graded":
            raise ArgumentError(
                "start",
                f"graded is for {', '.join(RUNGE_KUTTA_NAMES)} only; with {self.cq} take "
                "weights or none",
            )
        elif self.quadrature is None:
            object.__setattr__(self, "quadrature", RuleSpecification(points=self.degree))
        if self.start_exponents and self.start != "weights":
            raise ArgumentError("start_exponents", "only start: weights has exponents")
        if self.start == "weights" and not self.start_exponents:
            raise ArgumentError("start_exponents", "missing: the powers that weights correct")
        if self.rule.build().order < 2 * self.degree - 1:
            # the mass matrix of the step would be singular
            raise ArgumentError(
                "quadrature",
                f"{self.rule.label} is too weak for degree {self.degree}; "
                f"it must integrate polynomials of degree {2 * self.degree - 2}",
            )

    def _own_rule(self) -> RuleSpecification:
        if self.cq == "gauss":
            return RuleSpecification(rule="gauss", points=self.degree)
        return RuleSpecification(rule="lobatto", points=self.degree + 1)

    @property
    def rule(self) -> RuleSpecification:
        """The rule for the action."""
        if self.quadrature is None:  # pragma: no cover - set at construction
            raise ArgumentError("quadrature", "not set")
        return self.quadrature

    @property
    def is_runge_kutta(self) -> bool:
        """Whether the convolution quadrature is a Runge-Kutta one."""
        return self.cq in RUNGE_KUTTA_NAMES

    @property
    def bdf_order(self) -> int:
        """Order p of the backward difference formula.

        Raises
        ------
        ValueError
            For Runge-Kutta methods.
        """
        if self.is_runge_kutta:
            raise ValueError(f"{self.cq} is not a backward difference formula")
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
    def label(self) -> str:
        """Name of the method for people: ``BDF2``, ``Gauss3``, ``Lobatto IIIC 4`` (with stages)."""
        if self.is_runge_kutta:
            return f"{_FAMILIES[self.cq]}{self.stages}"
        return f"BDF{self.bdf_order}"

    @property
    def case(self) -> str:
        """Name of the method in files: ``bdf2-nodes-s1-gauss1-none``, ``gauss-s3-graded``."""
        if self.is_runge_kutta:
            name = f"{self.cq}-s{self.degree}-{self.start}"
            default: ForcingQuadrature = "galerkin"
        else:
            name = f"{self.cq}-{self.sampling}-s{self.degree}-{self.rule.label}-{self.start}"
            default = "galerkin" if self.sampling == "nodes" else "exact"
        if self.start_exponents:
            name += "-" + "-".join(f"{e:g}".replace(".", "p") for e in self.start_exponents)
        if self.forcing_quadrature != default:
            name += f"-{self.forcing_quadrature}"
        return name


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
        return _BASELINE_ORDERS[self.name]

    @property
    def case(self) -> str:
        """Name of the method in files."""
        return self.name

    @property
    def label(self) -> str:
        """Name of the method for people: ``Grünwald-Letnikov``."""
        return _LABELS[self.name]


AnyMethod = Method | Baseline


def method_columns(method: AnyMethod) -> dict[str, str]:
    """The columns ``cq, sampling, degree, quadrature, start`` of tables and attributes.

    Columns that a baseline does not have are ``-``.
    """
    if isinstance(method, Baseline):
        return {"cq": method.name, "sampling": "-", "degree": "-", "quadrature": "-", "start": "-"}
    return {
        "cq": method.cq,
        "sampling": method.sampling,
        "degree": str(method.degree),
        "quadrature": method.rule.label,
        "start": method.start,
    }
