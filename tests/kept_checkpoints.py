"""Checkpoints that are kept in memory, and runs that they stop."""

import copy
import io

from fvi_cli.integrator.run.checkpoint import Checkpoint


class StoppedError(Exception):
    """In place of a signal."""


class Kept:
    """Checkpoints in memory; the run is stopped after so many have been written."""

    def __init__(self, stops=(), pause=1, content=None):
        self.pause, self.asked, self.rejected, self.label = pause, [], [], "a run"
        self.stops, self.saves, self.taken_up = list(stops), [], []
        self.contents = {} if content is None else {self.label: content}

    @property
    def content(self):
        return self.contents[self.label]

    def load(self):
        if self.label not in self.contents:
            return None
        found = Checkpoint.read(io.BytesIO(self.content), self.label)
        self.taken_up.append(found.done)
        return found

    def reject(self, reason):
        self.rejected.append(reason)

    def is_due(self):
        self.asked.append(1)
        return len(self.asked) % self.pause == 0

    def is_kept_whole(self, seconds):
        return self.label != "a run"

    def of_run(self, name):
        own = copy.copy(self)
        own.label = f"{self.label} {name}"
        return own

    def save(self, unfinished):
        stream = io.BytesIO()
        unfinished.write(stream, self.label)
        self.contents[self.label] = stream.getvalue()
        self.saves.append(self.label)
        if self.stops and len(self.saves) >= self.stops[0]:
            self.saves.clear()
            self.stops.pop(0)
            raise StoppedError
