"""Batches: members of a sweep with one method and N, computed and stored together."""

from __future__ import annotations

from collections.abc import Sequence

from fvi_cli.studies.experiment import Experiment, Run
from fvi_cli.studies.members import members_at_a_time

Pack = tuple[object, ...]
Batch = tuple[Run, ...]

LEAST_PACK, LARGEST_PACK, PACKS = 8, 64, 16
"""Least and largest number of members of a pack; and number of packs into which smaller sweeps are
divided, for as many workers. Larger packs gain little, and an interruption loses a pack."""


FOR_OBSERVATIONS = 4
"""Factor in memory for a member whose steps are kept, with the series of their polynomials."""


def batches_of(runs: Sequence[Run]) -> list[tuple[Run, ...]]:
    """The runs in the groups that are computed together.

    A run that belongs to no sweep is a batch by itself. Members of a sweep are divided into packs,
    so that a batch on the finest grid takes at most
    :data:`fvi_cli.studies.members.BATCH_BYTES` of memory; a batch is one pack with one method and
    one number of steps. The last digits of a member depend on the other members of its batch; so
    the division depends only on the experiment, and numbers are the same wherever they are
    computed. The batches of a pack follow each other, since they share references.
    """
    packs: dict[Pack, dict[tuple[object, ...], list[Run]]] = {}
    for run in runs:
        packs.setdefault(pack_of(run), {}).setdefault((run.method, run.n_steps), []).append(run)
    return [tuple(batch) for pack in packs.values() for batch in pack.values()]


def pack_of(run: Run) -> Pack:
    """Key of the pack of a run: equal for all members of a pack, with any method and N."""
    if run.member is None:
        return run.experiment, run.method, run.n_steps
    if run.is_search:
        return run.experiment, run.member
    return run.experiment, run.member.number // pack_size(run.experiment)


def pack_size(experiment: Experiment) -> int:
    """Most members of a sweep that are computed together.

    It is 1 without a sweep, and with impacts, since members are then computed one by one.
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
    """Why members of a sweep are computed one by one; empty where they are batched."""
    if experiment.accuracy or not (experiment.members and experiment.observations.impacts):
        return ""
    return (
        f"the {len(experiment.members)} members are integrated one by one, because of "
        "`impacts`; without impacts they would be integrated in batches"
    )
