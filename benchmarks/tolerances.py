"""Whether tolerances are kept: random scenes and pulses against references from elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.measuring import table
from benchmarks.pulse_scenes import NARROWER_PULSES, PULSES
from benchmarks.tolerance_scenes import KINDS, Drawn, Random
from fvi_cli.studies.tolerance.search import solve

SEED = 20
REMARK = (
    "Random scenes, `fvi.solve`: tolerances of 3 to 11 digits of the largest position, where "
    "pulses push 1 to 9. Pulses are 1e-4 to 1e-2 of the run wide; narrower ones, from 1e-8 on, "
    "have break points at the pulse and around it. The error is the largest at the times of an "
    "independent reference, between the points of the mesh as well as at them; where the reference "
    "errs by more than 0.3 of the tolerance nothing is judged. Estimate over error is given where "
    "the error is 10 times that of the reference."
)


class Group(NamedTuple):
    """Kinds of scenes, how many are drawn of each, and the digits that are asked for."""

    kinds: Sequence[Callable[[Random], Drawn]]
    per_kind: int
    digits: tuple[float, float]


GROUPS = {
    "tolerances": Group(KINDS, 40, (3.0, 11.0)),
    "pulses": Group(PULSES, 134, (1.0, 9.0)),
    "narrower pulses": Group(NARROWER_PULSES, 34, (1.0, 9.0)),
}


class ToleranceRow(NamedTuple):
    """One scene with one tolerance: what was said, and lengths; seconds of the processor."""

    kind: str
    reason: str  # why it is not met; empty: it is said to be met
    tolerance: float
    estimate: float
    error: float  # the largest at the times of the reference
    reference_error: float
    seconds: float

    @property
    def is_judged(self) -> bool:
        """Whether it is said to be met, and the reference is good enough to say anything."""
        return not self.reason and self.reference_error <= 0.3 * self.tolerance

    @property
    def is_wrong(self) -> bool:
        """Whether it is said to be met and is not."""
        return not self.reason and self.error > self.tolerance + self.reference_error


def run_tolerances(share: float = 1.0) -> Iterator[tuple[str, ToleranceRow]]:
    """Solve a share of the scenes of every group, and compare; with the names of the groups."""
    for name, group in GROUPS.items():
        for index in range(round(share * group.per_kind)):
            yield from ((name, row) for row in run_index(index, group))


def run_index(index: int, group: Group) -> list[ToleranceRow]:
    """Solve one scene of every kind; those of an index are always the same."""
    random = np.random.default_rng([SEED, index])
    return [measure(draw(random), 10.0 ** -random.uniform(*group.digits)) for draw in group.kinds]


def measure(drawn: Drawn, relative: float) -> ToleranceRow:
    """Solve one scene to a share of its largest position."""
    known = drawn.known()
    tolerance = relative * float(np.abs(known.positions).max())
    began = time.process_time()
    run = solve(drawn.scene, tolerance=tolerance)
    seconds, error = time.process_time() - began, np.inf
    if run.steps is not None and run.time[-1] >= known.times[-1]:
        error = float(np.abs(run(known.times) - known.positions).max())
    reason = "" if run.assessment is None else run.assessment.reason
    found = tolerance, run.error_estimate, error, known.error, seconds
    return ToleranceRow(drawn.kind, reason, *found)


def tolerance_table(found: Sequence[tuple[str, ToleranceRow]]) -> str:
    """What came of it, by kinds and by groups, as Markdown."""
    groups: dict[str, list[ToleranceRow]] = {}
    for name, row in found:
        groups.setdefault(row.kind, []).append(row)
        groups.setdefault(f"**{name}**", []).append(row)
    head = "scenes, number, met, not met, met and wrong, beyond twice, largest error / tolerance"
    columns = [*head.split(", "), "estimate / error: least, median", "seconds: median, all"]
    others = [
        f"- {row.kind}, tolerance {row.tolerance:.2g}: {row.reason} (true {row.error:.2g})"
        for _, row in found
        if row.reason or row.is_wrong
    ]
    body = [_line(name, rows) for name, rows in groups.items()]
    return "\n".join([table(REMARK, columns, body), *others, ""])


def _line(name: str, rows: Sequence[ToleranceRow]) -> tuple[str, ...]:
    met = sum(not row.reason for row in rows)
    judged = [row for row in rows if row.is_judged]
    shares = [row.error / row.tolerance for row in judged]
    # below the error of the reference nothing is known of the error
    known = [r for r in judged if r.error > 10 * r.reference_error and r.error > 0]
    ratios = [row.estimate / row.error for row in known]
    seconds = [row.seconds for row in rows]
    return (
        name,
        *map(str, (len(rows), met, len(rows) - met)),
        f"{sum(row.is_wrong for row in judged)} of {len(judged)} judged",
        str(sum(share > 2.0 for share in shares)),
        f"{max(shares):.2g}" if shares else "-",
        f"{min(ratios):.2g}, {np.median(ratios):.2g}" if ratios else "-",
        f"{np.median(seconds):.2g}, {sum(seconds):.3g}",
    )
