"""The memory that a run needs, and the memory that this machine can still give."""

from __future__ import annotations

from collections.abc import Iterator

from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.scenes.keys.mistakes import Wrong
from fvi_cli.studies.experiment import Experiment


def run_bytes(experiment: Experiment, method: AnyMethod, n_steps: int) -> int:
    """Memory in bytes that a run keeps.

    The time, position, momentum and energy of every point, twice while they are joined; and its
    samples by methods without exponentials, its stages for observations and diagnostics.
    """
    d, own = experiment.problem.dimension, experiment.observations
    kept = 2 * (2 + 2 * d) * n_steps
    if not isinstance(method, Method):
        kept += 6 * d * n_steps
    elif not (own.is_empty and not experiment.diagnostics):
        kept += method.degree * d * n_steps
    return 8 * kept


def wrong_sizes(experiment: Experiment) -> Iterator[Wrong]:
    """Runs that do not fit in memory."""
    available = machine_bytes()
    for index, n_steps in enumerate(experiment.steps):
        needed = max(run_bytes(experiment, one, n_steps) for one in experiment.methods)
        if needed > available:
            wanted, left = (f"{size / 1e9:.3g} GB" for size in (needed, available))
            words = f"{n_steps} steps need about {wanted} of memory, this machine has {left}"
            yield Wrong(("ladder", "steps", index), words)


def machine_bytes() -> int:
    """Bytes that this machine can still give."""
    # a slow import, needed once a command
    import psutil

    return int(psutil.virtual_memory().available)
