"""Batches: runs that are computed and stored together, here or in another process."""

from __future__ import annotations

import functools
import io
import pickle
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from fvi_cli.scenes.records.inputs import inputs_in, keep_numbers
from fvi_cli.scenes.registry import build_problem
from fvi_cli.storage.identity import identity_of, reference_identity_of
from fvi_cli.storage.parts import part_name, part_of, references_part_of
from fvi_cli.studies.experiment import Experiment, Run
from fvi_cli.studies.members import members_at_a_time
from fvi_cli.studies.reference import Reference, needs_dense_run, tabulated_references
from fvi_cli.studies.study import execute_batch

LARGEST_PACK = 256
"""Most members of a batch: 200 take half the time of four batches, and a kill loses a batch."""
MOST_RUNS, MOST_STEPS = 32, 4096
"""Runs by themselves share a batch up to so many runs and steps: a part costs some 5 ms."""
FOR_OBSERVATIONS = 4
"""Factor in memory for a member whose steps are kept, with the series of their polynomials."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """Runs that are computed and stored together, or one run of every scene for its reference."""

    runs: tuple[Run, ...]
    is_reference: bool = False
    references: Mapping[Run, Reference] = field(default_factory=dict)  # those that are known

    @functools.cached_property
    def identities(self) -> list[str]:
        """The keys of what it computes."""
        return list(map(reference_identity_of if self.is_reference else identity_of, self.runs))

    @property
    def name(self) -> str:
        """The name of its part: all machines that compute it write the same file."""
        return part_name(self.runs[0], self.identities)

    @property
    def n_steps(self) -> int:
        """Number of steps of all runs together."""
        return sum(run.n_steps for run in self.runs)


def batches_of(runs: Sequence[Run]) -> list[Batch]:
    """The runs in batches: members of a sweep by method and N, other runs as they come.

    The last digits of a member depend on the other members of its batch; so the division depends
    only on the experiment.
    """
    packs: dict[tuple[object, ...], list[Run]] = {}
    number = steps = 0
    pack: tuple[object, ...]
    for run in runs:
        if _is_together(run):
            pack = (run.experiment, _pack(run), run.method, run.n_steps)
        else:
            # a search may take long
            own = MOST_STEPS if run.is_search else run.n_steps
            steps += own
            if steps > MOST_STEPS or len(packs.get((run.experiment, number), ())) == MOST_RUNS:
                number, steps = number + 1, own
            pack = (run.experiment, number)
        packs.setdefault(pack, []).append(run)
    return [Batch(runs=tuple(own)) for own in packs.values()]


def reference_batches_of(runs: Sequence[Run]) -> list[Batch]:
    """Batches of the references of runs: one run for every scene that needs a reference run."""
    packs: dict[tuple[object, ...], dict[object, Run]] = {}
    for run in filter(needs_dense_run, runs):
        packs.setdefault((run.experiment, _pack(run)), {}).setdefault(run.member, run)
    return [Batch(runs=tuple(own.values()), is_reference=True) for own in packs.values()]


def _pack(run: Run) -> int:
    """The number of the batch of a member; on the finest grid it fits in memory."""
    experiment = run.experiment
    steps = max(experiment.steps, default=1)
    if not experiment.observations.is_empty:
        steps *= FOR_OBSERVATIONS
    most = min(LARGEST_PACK, members_at_a_time(steps, experiment.problem.dimension))
    return -1 if run.member is None else run.member.number // most


def _is_together(run: Run) -> bool:
    """Whether a run is integrated with others; impacts and tolerances choose steps of each."""
    chooses_steps = run.is_search or bool(run.experiment.observations.impacts)
    return run.member is not None and not chooses_steps


def compute(batch: Batch) -> bytes:
    """The part of a batch."""
    is_pack = _is_together(batch.runs[0])
    groups = [batch.runs] if is_pack else [(run,) for run in batch.runs]
    with warnings.catch_warnings():
        # overflows need no warning: the status of a run reports them
        warnings.simplefilter("ignore", RuntimeWarning)
        if batch.is_reference:
            return references_part_of(batch.runs, tabulated_references(batch.runs))
        finished = [
            one
            for own in groups
            for one in execute_batch(own, list(map(batch.references.get, own)))
        ]
    return part_of(batch.runs, finished)


# --- other processes ------------------------------------------------------------------------------


class _Pickler(pickle.Pickler):
    """Leaves out the problem of an experiment, which the receiver builds from its specification."""

    def reducer_override(self, value: Any) -> Any:
        return (_revived, (_described(value),)) if isinstance(value, Experiment) else NotImplemented


def packed(batch: Batch) -> bytes:
    """A batch for another process."""
    buffer = io.BytesIO()
    _Pickler(buffer).dump(batch)
    return buffer.getvalue()


def compute_packed(sent: bytes) -> bytes:
    """The part of a batch that another process has sent."""
    return compute(pickle.loads(sent))  # noqa: S301 - made by the parent process


@functools.lru_cache(maxsize=8)
def _described(experiment: Experiment) -> bytes:
    """An experiment without problem and members; the same bytes for all of its batches."""
    values = {one.name: getattr(experiment, one.name) for one in fields(experiment)}
    kept = {
        name: dict(value) if isinstance(value, Mapping) else value
        for name, value in values.items()
        if name not in ("problem", "members")
    }
    given = [experiment.problem_specification, *(one.values for one in experiment.members)]
    return pickle.dumps((kept, dict(inputs_in(given))))


@functools.lru_cache(maxsize=8)
def _revived(described: bytes) -> Experiment:
    """The inverse of :func:`_described`; builds the problem."""
    values, inputs = pickle.loads(described)  # noqa: S301 - made by the parent process
    for numbers in inputs.values():
        keep_numbers(numbers)
    return Experiment(problem=build_problem(values["problem_specification"]), **values)
