"""The memory that a run needs, and the memory that this machine can still give."""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from fvi_cli.config.keys.ladder import refuse_step
from fvi_cli.config.keys.sweep import BYTES_PER_RUN, SWEEP
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.keys.cursor import Cursor
from fvi_cli.studies.experiment import Experiment

ROOT: Final = Path("/")
UNLIMITED: Final = 1 << 60
"""Limits from here on count as none: version 1 of control groups states 2^63 bytes."""


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
    elif not (own.is_empty and experiment.diagnostics.is_empty):
        kept += method.degree * d * n_steps
    return 8 * members * kept


def shortage(needed: int, when: str = "") -> str:
    """A message if this machine lacks so many bytes; empty if it has them or this is unknown."""
    available = machine_bytes()
    if available is None or needed <= available:
        return ""
    wanted, left = (f"{size / 1e9:.3g} GB" for size in (needed, available))
    return f"need about {wanted} of memory{when}, this machine has {left}"


def check_memory(experiment: Experiment, at: Cursor) -> None:
    """Refuse runs that do not fit in memory, and sweeps whose finished runs do not fit."""
    steps, methods, members = experiment.steps, experiment.methods, len(experiment.members)
    # memory grows with the number of steps
    for index in sorted(range(len(steps)), key=lambda index: -steps[index]):
        n_steps = steps[index]
        words = shortage(max(run_bytes(experiment, one, n_steps) for one in methods))
        if not words:
            break
        refuse_step(at, index, f"{n_steps} steps {words}")
    points = sum(n_steps // experiment.store_every + 2 for n_steps in steps)
    each = 8 * (1 + 3 * experiment.problem.dimension) * points + BYTES_PER_RUN * len(steps)
    if words := shortage(members * len(methods) * each, " in all"):
        less = "store: {every: n}, fewer numbers of steps, or several files need less"
        at.refuse(f"{members} members {words}; {less}", SWEEP)


def machine_bytes(root: Path = ROOT) -> int | None:
    """Bytes that this process can still take: the least of all limits; None where none is known.

    Limits are the available memory of the machine, the rest of every control group (versions 1 and
    2) from that of this process up to the outermost (systemd, SLURM and containers nest them), and
    the address space (``ulimit -v``).
    """
    limits = [*_of_machine(root), *_of_groups(root), *_of_address_space(root)]
    return max(min(limits), 0) if limits else None


def _of_machine(root: Path) -> Iterator[int]:
    found = _entries(root / "proc/meminfo").get("MemAvailable")
    if found is not None:
        yield 1024 * found
        return
    with contextlib.suppress(AttributeError, OSError, ValueError):
        yield os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _of_groups(root: Path) -> Iterator[int]:
    """The remaining bytes of every control group around this process."""
    mounts = root / "sys/fs/cgroup"
    lines = _text(root / "proc/self/cgroup").splitlines() or ["0::/"]
    for line in lines:
        number, _, rest = line.partition(":")
        controllers, _, place = rest.partition(":")
        if number == "0" and not controllers:
            names, top = ("memory.max", "memory.current", "inactive_file"), mounts
        elif "memory" in controllers.split(","):
            names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
            top = mounts / "memory"
        else:
            continue
        group = top / place.strip("/")
        # a container may name a group that it cannot see: then the outermost one is its own
        for folder in dict.fromkeys([group, *group.parents, top]):
            if folder == top or top in folder.parents:
                yield from _of_group(folder, *names)


def _of_group(folder: Path, limit: str, usage: str, cache: str) -> Iterator[int]:
    with contextlib.suppress(ValueError):
        # the file says "max" where there is no limit
        most = int(_text(folder / limit))
        if most < UNLIMITED:
            # the kernel frees cached files when memory is needed
            taken = int(_text(folder / usage) or 0)
            yield most - taken + _entries(folder / "memory.stat").get(cache, 0)


def _of_address_space(root: Path) -> Iterator[int]:
    try:
        resource = importlib.import_module("resource")
    except ImportError:
        return
    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most != resource.RLIM_INFINITY:
        with contextlib.suppress(ValueError, IndexError):
            yield most - resource.getpagesize() * int(_text(root / "proc/self/statm").split()[0])


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""


def _entries(path: Path) -> dict[str, int]:
    """The numbers by name in a file with one name and one number per line."""
    found = {}
    for line in _text(path).splitlines():
        name, *rest = line.replace(":", " ").split()
        if rest and rest[0].isdigit():
            found[name] = int(rest[0])
    return found
