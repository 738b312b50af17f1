"""Where a run may stop and go on as if it had never stopped."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from fvi_cli.effects.matrices import as_csr, is_sparse
from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.run.loop import Marker
from fvi_cli.mathematics.arrays import Array

RunKey = tuple[str, int, float, str]
"""Method, number of reported steps, their size or the tolerance of theirs, and `fingerprint`."""


def fingerprint(*values: object) -> str:
    """SHA-256 of what determines the numbers of a run: its scene, method, and mesh or tolerance.

    Arrays count by their bytes, what is described by its fields, functions by their names only.
    """
    digest = hashlib.sha256()
    for part in _parts(values):
        digest.update(part + b";")
    return digest.hexdigest()


def _parts(value: object) -> Iterator[bytes]:
    """What is told apart of a value."""
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
        for field in fields(value):
            yield field.name.encode()
            yield from _parts(getattr(value, field.name))
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
    """Everything that the steps to come depend on, and the run that they belong to.

    Parameters
    ----------
    case, n_steps, step_size, fingerprint
        The `RunKey` of the run.
    stretch, step
        Place in the mesh: stretch, and finished steps of it.
    done, reported
        Finished steps and reported points of the whole run.
    position, momentum, position_lost, momentum_lost
        Compensated sums, shape ``(d,)`` each.
    states
        States of the damping, shape ``(J, columns)``.
    unknowns, last_step
        Polynomial of the last single step, ``(s, d)``, and its size; empty after blocks.
    """

    case: str
    n_steps: int
    step_size: float
    fingerprint: str
    stretch: int
    step: int
    done: int
    reported: int
    time: float
    position: Array
    momentum: Array
    position_lost: Array
    momentum_lost: Array
    states: Array
    unknowns: Array
    last_step: float

    @classmethod
    def taken(
        cls,
        marker: Marker,
        run: RunKey,
        *,
        place: tuple[int, int] = (0, 0),
        done: int,
        reported: int,
    ) -> Checkpoint:
        """Of a run that stands at `marker`, at a stretch and so many finished steps of it."""
        unknowns, (case, n_steps, step_size, key) = marker.unknowns, run
        return cls(
            case=case,
            n_steps=n_steps,
            step_size=step_size,
            fingerprint=key,
            stretch=place[0],
            step=place[1],
            done=done,
            reported=reported,
            time=marker.time,
            position=marker.position.value.copy(),
            momentum=marker.momentum.value.copy(),
            position_lost=marker.position.lost.copy(),
            momentum_lost=marker.momentum.lost.copy(),
            states=marker.states.copy(),
            unknowns=np.zeros((0, marker.position.value.size))
            if unknowns is None
            else unknowns.copy(),
            last_step=marker.step_size,
        )

    @property
    def run(self) -> RunKey:
        """What tells the run."""
        return self.case, self.n_steps, self.step_size, self.fingerprint

    def marker(self) -> Marker:
        """The state from which the steps go on."""
        return Marker(
            time=self.time,
            position=CompensatedSum(self.position, self.position_lost),
            momentum=CompensatedSum(self.momentum, self.momentum_lost),
            states=self.states.copy(),
            unknowns=self.unknowns.copy() if self.unknowns.size else None,
            step_size=self.last_step,
        )

    def to_bytes(self) -> bytes:
        """As an ``.npz`` file."""
        buffer = io.BytesIO()
        arrays: dict[str, Any] = {
            one.name: np.array(getattr(self, one.name)) for one in fields(self)
        }
        np.savez(buffer, **arrays)
        return buffer.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes) -> Checkpoint:
        """From what `to_bytes` gave.

        Raises
        ------
        ValueError
            If the bytes hold no checkpoint.
        """
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as found:
                arrays = {one.name: found[one.name] for one in fields(cls)}
        except (KeyError, OSError, EOFError, ValueError, zipfile.BadZipFile) as error:
            raise ValueError(f"checkpoint: the bytes hold none ({error})") from error
        return cls(**{name: one.item() if one.ndim == 0 else one for name, one in arrays.items()})
