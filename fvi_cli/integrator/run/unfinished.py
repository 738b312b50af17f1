"""Runs that keep a checkpoint while they go on, and go on from it when they were stopped."""

from __future__ import annotations

import hashlib
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import IO, Protocol

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.results.newton_record import NewtonRecord
from fvi_cli.integrator.run.checkpoint import Checkpoint, RunKey, fingerprint
from fvi_cli.integrator.run.loop import Course, Marker
from fvi_cli.integrator.run.march import March
from fvi_cli.integrator.run.setup import RunSetup, first_marker
from fvi_cli.integrator.run.sink import Sink
from fvi_cli.mathematics.arrays import Array

OF_ANOTHER_RUN = "it belongs to another run, or to another version of the solver"

_KEPT = "kept_"
_NEWTON = ("iterations", "largest", "worst_step", "worst_residuals")
_FIELDS = ("checkpoint", "operations", "seconds")
_POINTS = tuple(f"{_KEPT}{name}" for name in ("times", "positions", "momenta"))


@dataclass(frozen=True, kw_only=True, eq=False)
class UnfinishedRun:
    """A run up to a checkpoint, with all that its trajectory will say of these steps.

    Parameters
    ----------
    checkpoint
        From where its steps go on.
    kept
        Points that are kept so far, by name, as :meth:`fvi_cli.integrator.run.sink.Sink.kept` has
        them.
    newton
        Record of Newton's iteration so far.
    operations
        Multiply-adds of the memory so far.
    seconds
        Time for the steps so far.
    """

    checkpoint: Checkpoint
    kept: Mapping[str, Array]
    newton: NewtonRecord
    operations: int
    seconds: float

    def write(self, stream: IO[bytes], label: str) -> None:
        """As an ``.npz`` file, with whose run it is and a SHA-256 of everything in it.

        Parameters
        ----------
        stream
            Open for writing.
        label
            Whose run it is.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        arrays: dict[str, NDArray[np.generic]] = {
            "label": np.array(label),
            "checkpoint": np.frombuffer(self.checkpoint.to_bytes(), dtype=np.uint8),
            "operations": np.array(self.operations),
            "seconds": np.array(self.seconds),
            **{name: np.array(value) for name, value in asdict(self.newton).items()},
            **{f"{_KEPT}{name}": value for name, value in self.kept.items()},
        }
        np.savez(stream, digest=np.array(_digest(arrays)), **arrays)  # type: ignore[arg-type]

    @classmethod
    def read(cls, stream: IO[bytes], label: str) -> UnfinishedRun:
        """What :meth:`write` wrote, verified.

        Raises
        ------
        ValueError
            If it is damaged or another run's.
        """
        try:
            with np.load(stream, allow_pickle=False) as found:
                arrays = {name: found[name] for name in found.files}
        except Exception as error:
            # a damaged archive makes the library raise nearly anything
            raise ValueError(f"it is damaged ({type(error).__name__})") from error
        digest = str(arrays.pop("digest", ""))
        if _digest(arrays) != digest:
            raise ValueError("it is damaged (its checksum is not that of its content)")
        if str(arrays.get("label")) != label:
            raise ValueError(OF_ANOTHER_RUN)
        missing = [name for name in (*_FIELDS, *_NEWTON, *_POINTS) if name not in arrays]
        if missing:
            raise ValueError(f"it is of another version ({missing[0]} is missing)")
        iterations, largest, worst, residuals = (arrays[name] for name in _NEWTON)
        return cls(
            checkpoint=Checkpoint.from_bytes(arrays["checkpoint"].tobytes()),
            kept={
                name.removeprefix(_KEPT): values
                for name, values in arrays.items()
                if name.startswith(_KEPT)
            },
            newton=NewtonRecord(
                iterations=int(iterations),
                largest=int(largest),
                worst_step=int(worst),
                worst_residuals=tuple(map(float, residuals)),
            ),
            operations=int(arrays["operations"]),
            seconds=float(arrays["seconds"]),
        )


class RunKeeper(Protocol):
    """Where one run keeps its checkpoint."""

    def load(self) -> UnfinishedRun | None:
        """What was kept; None if nothing was, or nothing that can be believed."""

    def reject(self, reason: str) -> None:
        """Say why what was kept is of no use."""

    def is_due(self) -> bool:
        """Whether it is time to keep a checkpoint."""

    def is_kept_whole(self, seconds: float) -> bool:
        """Whether a run that took so long is kept when it has ended, since others follow."""

    def save(self, unfinished: UnfinishedRun) -> None:
        """Keep a checkpoint in place of the one before."""

    def part(self, name: str) -> RunKeeper:
        """Where one of several runs, of which this one is made, keeps its own."""


def part_of(checkpoints: RunKeeper | None, name: str) -> RunKeeper | None:
    """Where one of several runs keeps its checkpoint; None: nowhere."""
    return None if checkpoints is None else checkpoints.part(name)


class CourseKeeper:
    """The checkpoint of a run whose steps are found one after the other.

    Parameters
    ----------
    keeper
        Where it is kept; None: nowhere.
    marker, course
        The run at its start; they are brought to where it was stopped.
    asked
        Method, number of steps that are asked for, and their size, or the tolerance of theirs.
    determined_by
        What determines the numbers of the run beside these.
    needs
        Names of what else is kept.

    Attributes
    ----------
    found
        What else was kept, by name; nothing for a run that begins at its start.
    earlier_seconds
        Time of the steps before the checkpoint.
    """

    def __init__(
        self,
        keeper: RunKeeper | None,
        marker: Marker,
        course: Course,
        asked: tuple[str, int, float],
        determined_by: tuple[object, ...],
        needs: tuple[str, ...],
    ) -> None:
        self._keeper, self._marker, self._course = keeper, marker, course
        # a run without a keeper needs none
        self._asked = (*asked, "" if keeper is None else fingerprint(*determined_by))
        self.found: Mapping[str, Array] = {}
        self.earlier_seconds = 0.0
        needs = ("sizes", "unknowns", "infinite", *needs)
        found = None if keeper is None else _believed(keeper, self._asked, marker, needs)
        if found is not None:
            self.found, self.earlier_seconds = found.kept, found.seconds
            vars(marker).update(vars(found.checkpoint.marker()))
            course.restore(found.newton, found.kept)
        self._taken_up = len(course.sizes)
        self._began = clock.perf_counter()

    def offer(self, further: Callable[[], Mapping[str, Array]], *, has_ended: bool = False) -> None:
        """Behind a step, or the last one: keep a checkpoint, with further state, if it is due."""
        keeper, done = self._keeper, len(self._course.sizes)
        if keeper is None or done == self._taken_up:
            return
        seconds = self.earlier_seconds + clock.perf_counter() - self._began
        if not (keeper.is_kept_whole(seconds) if has_ended else keeper.is_due()):
            return
        _, n_steps, step_size, _ = self._asked
        reported = int(self._marker.time / step_size) if n_steps else done
        keeper.save(
            UnfinishedRun(
                checkpoint=Checkpoint.taken(
                    self._marker, self._asked, done=done, reported=reported
                ),
                kept={**self._course.kept(), **further()},
                newton=self._course.newton,
                operations=0,
                seconds=seconds,
            )
        )


def _believed(
    keeper: RunKeeper, asked: RunKey, start: Marker, needs: tuple[str, ...] = ()
) -> UnfinishedRun | None:
    """What was kept of the run that is asked for; None otherwise."""
    found = keeper.load()
    if found is not None:
        at = found.checkpoint
        begin = start.position.value
        kept = (at.states, at.position, at.momentum, at.position_lost, at.momentum_lost)
        shapes = [start.states.shape, *(4 * [begin.shape])]
        is_whole = found.kept.keys() >= set(needs)
        if is_whole and at.run == asked and [one.shape for one in kept] == shapes:
            return found
        keeper.reject(OF_ANOTHER_RUN)
    return None


def march_with_checkpoints(
    setup: RunSetup, mesh: Mesh, sink: Sink, march: March, checkpoints: RunKeeper
) -> tuple[Marker, float]:
    """The steps of a run from its checkpoint on, or from the start, with a new one now and then.

    Parameters
    ----------
    setup, mesh, sink
        What is ready, where steps are, and what keeps the points.
    march
        Of these; nothing of it is done.
    checkpoints
        Where they are kept.

    Returns
    -------
    tuple of Marker and float
        Where the run is after its steps, and the seconds that steps took before the checkpoint.
    """
    n_steps, earlier = mesh.n_reported, 0.0
    key = fingerprint(setup.scene, setup.method, mesh)
    asked = (setup.method.case, n_steps, setup.scene.final_time / max(n_steps, 1), key)
    marker = first_marker(setup)
    following: tuple[int, int] | None = (0, 0)
    end = (len(mesh.stretches), 0)
    found = _believed(checkpoints, asked, marker)
    if found is None:
        sink.begin(0.0, marker.position.value, marker.momentum.value)
    else:
        at = found.checkpoint
        marker, following, earlier = at.marker(), (at.stretch, at.step), found.seconds
        following = None if following == end else following
        sink.restore(found.kept, reported=at.reported)
        march.done, march.operations = at.done, found.operations
        march.course.restore(found.newton)
    began = clock.perf_counter()
    while following is not None:
        stretch, step = following
        following = march.run(marker, stretch=stretch, step=step, until=march.done + 1)
        seconds = earlier + clock.perf_counter() - began
        is_whole = following is None and not march.failure
        if (is_whole and checkpoints.is_kept_whole(seconds)) or (
            following and checkpoints.is_due()
        ):
            checkpoints.save(
                UnfinishedRun(
                    checkpoint=Checkpoint.taken(
                        marker,
                        asked,
                        place=following or end,
                        done=march.done,
                        reported=sink.reported,
                    ),
                    kept=sink.kept(),
                    newton=march.course.newton,
                    operations=march.operations,
                    seconds=seconds,
                )
            )
    return marker, earlier


def _digest(arrays: Mapping[str, NDArray[np.generic]]) -> str:
    """SHA-256 of names, types, shapes and numbers."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        values = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {arrays[name].dtype.str} {arrays[name].shape};".encode())
        # a view of bytes: texts have no buffer of their own
        digest.update(values.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()
