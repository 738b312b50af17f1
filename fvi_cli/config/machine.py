"""The memory that a run needs, and the memory that this machine can still give."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.scenes.keys.values import Wrong
from fvi_cli.studies.experiment import Experiment

ROOT: Final = Path("/")
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


def shortage(needed: int, when: str = "") -> str:
    """A message if this machine lacks so many bytes; empty if it has them."""
    available = machine_bytes()
    if needed <= available:
        return ""
    wanted, left = (f"{size / 1e9:.3g} GB" for size in (needed, available))
    return f"need about {wanted} of memory{when}, this machine has {left}"


def wrong_sizes(experiment: Experiment) -> Iterator[Wrong]:
    """Runs that do not fit in memory, and sweeps whose finished runs do not fit."""
    steps, methods, members = experiment.steps, experiment.methods, len(experiment.members)
    # memory grows with the number of steps
    for index in sorted(range(len(steps)), key=lambda index: -steps[index]):
        needed = max((run_bytes(experiment, one, steps[index]) for one in methods), default=0)
        if not (words := shortage(needed)):
            break
        yield Wrong(("ladder", "steps", index), f"{steps[index]} steps {words}")
    points = sum(n_steps // experiment.store_every + 2 for n_steps in steps)
    each = 8 * (1 + 3 * experiment.problem.dimension) * points + BYTES_PER_RUN * len(steps)
    if words := shortage(members * len(methods) * each, " in all"):
        less = "store: {every: n}, fewer numbers of steps, or several files need less"
        yield Wrong(("sweep",), f"{members} members {words}; {less}")


def machine_bytes(root: Path = ROOT) -> int:
    """Bytes that this process can still take, by the machine and its control groups (version 2)."""
    # a slow import, needed once a command
    import psutil

    available = int(psutil.virtual_memory().available)
    return max(min([available, *_of_groups(root)]), 0)


def _of_groups(root: Path) -> Iterator[int]:
    """The remaining bytes of every control group around this process."""
    top = root / "sys/fs/cgroup"
    lines = _text(root / "proc/self/cgroup").splitlines()
    own = next((line.removeprefix("0::/") for line in lines if line.startswith("0::/")), "")
    group = top / own
    # a container may name a group that it cannot see: then the outermost one is its own
    for folder in (group, *group.parents):
        limit = _text(folder / "memory.max").strip()
        # the file says "max" where there is no limit
        if limit.isdecimal():
            counts = dict(line.split() for line in _text(folder / "memory.stat").splitlines())
            # the kernel frees cached files when memory is needed
            taken = int(_text(folder / "memory.current") or 0) - int(counts.get("inactive_file", 0))
            yield int(limit) - taken
        if folder == top:
            return


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
