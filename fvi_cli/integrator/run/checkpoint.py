"""Runs that were stopped: their state as arrays with names, and files that hold them."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import IO, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import as_csr, is_sparse
from fvi_cli.integrator.meshes.mesh import Mesh

OF_ANOTHER_RUN = "it belongs to another run, or to another version of the solver"

Arrays = Mapping[str, NDArray[Any]]

RunKey = tuple[str, int, float, str]
"""Method, number of reported steps, their size or tolerance, and `fingerprint`."""

_HEAD = ("label", "seconds", "case", "n_steps", "step_size", "fingerprint", "done", "reported")


def fingerprint(*values: object) -> str:
    """SHA-256 of all that determines the numbers of a run: scene, method, and mesh or tolerance.

    Arrays count by their bytes, dataclasses by their fields, functions by their names only.
    """
    digest = hashlib.sha256()
    for part in _parts(values):
        digest.update(part + b";")
    return digest.hexdigest()


def _parts(value: object) -> Iterator[bytes]:
    """Bytes that distinguish a value from others."""
    yield type(value).__name__.encode()
    if isinstance(value, Mesh):
        yield np.array(
            [
                (s.begin, s.end, s.n_steps, s.step_size, s.reported_every, s.is_fresh)
                for s in value.stretches
            ]
        ).tobytes()
    elif is_sparse(value):
        matrix: Any = as_csr(value)  # type: ignore[arg-type]
        yield from _parts((matrix.shape, matrix.indptr, matrix.indices, matrix.data))
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype.str} {value.shape}".encode()
        yield value.tobytes()
    elif is_dataclass(value):
        for one in fields(value):
            yield one.name.encode()
            yield from _parts(getattr(value, one.name))
    elif isinstance(value, Mapping):
        yield from _parts(list(value.items()))
    elif isinstance(value, list | tuple):
        for one in value:
            yield from _parts(one)
    elif value is None or isinstance(value, str | bool | int | float):
        yield repr(value).encode()
    else:
        yield getattr(value, "__qualname__", "").encode()


@dataclass(frozen=True, kw_only=True, eq=False)
class Checkpoint:
    """Everything that later steps depend on, and the run that they belong to."""

    run: RunKey
    done: int  # finished steps and reported points of the whole run
    reported: int
    arrays: Arrays  # the state by name, from the parts of the loop
    # all results of these steps for the trajectory, by name, and their time; in a run in parts
    # each part has its own
    kept: Arrays = field(default_factory=dict)
    seconds: float = 0.0

    def write(self, stream: IO[bytes], label: str) -> None:
        """Write an ``.npz`` file with the label of its run and a SHA-256 of all that is in it.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        head = (label, self.seconds, *self.run, self.done, self.reported)
        arrays = {
            **{name: np.array(value) for name, value in zip(_HEAD, head, strict=True)},
            **{f"state {name}": np.asarray(one) for name, one in self.arrays.items()},
            **{f"kept {name}": np.asarray(one) for name, one in self.kept.items()},
        }
        np.savez(stream, digest=np.array(arrays_digest(arrays)), **arrays)  # type: ignore[arg-type]

    @classmethod
    def read(cls, stream: IO[bytes], label: str) -> Checkpoint:
        """Read and verify a file of :meth:`write`.

        Raises
        ------
        ValueError
            If it is damaged, or of another run.
        """
        try:
            with np.load(stream, allow_pickle=False) as found:
                arrays = {name: found[name] for name in found.files}
        except Exception as error:
            # a damaged archive makes the library raise nearly anything
            raise ValueError(f"it is damaged ({type(error).__name__})") from error
        if missing := [name for name in ("digest", *_HEAD) if name not in arrays]:
            raise ValueError(f"it is of another version ({missing[0]} is missing)")
        if str(arrays.pop("digest")) != arrays_digest(arrays):
            raise ValueError("it is damaged (its checksum is not that of its content)")
        owner, seconds, *run, done, reported = (arrays[name].item() for name in _HEAD)
        if owner != label:
            raise ValueError(OF_ANOTHER_RUN)
        case, n_steps, step_size, key = run
        return cls(
            run=(case, n_steps, step_size, key),
            done=done,
            reported=reported,
            arrays=_with_prefix("state ", arrays),
            kept=_with_prefix("kept ", arrays),
            seconds=seconds,
        )

    def to_bytes(self) -> bytes:
        """The checkpoint as an ``.npz`` file."""
        buffer = io.BytesIO()
        self.write(buffer, "")
        return buffer.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes) -> Checkpoint:
        """The checkpoint in the bytes of :meth:`to_bytes`.

        Raises
        ------
        ValueError
            If the bytes hold no checkpoint, or a damaged one.
        """
        try:
            return cls.read(io.BytesIO(data), "")
        except ValueError as error:
            raise ValueError(f"checkpoint: these bytes are not a checkpoint: {error}") from error


class RunKeeper(Protocol):
    """Where one run keeps its checkpoint."""

    def load(self) -> Checkpoint | None:
        """The checkpoint that was kept; None if there is no valid one."""

    def reject(self, reason: str) -> None:
        """Report why the checkpoint that was kept is not used."""

    def is_due(self) -> bool:
        """Whether it is time to keep a checkpoint."""

    def is_kept_whole(self, seconds: float) -> bool:
        """Whether a run that took `seconds` is kept after its end, since others follow."""

    def save(self, checkpoint: Checkpoint) -> None:
        """Keep a checkpoint in place of the one before."""

    def of_run(self, name: str) -> RunKeeper:
        """The keeper of one of the runs of this search or batch."""


def keeper_of_run(checkpoints: RunKeeper | None, name: str) -> RunKeeper | None:
    """The keeper of one of several runs; None if no checkpoints are kept."""
    return None if checkpoints is None else checkpoints.of_run(name)


def _with_prefix(prefix: str, arrays: Arrays) -> dict[str, NDArray[Any]]:
    return {
        name.removeprefix(prefix): one for name, one in arrays.items() if name.startswith(prefix)
    }


def arrays_digest(arrays: Arrays) -> str:
    """SHA-256 of names, types, shapes and numbers."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        values = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {arrays[name].dtype.str} {arrays[name].shape};".encode())
        # a view of bytes: texts have no buffer of their own
        digest.update(values.reshape(-1).view(np.uint8).data)
    return digest.hexdigest()
