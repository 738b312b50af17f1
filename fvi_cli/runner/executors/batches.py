"""Runs that are computed, and stored, together: members of a sweep that share method and N."""

from __future__ import annotations

from collections.abc import Sequence

from fvi_cli.studies.experiment import Experiment, Run
from fvi_cli.studies.members import members_at_a_time

Pack = tuple[object, ...]
Batch = tuple[Run, ...]

LEAST_PACK, LARGEST_PACK, PACKS = 8, 64, 16
"""Batched members gain little beyond the largest pack, which is what a worker takes, and what
an interruption loses; smaller sweeps are dealt into so many packs, for that many workers."""


FOR_OBSERVATIONS = 4
"""So many times the memory takes a member whose steps are kept, with those of a second run."""


def batches_of(runs: Sequence[Run]) -> list[tuple[Run, ...]]:
    """The runs in the groups that are computed together.

    A run that belongs to no sweep stands alone, in its place. Members of a sweep are dealt into
    packs, so that a batch on the finest grid takes at most
    :data:`fvi_cli.studies.members.BATCH_BYTES` of memory; a batch is one pack with one method and
    one number of steps. Who is in a pack depends on the experiment alone, for the last digits of a
    member depend on its neighbours: the numbers are the same wherever they are computed. The
    batches of a pack follow each other, for they share what errors are measured against.
    """
    packs: dict[Pack, dict[tuple[object, ...], list[Run]]] = {}
    for run in runs:
        packs.setdefault(pack_of(run), {}).setdefault((run.method, run.n_steps), []).append(run)
    return [tuple(batch) for pack in packs.values() for batch in pack.values()]


def pack_of(run: Run) -> Pack:
    """Which runs stay together: the same for all members of a pack, with any method and N."""
    if run.member is None:
        return run.experiment, run.method, run.n_steps
    if run.is_search:
        return run.experiment, run.member
    return run.experiment, run.member.number // pack_size(run.experiment)


def pack_size(experiment: Experiment) -> int:
    """How many members of a sweep are computed together at most; 1 where nothing is swept.

    Also 1 where impacts are asked for: these members share nothing.
    """
    if one_by_one_words(experiment):
        return 1
    members = max(1, len(experiment.members))
    shared = max(LEAST_PACK, -(-members // PACKS))
    steps = max(experiment.steps, default=1)
    if not experiment.observations.is_empty:
        steps *= FOR_OBSERVATIONS
    together = members_at_a_time(steps, experiment.problem.dimension)
    return min(members, shared, LARGEST_PACK, together)


def one_by_one_words(experiment: Experiment) -> str:
    """Why members of a sweep share nothing; empty where they may."""
    if experiment.accuracy or not (experiment.members and experiment.observations.impacts):
        return ""
    return (
        f"the {len(experiment.members)} members are integrated one by one, because of "
        "`impacts`; without impacts they would be integrated in batches"
    )
