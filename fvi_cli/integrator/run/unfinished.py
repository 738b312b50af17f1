"""Runs that keep a checkpoint while they go on, and go on from it when they were stopped."""

from __future__ import annotations

import hashlib
import time as clock
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import IO, Protocol

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.run.checkpoint import Checkpoint
from fvi_cli.integrator.run.loop import Marker
from fvi_cli.integrator.run.march import March
from fvi_cli.integrator.run.setup import RunSetup, first_marker
from fvi_cli.integrator.run.sink import Sink
from fvi_cli.integrator.trajectory import NewtonRecord

Array = NDArray[np.float64]

OF_ANOTHER_RUN = "it belongs to another run, or to another version of the solver"

_KEPT = "kept_"
_NEWTON = ("iterations", "largest", "worst_step", "worst_residuals")


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
        if str(arrays["label"]) != label:
            raise ValueError(OF_ANOTHER_RUN)
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

    def save(self, unfinished: UnfinishedRun) -> None:
        """Keep a checkpoint in place of the one before."""


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
    n_steps, method, earlier = mesh.n_reported, setup.method, 0.0
    step_size = setup.scene.final_time / max(n_steps, 1)
    marker = first_marker(setup)
    following: tuple[int, int] | None = (0, 0)
    found = checkpoints.load()
    if found is not None:
        at = found.checkpoint
        asked = (method.case, n_steps, step_size, marker.states.shape)
        if (at.case, at.n_steps, at.step_size, at.states.shape) != asked:
            checkpoints.reject(OF_ANOTHER_RUN)
            found = None
    if found is None:
        sink.begin(0.0, marker.position.value, marker.momentum.value)
    else:
        at, newton = found.checkpoint, found.newton
        marker, following, earlier = at.marker(), (at.stretch, at.step), found.seconds
        sink.restore(found.kept, reported=at.reported)
        march.done, march.operations = at.done, found.operations
        march.course.iterations, march.course.most_iterations = newton.iterations, newton.largest
        march.course.worst_step = newton.worst_step
        march.course.worst_residuals = newton.worst_residuals
    began = clock.perf_counter()
    while following is not None:
        stretch, step = following
        following = march.run(marker, stretch=stretch, step=step, until=march.done + 1)
        if following is not None and checkpoints.is_due():
            checkpoints.save(
                UnfinishedRun(
                    checkpoint=Checkpoint.taken(
                        marker,
                        case=method.case,
                        n_steps=n_steps,
                        step_size=step_size,
                        place=following,
                        done=march.done,
                        reported=sink.reported,
                    ),
                    kept=sink.kept(),
                    newton=march.course.newton,
                    operations=march.operations,
                    seconds=earlier + clock.perf_counter() - began,
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
