"""Whether tolerances are kept: random scenes of ten kinds against references from elsewhere."""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from benchmarks.measuring import table
from benchmarks.pulse_scenes import PULSE_KINDS
from benchmarks.tolerance_scenes import KINDS, Array, Drawn, Known, Random
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.observe import observe_members
from fvi_cli.integrator.observations.request import Observations
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.studies.tolerance.runs import gauss, run_on
from fvi_cli.studies.tolerance.search import solve

SEED = 20
PER_KIND = 40
LEAST, MOST = 3.0, 11.0
"""Digits that are asked for, of the largest position."""
LEAST_BY_PULSE, MOST_BY_PULSE = 1.0, 9.0
"""The same where pulses push."""
BY_HAND_EVERY = 8
"""One of so many scenes is also solved by hand, by every choice of the list."""
REPEATS = 3
FAR_SLOWER = 2.0
"""Runs that take so many times as long as the best so far are given up."""
DEGREES = (4, 6, 8, 10)
REMARK = (
    "Random scenes, tolerances of 3 to 11 digits of the largest position, `fvi.solve`. The error "
    "is the largest at the times of an independent reference, between the points of the mesh as "
    "well as at them; where the reference errs by more than 0.3 of the tolerance nothing is "
    "judged. Estimate over error is given where the error is 10 times that of the reference. By "
    "hand: the quickest of 48 single adaptive runs, 4 degrees and 12 local tolerances, that keeps "
    "the tolerance when the truth is known. One run on the mesh: that which was accepted, by the "
    "same method, with nothing left to find out (processor time, where it was measured)."
)
PULSE_REMARK = (
    "Random scenes with pulses whose widths are 1e-5 to 1e-2 of the run, and with "
    "Riemann-Liouville derivatives of orders up to 1.99 from 0 with a velocity; tolerances of 1 to "
    "9 digits of the largest position, `fvi.solve`. The error is the largest at random times, of "
    "the run and of what is reported at these times with `output`, against convolutions with a "
    "closed form."
)


@dataclass(frozen=True, kw_only=True)
class ToleranceRow:
    """One scene with one tolerance.

    Parameters
    ----------
    kind, outcome, reason
        What it was, and what was said.
    tolerance, estimate, error, reference_error
        Lengths; the error is the largest at the times of the reference, between points as well.
    rounds, n_steps
        Rounds of the search, steps of the run that is delivered.
    seconds, by_hand, once
        Of the search, of the quickest single run that keeps the tolerance, and of one run on the
        mesh that was accepted; nan: not measured.
    """

    kind: str
    outcome: str
    reason: str
    tolerance: float
    estimate: float
    error: float
    reference_error: float
    rounds: int
    n_steps: int
    seconds: float
    by_hand: float = math.nan
    once: float = math.nan

    @property
    def is_judged(self) -> bool:
        """Whether the reference is good enough to say anything."""
        return self.reference_error <= 0.3 * self.tolerance

    @property
    def is_wrong(self) -> bool:
        """Whether it is reported as met and is not."""
        return self.outcome == "met" and self.error > self.tolerance + self.reference_error


def run_tolerances(
    per_kind: int = PER_KIND,
    *,
    by_hand_every: int = BY_HAND_EVERY,
    kept: Path | None = None,
    seconds: float = math.inf,
    with_pulses: bool = False,
) -> list[ToleranceRow]:
    """Solve random scenes of every kind, and compare.

    Parameters
    ----------
    per_kind
        How many of each.
    by_hand_every
        One of so many is solved by hand as well; 0: none.
    kept
        Table of the rows that are finished, from which it goes on.
    seconds
        After this time no more scenes are begun.
    with_pulses
        The kinds of :mod:`benchmarks.pulse_scenes` in place of the usual ones.
    """
    began = time.monotonic()
    kinds = PULSE_KINDS if with_pulses else KINDS
    rows = read_rows(kept) if kept is not None and kept.exists() else []
    done = len(rows) // len(kinds)
    for index in range(done, per_kind):
        if time.monotonic() - began > seconds:
            break
        by_hand = by_hand_every > 0 and index % by_hand_every == 0
        rows += run_index(index, by_hand=by_hand, kinds=kinds)
        if kept is not None:
            write_rows(kept, rows)
    return rows[: per_kind * len(kinds)]


def write_rows(path: Path, rows: Sequence[ToleranceRow]) -> None:
    """Keep rows as CSV."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    with part.open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, [field.name for field in fields(ToleranceRow)])
        table.writeheader()
        table.writerows(asdict(row) for row in rows)
    part.replace(path)


def read_rows(path: Path) -> list[ToleranceRow]:
    """What :func:`write_rows` wrote."""
    kinds = {field.name: field.type for field in fields(ToleranceRow)}
    read = {"str": str, "int": int, "float": float}
    with path.open(encoding="utf-8", newline="") as file:
        return [
            ToleranceRow(**{name: read[str(kinds[name])](text) for name, text in row.items()})
            for row in csv.DictReader(file)
        ]


def run_index(
    index: int,
    *,
    seed: int = SEED,
    by_hand: bool = False,
    kinds: Sequence[Callable[[Random], Drawn]] = KINDS,
) -> list[ToleranceRow]:
    """Solve one scene of every kind; those of an index are always the same."""
    random = np.random.default_rng([seed, index])
    digits = (LEAST, MOST) if kinds is KINDS else (LEAST_BY_PULSE, MOST_BY_PULSE)
    return [
        measure(draw(random), 10.0 ** -random.uniform(*digits), by_hand=by_hand) for draw in kinds
    ]


def measure(drawn: Drawn, relative: float, *, by_hand: bool) -> ToleranceRow:
    """Solve one scene to a share of its largest position."""
    scene, known = drawn.scene, drawn.known()
    tolerance = relative * float(np.abs(known.positions).max())
    seconds = math.inf
    for _ in range(REPEATS if by_hand else 1):
        began = time.process_time()
        run = solve(scene, tolerance=tolerance)
        seconds = min(seconds, time.process_time() - began)
    assessment = run.assessment
    if assessment is None:
        raise ValueError("tolerance: nothing is said of it")
    error = math.inf
    if run.steps is not None and run.time[-1] >= known.times[-1]:
        error = float(np.abs(run(known.times) - known.positions).max())
        if drawn.with_output:
            reported = _reported(scene, run, known)
            error = max(error, float(np.abs(reported - known.positions).max()))
    return ToleranceRow(
        kind=drawn.kind,
        outcome=assessment.outcome,
        reason=assessment.reason,
        tolerance=tolerance,
        estimate=run.error_estimate,
        error=error,
        reference_error=known.error,
        rounds=len(assessment.attempts),
        n_steps=run.n_steps,
        seconds=seconds,
        by_hand=_by_hand(scene, known, tolerance) if by_hand else math.nan,
        once=_once(scene, run) if by_hand and run.status == "ok" else math.nan,
    )


def _reported(scene: Scene, run: Trajectory, known: Known) -> Array:
    """Positions at the times of the reference, as they are reported."""
    if run.steps is None:
        raise ValueError("tolerance: a run without its polynomials")
    method = gauss(scene, run.steps.tables.degree)
    ((_, reported),) = observe_members([scene], method, [run], [Observations(times=known.times)])
    return reported.position


def _once(scene: Scene, run: Trajectory) -> float:
    """Time of a run on the mesh of another one, by its method."""
    if run.steps is None:
        raise ValueError("tolerance: a run without its polynomials")
    mesh = run.steps.mesh(scene.break_points)
    best = math.inf
    for _ in range(REPEATS):
        began = time.process_time()
        run_on(scene, run.steps.tables.points.size, mesh)
        best = min(best, time.process_time() - began)
    return best


def _by_hand(scene: Scene, known: Known, tolerance: float) -> float:
    """Time of the quickest of many single runs whose error, known afterwards, is small enough."""
    amplitude = float(np.abs(known.positions).max())
    best = math.inf
    for degree in DEGREES:
        method = Method(cq="gauss", degree=degree, start="none")
        for power in range(1, 13):
            began = time.process_time()
            local = AdaptiveSteps(tolerance=amplitude * 10.0**-power, most_steps=20_000)
            run = integrate(scene, method, local, with_steps=True)
            seconds = time.process_time() - began
            if run.status != "ok" or seconds > FAR_SLOWER * best:
                break
            if np.abs(run(known.times) - known.positions).max() <= tolerance:
                for _ in range(REPEATS - 1):
                    began = time.process_time()
                    integrate(scene, method, local, with_steps=True)
                    seconds = min(seconds, time.process_time() - began)
                best = min(best, seconds)
                break
    return best if math.isfinite(best) else math.nan


def tolerance_table(rows: Sequence[ToleranceRow], remark: str = REMARK) -> str:
    """What came of it, by kinds and together, as Markdown."""
    names = list(dict.fromkeys(row.kind for row in rows))
    groups = [(name, [row for row in rows if row.kind == name]) for name in names]
    body = [_line(name, group) for name, group in [*groups, ("all", list(rows))]]
    head = (
        "scenes",
        "number",
        "met",
        "unreliable",
        "refused",
        "met and wrong",
        "largest error / tolerance",
        "estimate / error: least, median",
        "rounds",
        "time / by hand: median, 90 %",
        "time / one run on the mesh: median, 90 %",
    )
    others = [
        f"- {row.kind}, tolerance {row.tolerance:.2g}: {row.outcome}, {row.reason} "
        f"(true {row.error:.2g})"
        for row in rows
        if row.outcome != "met"
    ]
    return "\n".join([table(remark, head, body), *others, ""])


def _line(name: str, rows: Sequence[ToleranceRow]) -> tuple[str, ...]:
    met = [row for row in rows if row.outcome == "met"]
    judged = [row for row in met if row.is_judged]
    shares = [row.error / row.tolerance for row in judged]
    # below the error of the reference nothing is known of the error
    known = [r for r in judged if r.error > 10 * r.reference_error and r.error > 0]
    ratios = [row.estimate / row.error for row in known]
    hand = [row.seconds / row.by_hand for row in rows if math.isfinite(row.by_hand)]
    once = [row.seconds / row.once for row in rows if math.isfinite(row.once)]
    return (
        name,
        str(len(rows)),
        str(len(met)),
        str(sum(row.outcome == "unreliable" for row in rows)),
        str(sum(row.outcome == "refused" for row in rows)),
        f"{sum(row.is_wrong for row in met)} of {len(judged)} judged",
        f"{max(shares):.2g}" if shares else "-",
        f"{min(ratios):.2g}, {np.median(ratios):.2g}" if ratios else "-",
        f"{np.mean([row.rounds for row in rows]):.1f}",
        f"{np.median(hand):.2g}, {np.quantile(hand, 0.9):.2g}" if hand else "-",
        f"{np.median(once):.2g}, {np.quantile(once, 0.9):.2g}" if once else "-",
    )
