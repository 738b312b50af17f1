"""What a hard case is: scenes, and claims with a number that must not be exceeded."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Literal

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.objections import law_objection
from fvi_cli.integrator.stability.prediction import Verdict, predict_stability
from fvi_cli.integrator.trajectory import Status

Sense = Literal["at most", "at least"]
Judged = Literal["runs", "predictions"]


@dataclass(frozen=True, eq=False)
class Setting:
    """A scene and the number of steps that it gets; the same object is computed only once."""

    scene: Scene
    n_steps: int


@dataclass(frozen=True, eq=False)
class Claim:
    """One number that must hold.

    Parameters
    ----------
    quantity
        What is measured, in words.
    limit
        The number.
    settings
        What is computed for it.
    judge
        Trajectories of the settings, in their order, to the measured number; their stability
        predictions, if those are `judged`.
    sense
        Whether the number must be at most, or at least, the limit.
    judged
        ``runs`` or, before any run, ``predictions``.
    is_comparable
        Whether every machine measures the same number; not so where round-off decides.
    """

    quantity: str
    limit: float
    settings: Sequence[Setting]
    judge: Callable[..., float]
    _: KW_ONLY
    sense: Sense = "at most"
    judged: Judged = "runs"
    is_comparable: bool = True

    def holds(self, measured: float) -> bool:
        """Whether a measured number fulfils the claim; nan does not."""
        if self.sense == "at least":
            return measured >= self.limit
        return measured <= self.limit


@dataclass(frozen=True, kw_only=True, eq=False)
class HardCase:
    """A case in words, with its claims.

    Parameters
    ----------
    name
        Letters, digits and -.
    title
        What is hard about it, in a few words.
    description
        Equation, data and steps.
    reference
        Where the truth comes from.
    claims
        What must hold.
    """

    name: str
    title: str
    description: str
    reference: str
    claims: tuple[Claim, ...]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What became of one claim with one method.

    Parameters
    ----------
    case, quantity
        The claim.
    method
        Name of the method as people read it.
    measured
        The number; infinite where a run did not come to its end, nan where it means nothing.
    limit, sense, holds
        What it is held against, and how it came out.
    status
        The worst status of the runs.
    predicted
        The worst prediction for the runs.
    is_comparable
        As in the claim, and False as well for runs whose growth starts from round-off.
    """

    case: str
    quantity: str
    method: str
    measured: float
    limit: float
    sense: Sense
    holds: bool
    status: Status
    predicted: Verdict
    is_comparable: bool = True


@dataclass(frozen=True, kw_only=True)
class HardCaseReport:
    """What was found, with the cases that it is about.

    Parameters
    ----------
    cases
        The cases, in their order.
    findings
        One for every claim and method, case by case.
    """

    cases: tuple[HardCase, ...]
    findings: tuple[Finding, ...]

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the methods in their order."""
        return tuple(dict.fromkeys(finding.method for finding in self.findings))

    def of(self, case: str) -> tuple[Finding, ...]:
        """The findings of one case."""
        return tuple(finding for finding in self.findings if finding.case == case)


class Bench:
    """Runs of one method and their predictions, each computed once however many claims ask."""

    def __init__(self, method: Method) -> None:
        self.run = functools.cache(lambda one: integrate(one.scene, method, one.n_steps))
        self.prediction = functools.cache(
            lambda one: predict_stability(one.scene, method, one.n_steps)
        )


def examine(case: HardCase, name: str, method: Method) -> Iterator[Finding]:
    """Every claim of a case with a method, as far as that is made for it."""
    bench = Bench(method)
    for claim in case.claims:
        if not any(law_objection(one.scene, method) for one in claim.settings):
            yield examine_claim(case, claim, name, bench)


def examine_claim(case: HardCase, claim: Claim, name: str, bench: Bench) -> Finding:
    """One claim with one method."""
    predictions = [bench.prediction(setting) for setting in claim.settings]
    worst: Status = "ok"
    if claim.judged == "predictions":
        measured = float(claim.judge(*predictions))
    else:
        runs = [bench.run(setting) for setting in claim.settings]
        worst = next((run.status for run in runs if run.status != "ok"), "ok")
        if worst == "ok":
            measured = float(claim.judge(*runs))
        else:
            measured = math.inf if claim.sense == "at most" else math.nan
    predicted = _worst_verdict([prediction.verdict for prediction in predictions])
    return Finding(
        case=case.name,
        quantity=claim.quantity,
        method=name,
        measured=measured,
        limit=claim.limit,
        sense=claim.sense,
        holds=worst == "ok" and claim.holds(measured),
        status=worst,
        predicted=predicted,
        is_comparable=claim.is_comparable and predicted != "unstable",
    )


def _worst_verdict(verdicts: Sequence[Verdict]) -> Verdict:
    order: tuple[Verdict, ...] = ("unstable", "unknown", "stable")
    return next((verdict for verdict in order if verdict in verdicts), "unknown")
