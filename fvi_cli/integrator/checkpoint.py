"""The state of a run between two blocks, from which it goes on as if it had never stopped."""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Checkpoint:
    """Everything that the steps to come depend on.

    Parameters
    ----------
    case, n_steps, step_size
        The run that it belongs to: method, N and h.
    step
        Number of finished steps.
    position_and_momentum, lost
        Of the unknown, in the coordinates of the steps, and what their compensated sums have lost
        to round-off, each of shape ``(q, 2 e)`` for q systems of e coupled components.
    states, states_lost
        The states of the memory, the same, ``(J, q e)``; J = 0 without memory.
    guess
        Where Newton's iteration begins, ``(1, d)``; of a general Lagrangian ``(1, 2 d)``; empty
        for linear scenes.
    stiffness
        The matrix that stands for the Hessian in it, ``(d, d)``, for a general Lagrangian below
        its mass matrix, ``(2 d, d)``; empty for linear scenes.
    pace
        Steps of its next block, most steps of later ones, and iterations beyond those that a new
        matrix would have saved; empty for linear scenes.
    """

    case: str
    n_steps: int
    step_size: float
    step: int
    position_and_momentum: Array
    lost: Array
    states: Array
    states_lost: Array
    guess: Array
    stiffness: Array
    pace: NDArray[np.int64]

    def to_bytes(self) -> bytes:
        """As an ``.npz`` file."""
        buffer = io.BytesIO()
        np.savez(
            buffer,
            case=np.array(self.case),
            n_steps=np.array(self.n_steps),
            step_size=np.array(self.step_size),
            step=np.array(self.step),
            position_and_momentum=self.position_and_momentum,
            lost=self.lost,
            states=self.states,
            states_lost=self.states_lost,
            guess=self.guess,
            stiffness=self.stiffness,
            pace=self.pace,
        )
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
                arrays = {field.name: found[field.name] for field in fields(cls)}
        except (KeyError, OSError, EOFError, ValueError, zipfile.BadZipFile) as error:
            raise ValueError(f"checkpoint: the bytes hold none ({error})") from error
        return cls(
            case=str(arrays["case"]),
            n_steps=int(arrays["n_steps"]),
            step_size=float(arrays["step_size"]),
            step=int(arrays["step"]),
            position_and_momentum=arrays["position_and_momentum"],
            lost=arrays["lost"],
            states=arrays["states"],
            states_lost=arrays["states_lost"],
            guess=arrays["guess"],
            stiffness=arrays["stiffness"],
            pace=arrays["pace"],
        )
