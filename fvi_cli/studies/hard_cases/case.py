"""A hard case: scenes, and claims with a number that must not be exceeded."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass
from typing import Literal

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.damping.damping import law_objection
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.prediction import Verdict, predict_stability
from fvi_cli.integrator.trajectory import Status, Trajectory
from fvi_cli.scenes.registry import build_scene

Sense = Literal["at most", "at least"]

FLAGSHIP = "Gauss3"
"""The method for which all claims must hold."""


@dataclass(frozen=True)
class CaseSetting:
    """A problem and its exact solution, as JSON texts, and the number of steps."""

    problem: str
    n_steps: int
    truth: str = "null"  # a specification for judges.exact_solution

    @functools.cached_property
    def scene(self) -> Scene:
        """The scene of the problem."""
        return build_scene(json.loads(self.problem))


@dataclass(frozen=True, eq=False)
class Claim:
    """A limit that one measured number must keep."""

    quantity: str
    limit: float
    settings: tuple[CaseSetting, ...]
    judge: Callable[..., float]  # trajectories of the settings, or their stability predictions
    _: KW_ONLY
    sense: Sense = "at most"
    judges_predictions: bool = False
    is_comparable: bool = True  # not where round-off decides

    def holds(self, measured: float) -> bool:
        """Whether a measured number fulfils the claim; nan does not."""
        return measured >= self.limit if self.sense == "at least" else measured <= self.limit


@dataclass(frozen=True, kw_only=True, eq=False)
class HardCase:
    """A case in words, with its claims."""

    name: str
    title: str
    description: str
    reference: str
    claims: tuple[Claim, ...]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """The result of one claim with one method."""

    case: str
    quantity: str
    method: str
    """Name of the method in the report."""
    measured: float
    """The number; infinite where a run did not reach its end, nan where it has no meaning."""
    limit: float
    sense: Sense
    holds: bool
    status: Status
    predicted: Verdict
    """The worst status of the runs, and the worst prediction for them."""
    is_comparable: bool = True
    """False where the claim is not comparable, and for runs whose growth starts from round-off."""


@dataclass(frozen=True, kw_only=True)
class HardCaseReport:
    """The cases, and the findings for every claim and method, case by case.

    `is_partial`: some cases or methods were left out.
    """

    cases: tuple[HardCase, ...]
    findings: tuple[Finding, ...]
    is_partial: bool = False

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the methods in their order."""
        return tuple(dict.fromkeys(finding.method for finding in self.findings))

    def of(self, case: str) -> tuple[Finding, ...]:
        """The findings of one case."""
        return tuple(finding for finding in self.findings if finding.case == case)


def examined_methods() -> Mapping[str, Method]:
    """Every family with the defaults that a configuration gives it, by its name in the report."""
    orders = range(1, 7)
    return {
        **{f"Gauss{m}": Method(cq="gauss", degree=m, start="graded") for m in (3, 1, 2, 4)},
        "Radau IIA 3": Method(cq="radau-iia", degree=3, start="none"),
        "Lobatto IIIC 4": Method(cq="lobatto-iiic", degree=3, start="none"),
        **{
            f"BDF{p} points": Method(cq=f"bdf{p}", degree=(p + 1) // 2, forcing_quadrature="exact")
            for p in orders
        },
        **{f"BDF{p} nodes": Method(cq=f"bdf{p}", degree=1, sampling="nodes") for p in orders},
    }


WORST_FIRST: tuple[Verdict, ...] = ("unstable", "unknown", "stable")


def examine(case: HardCase, name: str, method: Method) -> Iterator[Finding]:
    """Every claim of a case with a method that is made for it; each run is computed once."""

    @functools.cache
    def run(problem: str, n_steps: int) -> Trajectory:
        return integrate(CaseSetting(problem, n_steps).scene, method, n_steps)

    for claim in case.claims:
        if any(law_objection(one.scene, method) for one in claim.settings):
            continue
        predictions = [predict_stability(one.scene, method, one.n_steps) for one in claim.settings]
        verdicts = {prediction.verdict for prediction in predictions}
        predicted = next(one for one in WORST_FIRST if one in verdicts)
        worst: Status = "ok"
        if claim.judges_predictions:
            measured = claim.judge(*predictions)
        else:
            runs = [run(one.problem, one.n_steps) for one in claim.settings]
            worst = next((one.status for one in runs if one.status != "ok"), "ok")
            measured = math.inf if claim.sense == "at most" else math.nan
            if worst == "ok":
                measured = claim.judge(*runs)
        yield Finding(
            case=case.name,
            quantity=claim.quantity,
            method=name,
            measured=float(measured),
            limit=claim.limit,
            sense=claim.sense,
            holds=worst == "ok" and claim.holds(measured),
            status=worst,
            predicted=predicted,
            is_comparable=claim.is_comparable and predicted != "unstable",
        )
