"""The memory that a run needs, and the memory that this machine can still give."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.studies.experiment import Experiment

BYTES_PER_RUN: Final = 4000
"""Memory of a finished run in addition to its trajectory."""


def run_bytes(experiment: Experiment, method: AnyMethod, n_steps: int, *, members: int = 1) -> int:
    """Memory in bytes that a run keeps, or so many members that are computed together.

    The time, position, momentum and energy of every point that is kept, twice while they are
    joined; and what is kept of every step: its samples by methods without exponentials, and its
    stages for observations and diagnostics.
    """
    d, every = experiment.problem.dimension, experiment.store_every
    own = experiment.observations
    kept = 2 * (2 + 2 * d) * (n_steps // every if own.is_empty else n_steps)
    if not isinstance(method, Method):
        kept += 6 * d * n_steps
    elif not (own.is_empty and not experiment.diagnostics):
        kept += method.degree * d * n_steps
    return 8 * members * kept


def wrong_sizes(experiment: Experiment) -> Iterator[Wrong]:
    """Runs that do not fit in memory, and sweeps whose finished runs do not fit."""
    steps, methods, members = experiment.steps, experiment.methods, len(experiment.members)
    available = machine_bytes()
    for index, n_steps in enumerate(steps):
        needed = max((run_bytes(experiment, one, n_steps) for one in methods), default=0)
        if needed > available:
            yield Wrong(
                ("ladder", "steps", index), _shortage(f"{n_steps} steps", needed, available)
            )
    points = sum(n_steps // experiment.store_every + 2 for n_steps in steps)
    each = 8 * (1 + 3 * experiment.problem.dimension) * points + BYTES_PER_RUN * len(steps)
    if (needed := members * len(methods) * each) > available:
        words = _shortage(f"{members} members", needed, available)
        less = "store: {every: n}, fewer numbers of steps, or several files need less"
        yield Wrong(("sweep",), f"{words}; {less}")


def _shortage(what: str, needed: int, available: int) -> str:
    wanted, left = (f"{size / 1e9:.3g} GB" for size in (needed, available))
    return f"{what} need about {wanted} of memory, this machine has {left}"


def machine_bytes() -> int:
    """Bytes that this machine can still give."""
    # a slow import, needed once a command
    import psutil

    return int(psutil.virtual_memory().available)
