"""Checkpoints of unfinished runs, in a folder next to their result file."""

from __future__ import annotations

import hashlib
import logging
import os
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from fvi_cli.integrator.run.checkpoint import Checkpoint
from fvi_cli.runner.executors.batches import Batch, batches_of
from fvi_cli.storage.atomic import reason, replacement
from fvi_cli.storage.digests import canonical_json, identity_of, sha256
from fvi_cli.storage.files import CHECKPOINT_SUFFIX, checkpoint_paths, remove_checkpoints
from fvi_cli.studies.experiment import Run

_logger = logging.getLogger(__name__)

LEAST_RATIO = 20.0
"""The time between two checkpoints is at least this multiple of the time to write one."""

WHOLE_RATIO = 60.0
"""A run that is not stored next is kept at its end if it took 1/60 of the time between checkpoints.
"""


@dataclass(frozen=True, kw_only=True)
class CheckpointFolder:
    """The folder in which runs of a result file keep their checkpoints."""

    folder: Path
    seconds: float  # least time between two checkpoints of a run

    def of(self, batch: Batch, *, is_stored_next: bool = True) -> CheckpointFile:
        """The checkpoint of a run, a search, or a batch of runs.

        With `is_stored_next` false (observations are still to be computed) the checkpoint is kept
        when the run has ended.
        """
        first = batch[0]
        label, title = identity_of(first), first.title
        if len(batch) > 1:
            values = [dict(run.member.values) for run in batch if run.member is not None]
            label += f" {sha256(canonical_json(values))}"
            title += f" and {len(batch) - 1} more"
        return CheckpointFile(
            folder=self.folder,
            title=title,
            label=label,
            seconds=self.seconds,
            is_stored_next=is_stored_next and len(batch) == 1,
        )

    def unfinished(self, runs: Sequence[Run]) -> dict[Run, int]:
        """Number of computed steps of every run whose batch has a valid checkpoint."""
        if not checkpoint_paths(self.folder):
            return {}
        found: dict[Run, int] = {}
        for batch in batches_of(runs):
            kept = self.of(batch)
            done = (kept if len(batch) == 1 else kept.of_run("from 0")).steps_done()
            if done is not None:
                found |= dict.fromkeys(batch, done)
        return found

    def resumed(self, search: Run) -> str:
        """A message on kept runs of a search; empty: there are none."""
        owner = f"{identity_of(search)}."
        found = [path for path in checkpoint_paths(self.folder) if path.name.startswith(owner)]
        return f"resume: {len(found)} runs of the search kept, whole or in part" if found else ""

    def remove(self, runs: Iterable[Run]) -> None:
        """Remove the checkpoints of these runs.

        Raises
        ------
        StorageError
            If a checkpoint cannot be removed.
        """
        if checkpoint_paths(self.folder):
            remove_checkpoints(self.folder, {identity_of(run) for run in runs})


@dataclass(kw_only=True, eq=False)
class CheckpointFile:
    """The checkpoint of one run; a :class:`fvi_cli.integrator.run.checkpoint.RunKeeper`.

    A full disk or a damaged file gives a warning, not an error: the run then goes on without a new
    checkpoint, or begins at its start.
    """

    folder: Path  # folder of the file
    title: str  # the run in words
    # identity of the run, which includes the version of the solver; for one of the runs of a search
    # or a batch also its name
    label: str
    seconds: float  # least time between two checkpoints
    is_stored_next: bool = True  # whether the run is stored as soon as it ends
    _due: float = field(init=False)
    _has_logged_failure: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        self._due = time.monotonic() + self.seconds

    @property
    def path(self) -> Path:
        """The path of the file; its name begins with the identity of the run."""
        owner, _, which = self.label.partition(" ")
        name = f"{owner}.{hashlib.sha256(which.encode()).hexdigest()[:16]}" if which else owner
        return self.folder / f"{name}{CHECKPOINT_SUFFIX}"

    def of_run(self, name: str) -> CheckpointFile:
        """The checkpoint of one of the runs of this search or batch."""
        return replace(self, label=f"{self.label} {name}", is_stored_next=False)

    def load(self) -> Checkpoint | None:
        """The checkpoint of this run if it is valid; None otherwise."""
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
        """Number of computed steps of the grid; None without a valid checkpoint."""
        try:
            return self._read().reported
        except (OSError, ValueError):
            return None

    def _read(self) -> Checkpoint:
        # a pipe would be read for ever
        if self.path.exists() and not self.path.is_file():
            raise ValueError("it is not a file")
        with self.path.open("rb") as stream:
            return Checkpoint.read(stream, self.label)

    def reject(self, reason: str) -> None:
        """Warn that the checkpoint is ignored, with the reason."""
        _logger.warning(
            "%s: checkpoint %s is ignored: %s; the run begins at its start",
            self.title,
            self.path,
            reason,
        )

    def is_due(self) -> bool:
        """Whether the last checkpoint is old enough."""
        return time.monotonic() >= self._due

    def is_kept_whole(self, seconds: float) -> bool:
        """Whether a run that took `seconds` is kept at its end; shorter ones are soon repeated."""
        return not self.is_stored_next and seconds >= self.seconds / WHOLE_RATIO

    def save(self, checkpoint: Checkpoint) -> None:
        """Replace the checkpoint by a new one; if that fails the run goes on."""
        began = time.monotonic()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with (
                replacement(self.path) as handle,
                os.fdopen(os.dup(handle), "wb") as stream,
            ):
                checkpoint.write(stream, self.label)
        except OSError as error:
            if not self._has_logged_failure:
                _logger.warning(
                    "%s: %s: cannot be written: %s; the run goes on without a new checkpoint",
                    self.title,
                    self.path,
                    reason(error),
                )
            self._has_logged_failure = True
        finished = time.monotonic()
        self._due = finished + max(
            self.seconds, LEAST_RATIO * (finished - began) if self.seconds else 0
        )
