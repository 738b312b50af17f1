"""Checkpoints of runs that are not finished, in a folder beside a result file."""

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
"""Between two checkpoints lies this multiple of the time that writing one takes, at least."""

WHOLE_RATIO = 60.0
"""A run with others behind it is kept when it ends if it took this share of that time, 1/60."""


@dataclass(frozen=True, kw_only=True)
class CheckpointFolder:
    """Where runs of a result file keep their checkpoints."""

    folder: Path
    seconds: float  # between two checkpoints of a run, at least

    def of(self, batch: Batch, *, is_stored_next: bool = True) -> CheckpointFile:
        """The checkpoint of a run, a search, or runs that are computed together.

        A run that is not stored next, since observations follow it, is kept when it has ended.
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
        """How many steps are done of those runs whose batch has a checkpoint to be believed."""
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
        """In words what is kept of the runs of a search; empty: nothing."""
        owner = f"{identity_of(search)}."
        found = [path for path in checkpoint_paths(self.folder) if path.name.startswith(owner)]
        return f"resume: {len(found)} runs of the search kept, whole or in part" if found else ""

    def remove(self, runs: Iterable[Run]) -> None:
        """Forget how far these runs were.

        Raises
        ------
        StorageError
            If a checkpoint cannot be removed.
        """
        if checkpoint_paths(self.folder):
            remove_checkpoints(self.folder, {identity_of(run) for run in runs})


@dataclass(kw_only=True, eq=False)
class CheckpointFile:
    """The checkpoint of one run, as :class:`fvi_cli.integrator.run.checkpoint.RunKeeper` asks.

    A full disk or a broken file is reported and does no harm: without a checkpoint a run begins at
    its start, and it goes on without one.
    """

    folder: Path  # of the file
    title: str  # the run in words
    # identity of the run, which says by which version of the solver; of one of the runs that a
    # search or a batch makes also which one it is
    label: str
    seconds: float  # between two checkpoints, at least
    is_stored_next: bool = True  # whether the run is stored as soon as it ends
    _due: float = field(init=False)
    _has_logged_failure: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        self._due = time.monotonic() + self.seconds

    @property
    def path(self) -> Path:
        """The file, whose name begins with the identity of the run."""
        owner, _, which = self.label.partition(" ")
        name = f"{owner}.{hashlib.sha256(which.encode()).hexdigest()[:16]}" if which else owner
        return self.folder / f"{name}{CHECKPOINT_SUFFIX}"

    def of_run(self, name: str) -> CheckpointFile:
        """The checkpoint of one of the runs that this search or batch makes."""
        return replace(self, label=f"{self.label} {name}", is_stored_next=False)

    def load(self) -> Checkpoint | None:
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

    def is_kept_whole(self, seconds: float) -> bool:
        """Whether a run that took so long is kept when it has ended: others are soon done again."""
        return not self.is_stored_next and seconds >= self.seconds / WHOLE_RATIO

    def save(self, checkpoint: Checkpoint) -> None:
        """Write a checkpoint in place of the one before; if that fails the run goes on."""
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
