"""Whether printed numbers are true: random scenes of every command against other routes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from unittest import mock

import numpy as np

from benchmarks.measuring import CHILD_ENVIRONMENT, table
from benchmarks.truth import linear, motions, others
from benchmarks.truth.judging import Change, Judged, Kind, judge

KINDS: Mapping[str, tuple[Kind, int]] = {
    "run: tolerances": (motions.tolerance, 300),
    "run: laws": (others.laws, 200),
    "run: impacts": (others.impacts, 200),
    "convergence": (motions.convergence, 340),
    "quantities": (motions.quantities, 230),
    "events": (motions.events, 180),
    "modes": (linear.modes, 220),
    "response": (linear.response, 150),
    "stability": (linear.stability, 160),
    "fit": (others.fit, 20),
}
"""What draws and judges scenes of a kind, and how many of them."""
WORKERS = 2
REMARK = (
    "Random scenes: orders over all of (0, 2), near 2 and exactly 1, both derivatives with all "
    "initial data that they permit, one to three components, units of time 1e-9 to 1e9 and of "
    "length 1e-8 to 1e8, components up to 1e9 apart, break points and events anywhere. Motions are "
    "compared with collocation of the Volterra equation on graded meshes, Laplace inversion and "
    "Dormand and Prince's method (`tests/oracles`), modes with the roots of a polynomial, steps "
    "with the argument principle, fits with the linear problem. A number is wrong where the "
    "program says nothing and it is off by more than is claimed: the tolerance; 2 % of a printed "
    "error; 1e-3 of the largest value where no error is printed. Not judged: the other route is "
    "not accurate enough, or the case is a near thing, such as a tangency."
)


def run_truth(
    per_mille: int = 1000,
    *,
    seed: int,
    kinds: Sequence[str] = (),
    change: Change = float,
    workers: int = WORKERS,
    report: Callable[[str], None] = print,
) -> list[Judged]:
    """Judge random scenes of every kind; those of a seed are always the same.

    Parameters
    ----------
    per_mille
        So many thousandths of all, at least one of every kind.
    kinds
        Names of kinds; default: all.
    change
        What is done to every printed number before it is judged: a control.
    workers
        Processes; 0: this one.
    report
        Gets what is needed to repeat a scene that is wrong.
    """
    draws = [
        (name, seed, index, change)
        for name, (_, full) in KINDS.items()
        if not kinds or name in kinds
        for index in range(max(1, round(full * per_mille / 1000)))
    ]
    rows = []
    for (name, _, index, _), row in zip(draws, _judged(draws, workers), strict=True):
        rows.append(row)
        if row.verdict == "wrong":
            report("\n".join([f"wrong: {name}, draw {index} of seed {seed}", *row.words, ""]))
    return rows


Draw = tuple[str, int, int, Change]


def _judged(draws: Sequence[Draw], workers: int) -> Iterator[Judged]:
    if workers == 0:
        yield from map(judge_draw, draws)
        return
    with (
        mock.patch.dict(os.environ, CHILD_ENVIRONMENT),
        ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool,
    ):
        yield from pool.map(judge_draw, draws, chunksize=4)


def judge_draw(draw: Draw) -> Judged:
    """Judge the scene with an index among those of a kind and a seed."""
    name, seed, index, change = draw
    random = np.random.default_rng([seed, list(KINDS).index(name), index])
    return judge(name, KINDS[name][0], random, change)


def truth_table(rows: Sequence[Judged]) -> str:
    """What came of it, by kinds and together, as Markdown."""
    names = list(dict.fromkeys(row.kind for row in rows))
    groups = [(name, [row for row in rows if row.kind == name]) for name in names]
    head = ("kind", "tried", "numbers", "wrong", "refused or said", "not judged", "worst ratio")
    return table(REMARK, head, [_line(name, own) for name, own in [*groups, ("all", rows)]])


def _line(name: str, rows: Sequence[Judged]) -> tuple[str, ...]:
    counts = (sum(row.verdict == v for row in rows) for v in ("wrong", "refused", "unjudged"))
    judged = [row.ratio for row in rows if row.verdict in ("right", "wrong")]
    return (
        name,
        str(len(rows)),
        str(sum(row.numbers for row in rows)),
        *map(str, counts),
        f"{max(judged):.2g}" if judged else "-",
    )
