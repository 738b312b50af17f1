"""Where a run may stop and go on as if it had never stopped."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.run.loop import Marker
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Checkpoint:
    """Everything that the steps to come depend on, and the run that they belong to.

    Parameters
    ----------
    case, n_steps, step_size
        Method, number of reported steps, and T / N.
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
        run: tuple[str, int, float],
        *,
        place: tuple[int, int] = (0, 0),
        done: int,
        reported: int,
    ) -> Checkpoint:
        """Of a run that stands at `marker`, at a stretch and so many finished steps of it.

        The run is told by `case`, `n_steps` and `step_size`.
        """
        unknowns, (case, n_steps, step_size) = marker.unknowns, run
        return cls(
            case=case,
            n_steps=n_steps,
            step_size=step_size,
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
    def run(self) -> tuple[str, int, float]:
        """What tells the run: method, number of reported steps, and T / N."""
        return self.case, self.n_steps, self.step_size

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
