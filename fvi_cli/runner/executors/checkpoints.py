"""Checkpoints of runs that are not finished, beside the parts of a result file."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from fvi_cli.integrator.run.unfinished import UnfinishedRun
from fvi_cli.storage.atomic import reason, replacement
from fvi_cli.storage.files import CHECKPOINT_SUFFIX, checkpoint_paths, remove_checkpoints
from fvi_cli.storage.provenance import identity
from fvi_cli.studies.experiment import Run

_logger = logging.getLogger(__name__)

LEAST_RATIO = 20.0
"""Writing a checkpoint takes at most this part of the time: one that is long to write is rare."""


@dataclass(frozen=True, kw_only=True)
class CheckpointFolder:
    """Where runs of a result file keep their checkpoints.

    Parameters
    ----------
    folder
        That of the parts.
    seconds
        Between two checkpoints of a run, at least.
    """

    folder: Path
    seconds: float

    def of(self, run: Run) -> CheckpointFile:
        """The checkpoint of one run, which need not be there."""
        return CheckpointFile(
            path=self.folder / f"{identity(run)}{CHECKPOINT_SUFFIX}",
            title=run.title,
            label=identity(run),
            seconds=self.seconds,
        )

    def unfinished(self, runs: Iterable[Run]) -> dict[Run, int]:
        """How many steps are done of those runs that have a checkpoint to be believed."""
        if not checkpoint_paths(self.folder):
            return {}
        found = {run: self.of(run).steps_done() for run in runs if run.member is None}
        return {run: done for run, done in found.items() if done is not None}

    def remove(self, runs: Iterable[Run]) -> None:
        """Forget how far these runs were.

        Raises
        ------
        StorageError
            If a checkpoint cannot be removed.
        """
        if checkpoint_paths(self.folder):
            remove_checkpoints(self.folder, {identity(run) for run in runs})


@dataclass(kw_only=True, eq=False)
class CheckpointFile:
    """The checkpoint of one run, as :class:`fvi_cli.integrator.run.unfinished.RunKeeper` asks.

    A disk that is full, or a file that is broken, is told and does no harm: without a checkpoint a
    run begins at its start, and it goes on without one.

    Parameters
    ----------
    path
        The file.
    title
        The run in words.
    label
        Identity of the run, which says by which version of the solver.
    seconds
        Between two checkpoints, at least.
    """

    path: Path
    title: str
    label: str
    seconds: float
    _due: float = field(init=False)
    _is_failure_told: bool = False

    def __post_init__(self) -> None:
        self._due = time.monotonic() + self.seconds

    def load(self) -> UnfinishedRun | None:
        """What was kept of this run and is whole; None otherwise."""
        try:
            return self._read()
        except FileNotFoundError:
            return None
        except OSError as error:
            self.reject(f"it cannot be read: {reason(error)}")
        except ValueError as error:
            self.reject(str(error))
        return None

    def steps_done(self) -> int | None:
        """How many steps of the grid are done; None without a checkpoint to be believed."""
        try:
            return self._read().checkpoint.reported
        except (OSError, ValueError):
            return None

    def _read(self) -> UnfinishedRun:
        with self.path.open("rb") as stream:
            return UnfinishedRun.read(stream, self.label)

    def reject(self, reason: str) -> None:
        """Say why the checkpoint is of no use."""
        _logger.warning(
            "%s: checkpoint %s is ignored: %s; the run begins at its start",
            self.title,
            self.path,
            reason,
        )

    def is_due(self) -> bool:
        """Whether the last checkpoint is old enough."""
        return time.monotonic() >= self._due

    def save(self, unfinished: UnfinishedRun) -> None:
        """Write a checkpoint in place of the one before; if that fails the run goes on."""
        began = time.monotonic()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with (
                replacement(self.path) as handle,
                os.fdopen(os.dup(handle), "wb") as stream,
            ):
                unfinished.write(stream, self.label)
        except OSError as error:
            if not self._is_failure_told:
                _logger.warning(
                    "%s: %s: cannot be written: %s; the run goes on without a new checkpoint",
                    self.title,
                    self.path,
                    reason(error),
                )
            self._is_failure_told = True
        ended = time.monotonic()
        self._due = ended + max(self.seconds, LEAST_RATIO * (ended - began) if self.seconds else 0)
