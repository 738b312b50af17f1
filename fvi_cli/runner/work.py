"""Batches: runs that are computed and stored together, here or in another process."""

from __future__ import annotations

import functools
import io
import logging
import pickle
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import fvi_cli
from fvi_cli.errors import ExecutorError
from fvi_cli.integrator.integrate import batch_kind
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.records.inputs import inputs_in, keep_numbers
from fvi_cli.scenes.registry import build_problem
from fvi_cli.storage.identity import SOLVER_VERSION
from fvi_cli.storage.parts import part_name, part_of, references_part_of
from fvi_cli.storage.provenance import origin_text
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.members import members_at_a_time
from fvi_cli.studies.reference import Reference, needs_refined_run, refined_references
from fvi_cli.studies.study import execute_batch

_logger = logging.getLogger(__name__)
T = TypeVar("T")

LARGEST_PACK = 64
"""Most members of a batch: larger ones gain little, and a kill loses a batch."""
MOST_RUNS, MOST_STEPS = 32, 4096
"""Runs without a sweep share a batch up to so many runs and steps: a part costs some 5 ms."""
FOR_OBSERVATIONS = 4
"""Factor in memory for a member whose steps are kept, with the series of their polynomials."""
VERSION = f"fvi {fvi_cli.__version__} (solver {SOLVER_VERSION})"


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """Runs that are computed and stored together, or one run of every scene for its reference."""

    runs: tuple[Run, ...]
    is_reference: bool = False
    references: Mapping[Run, Reference | None] = field(default_factory=dict)  # those that are known
    origin: str = field(default_factory=origin_text)  # provenance, as JSON text

    @property
    def name(self) -> str:
        """The name of its part."""
        return part_name(self.runs, "reference" if self.is_reference else "")

    @property
    def n_steps(self) -> int:
        """Number of steps of all runs together."""
        return sum(run.n_steps for run in self.runs)


@dataclass(frozen=True, kw_only=True)
class Computed:
    """The part of a batch, and why some of its runs, by their places, are not in it."""

    part: bytes
    lost: Mapping[int, str] = field(default_factory=dict)


def batches_of(runs: Sequence[Run]) -> list[Batch]:
    """The runs in batches.

    Members of a sweep with one method and N are divided so that a batch on the finest grid takes at
    most :data:`fvi_cli.studies.members.BATCH_BYTES` of memory. The last digits of a member depend
    on the other members of its batch; so the division depends only on the experiment.
    """
    packs: dict[tuple[object, ...], list[Run]] = {}
    shared: list[Run] = []
    found: list[Batch] = []
    for run in runs:
        if run.member is not None and not run.is_search:
            pack = run.member.number // pack_size(run.experiment)
            packs.setdefault((run.experiment, pack, run.method, run.n_steps), []).append(run)
            continue
        steps = sum(one.n_steps for one in (*shared, run))
        if shared and (run.is_search or len(shared) == MOST_RUNS or steps > MOST_STEPS):
            found.append(Batch(runs=tuple(shared)))
            shared = []
        shared.append(run)
    found += [Batch(runs=tuple(shared))] if shared else []
    return found + [Batch(runs=tuple(own)) for own in packs.values()]


def reference_batches_of(runs: Sequence[Run]) -> list[Batch]:
    """Batches of the references of runs: one run for every scene that needs a reference run."""
    packs: dict[tuple[object, ...], dict[object, Run]] = {}
    for run in filter(needs_refined_run, runs):
        number = -1 if run.member is None else run.member.number // pack_size(run.experiment)
        packs.setdefault((run.experiment, number), {}).setdefault(run.member, run)
    return [Batch(runs=tuple(own.values()), is_reference=True) for own in packs.values()]


def pack_size(experiment: Experiment) -> int:
    """Most members of a sweep that are computed together."""
    if one_by_one_words(experiment):
        return 1
    steps = max(experiment.steps, default=1)
    if not experiment.observations.is_empty:
        steps *= FOR_OBSERVATIONS
    return min(LARGEST_PACK, members_at_a_time(steps, experiment.problem.dimension))


@functools.lru_cache(maxsize=64)
def one_by_one_words(experiment: Experiment) -> str:
    """Why members of a sweep are integrated one by one; empty where they are a batch."""
    scene, reason = experiment.problem.scene, ""
    if not experiment.members or scene is None:
        return ""
    if experiment.accuracy is not None:
        reason = "a tolerance chooses steps for each"
    elif experiment.observations.impacts:
        reason = "impacts cut the steps of each"
    elif experiment.grading != 1.0:
        reason = "graded meshes are made for each"
    elif all(
        not isinstance(one, Method) or batch_kind(scene, one, max(experiment.steps)) is None
        for one in experiment.methods
    ):
        reason = "their steps have too many unknowns, or the method takes single scenes"
    return f"{len(experiment.members)} members are integrated one by one: {reason}" * bool(reason)


def compute(batch: Batch) -> Computed:
    """Compute a batch; what fails for a mistake of the program costs only its own runs."""
    # overflows need no warning: the status of a run reports them
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    if batch.is_reference:
        references, failed = _soundly(refined_references, batch.runs)
        runs = [run for place, run in enumerate(batch.runs) if place not in failed]
        return Computed(part=references_part_of(runs, references), lost=failed)
    groups: dict[tuple[object, ...], list[Run]] = {}
    for run in batch.runs:
        alone = run if run.member is None or run.is_search else None
        groups.setdefault((run.experiment, run.method, run.n_steps, alone), []).append(run)
    asked: list[Run] = []
    finished: list[FinishedRun] = []
    lost: dict[int, str] = {}
    places = {run: place for place, run in enumerate(batch.runs)}
    for own in groups.values():
        results, failed = _soundly(lambda runs: _executed(runs, batch.references), own)
        lost |= {places[own[place]]: message for place, message in failed.items()}
        asked += [run for place, run in enumerate(own) if place not in failed]
        finished += results
    return Computed(part=part_of(asked, finished, batch.origin), lost=lost)


def _executed(runs: Sequence[Run], references: Mapping[Run, Reference | None]) -> list[FinishedRun]:
    known = [references.get(run) for run in runs]
    return execute_batch(runs, known, log=lambda line: _logger.debug("%s: %s", runs[0].name, line))


def _soundly(
    work: Callable[[Sequence[Run]], Sequence[T]], runs: Sequence[Run]
) -> tuple[list[T], dict[int, str]]:
    """The results of runs; where a mistake stops all, those of each alone, and what failed."""
    try:
        return list(work(runs)), {}
    except Exception as error:
        if len(runs) == 1:
            return [], {0: crash_of(runs[0], error)}
    found: list[T] = []
    lost: dict[int, str] = {}
    for place, run in enumerate(runs):
        results, failed = _soundly(work, [run])
        found += results
        lost |= dict.fromkeys([place] * len(failed), "".join(failed.values()))
    return found, lost


def crash_of(run: Run, error: BaseException) -> str:
    """The message on an exception; its traceback is logged at the debug level."""
    if isinstance(error, MemoryError):
        return "not enough memory" + (f": {error}" if str(error) else "")
    package = Path(fvi_cli.__file__).parent
    frames = [
        f" in {Path(one.filename).relative_to(package.parent).as_posix()}:{one.lineno}"
        for one in traceback.extract_tb(error.__traceback__)
        if package in Path(one.filename).parents
    ]
    _logger.debug("%s: %s", run.title, "".join(traceback.format_exception(error)))
    return (
        f"unexpected {type(error).__name__}{frames[-1] if frames else ''}: {error}; "
        "this is a mistake of the program, please report it with the configuration"
    )


def lost_run(run: Run, message: str) -> FinishedRun:
    """A finished run with status ``failed`` that has only its start and the message."""
    scene = run.problem.scene
    start = np.zeros(1) if scene is None else scene.initial_position
    trajectory = Trajectory(
        time=np.zeros(1), position=start[None], n_steps=run.n_steps, step_size=run.step_size,
        status="failed", message=message,
    )  # fmt: skip
    return FinishedRun(
        run=run, trajectory=trajectory, error=float("nan"), floor=0.0, status="failed"
    )


# --- other processes ------------------------------------------------------------------------------


class _Pickler(pickle.Pickler):
    """Leaves out the problem of an experiment, which the receiver builds from its specification."""

    def reducer_override(self, value: Any) -> Any:
        return (_revived, (_described(value),)) if isinstance(value, Experiment) else NotImplemented


def packed(batch: Batch) -> tuple[str, bytes]:
    """A batch for another process, with the version of the program that sends it."""
    buffer = io.BytesIO()
    _Pickler(buffer).dump(batch)
    return VERSION, buffer.getvalue()


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


def compute_packed(sent: tuple[str, bytes]) -> Computed:
    """Compute a batch that another process has sent.

    Raises
    ------
    ExecutorError
        If the sender has another version, whose numbers may differ.
    """
    version, content = sent
    if version != VERSION:
        raise ExecutorError(f"it has {VERSION} in place of {version}; install the same everywhere")
    return compute(pickle.loads(content))  # noqa: S301 - made by the parent process
