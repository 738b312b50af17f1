"""Errors of quantities in ladders, estimated by comparing runs of a ladder with finer ones."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

from fvi_cli.studies.experiment import FinishedRun


def with_peak_errors(finished: Sequence[FinishedRun]) -> list[FinishedRun]:
    """Runs of ladders with the errors of their peaks, where two runs of a method reached T.

    The error of a run is its difference from the finest run; the error of the finest run is its
    difference from the run before, which is larger than its error. Runs for a tolerance keep their
    errors.
    """
    ladders: dict[tuple[object, ...], list[int]] = {}
    for index, one in enumerate(finished):
        if one.status in ("ok", "floor") and not one.run.is_search and one.trajectory.observed:
            member = one.run.member and one.run.member.number
            key = (one.run.experiment.name, member, one.run.method.case)
            ladders.setdefault(key, []).append(index)
    found = list(finished)
    for ladder in ladders.values():
        ladder.sort(key=lambda index: finished[index].run.n_steps)
        pairs = [(index, ladder[-1]) for index in ladder[:-1]]
        for index, other in (*pairs, *((b, a) for a, b in itertools.pairwise(ladder[-2:]))):
            found[index] = _compared(finished[index], finished[other])
    return found


def _compared(one: FinishedRun, other: FinishedRun) -> FinishedRun:
    own, its = one.trajectory.observed, other.trajectory.observed
    if own is None or its is None:
        return one
    extents = {
        name: replace(extent, error=abs(extent.peak - its.extents[name].peak))
        for name, extent in own.extents.items()
    }
    return replace(one, trajectory=replace(one.trajectory, observed=replace(own, extents=extents)))
