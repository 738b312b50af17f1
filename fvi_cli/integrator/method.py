"""The method of integration as a value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from fvi_cli.mathematics.quadrature import QuadratureRule, gauss_rule, lobatto_rule

RuleName = Literal["gauss", "lobatto"]
Sampling = Literal["nodes", "points"]
Start = Literal["none", "weights", "series"]
ForcingQuadrature = Literal["galerkin", "exact", "projected"]
History = Literal["auto", "direct"]

BDF_NAMES = tuple(f"bdf{p}" for p in range(1, 7))
RUNGE_KUTTA_NAMES = ("gauss", "radau-iia", "lobatto-iiic")
BASELINE_NAMES = ("explicit-euler", "implicit-euler")


@dataclass(frozen=True, kw_only=True)
class RuleSpecification:
    """A quadrature rule on [0, 1] by name and number of points.

    Raises
    ------
    ValueError
        For an unknown name, or fewer points than the rule can have.
    """

    rule: RuleName = "gauss"
    points: int = 1

    def __post_init__(self) -> None:
        if self.rule not in ("gauss", "lobatto"):
            raise ValueError(f"quadrature: {self.rule!r} is not one of gauss, lobatto")
        least = 1 if self.rule == "gauss" else 2
        if not least <= self.points <= 64:
            raise ValueError(f"quadrature: {self.points} points; {self.rule} takes {least} to 64")

    def build(self) -> QuadratureRule:
        """The nodes and weights."""
        return gauss_rule(self.points) if self.rule == "gauss" else lobatto_rule(self.points)

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
        Convolution quadrature: ``bdf1`` to ``bdf6``.
    sampling
        Where the fractional action is sampled: ``nodes`` (the paper) or ``points``.
    degree
        Polynomial degree s of the trajectory on one step.
    quadrature
        Rule for the action.
    start
        What is done about a singular start: ``none``, ``weights`` or ``series``.
    start_exponents
        For ``weights``: exponents on which the corrected quadrature is exact; empty: those of
        the scene's own expansion.
    forcing_quadrature
        ``galerkin`` (the action's rule), ``exact`` (moments to round-off), ``projected``.
    history
        ``auto`` or ``direct``.

    Raises
    ------
    ValueError
        For values outside the permitted sets and combinations that make no method.
    """

    cq: str
    degree: int
    quadrature: RuleSpecification
    sampling: Sampling = "nodes"
    start: Start = "none"
    start_exponents: tuple[float, ...] = ()
    forcing_quadrature: ForcingQuadrature = "galerkin"
    history: History = "auto"

    def __post_init__(self) -> None:
        if self.cq not in BDF_NAMES:
            raise ValueError(f"cq: {self.cq!r} is not one of {', '.join(BDF_NAMES)}")
        if not 1 <= self.degree <= 20:
            raise ValueError(f"degree: {self.degree} is not allowed; it must be 1 to 20")

    @property
    def bdf_order(self) -> int:
        """Order p of the backward difference formula."""
        return int(self.cq[3:])

    @property
    def case(self) -> str:
        """Name of the method in files, for example ``bdf2-nodes-s1-gauss1-none``."""
        return f"{self.cq}-{self.sampling}-s{self.degree}-{self.quadrature.label}-{self.start}"


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """A method that users would write otherwise, for comparison."""

    name: str

    def __post_init__(self) -> None:
        if self.name not in BASELINE_NAMES:
            raise ValueError(f"baseline: {self.name!r} is not one of {', '.join(BASELINE_NAMES)}")

    @property
    def case(self) -> str:
        """Name of the method in files."""
        return self.name


AnyMethod = Method | Baseline


def method_columns(method: AnyMethod) -> dict[str, str]:
    """The columns ``cq, sampling, degree, quadrature, start`` of tables and attributes.

    What a baseline does not have is ``-``.
    """
    if isinstance(method, Baseline):
        return {"cq": method.name, "sampling": "-", "degree": "-", "quadrature": "-", "start": "-"}
    return {
        "cq": method.cq,
        "sampling": method.sampling,
        "degree": str(method.degree),
        "quadrature": method.quadrature.label,
        "start": method.start,
    }


__all__ = [
    "BASELINE_NAMES",
    "BDF_NAMES",
    "RUNGE_KUTTA_NAMES",
    "AnyMethod",
    "Baseline",
    "Method",
    "RuleSpecification",
    "method_columns",
]
