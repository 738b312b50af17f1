"""How much memory a run takes, and how much a program may still take on this machine."""

from __future__ import annotations

import contextlib
import importlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from fvi_cli.integrator.method import AnyMethod, Baseline

ROOT: Final = Path("/")
UNLIMITED: Final = 1 << 60
"""Limits from here on are none: version 1 of control groups states one of 2^63 bytes."""
# Trajectory, samples, weights, their transforms and the copies that are made when storing.
DOUBLES_PER_STEP: Final = 20
GENEROUS_DOUBLES: Final = 200
"""More than any method keeps for a step, a degree and a coordinate."""
GENEROUS_BYTES: Final = 2**28
"""More than the tables of any method take, whatever the number of steps."""


def derivative_bytes(n_steps: int) -> int:
    """Estimated memory of a fractional derivative on so many steps, in bytes."""
    return 8 * DOUBLES_PER_STEP * n_steps


def bytes_at_most(method: AnyMethod, n_steps: int, dimension: int) -> int:
    """More bytes than the plan of any run comes to, without making one."""
    degree = 1 if isinstance(method, Baseline) else method.degree
    moving = GENEROUS_DOUBLES * degree * dimension * n_steps
    return GENEROUS_BYTES + 8 * (moving + 10 * (degree * dimension) ** 2)


def in_gigabytes(size: int) -> str:
    """`size` in bytes as ``1.5 GB``."""
    return f"{size / 1e9:.3g} GB"


def machine_bytes(root: Path = ROOT) -> int | None:
    """Bytes that can still be taken: the least of all limits; None where nothing tells.

    These are what the machine has available, what control groups of both versions leave, from that
    of this process up to the outermost (systemd, SLURM and containers nest them), and the limit of
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
    """What every control group around this process leaves."""
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
        # a container may name a group that it does not see: its own is then the outermost one
        for folder in dict.fromkeys([group, *group.parents, top]):
            if folder == top or top in folder.parents:
                yield from _of_group(folder, *names)


def _of_group(folder: Path, limit: str, usage: str, cache: str) -> Iterator[int]:
    with contextlib.suppress(ValueError):
        # the file says "max" where there is no limit
        most = int(_text(folder / limit))
        if most < UNLIMITED:
            # cached files are given back when memory is wanted
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
    """Names and numbers of a file with one of each in a line."""
    found = {}
    for line in _text(path).splitlines():
        name, *rest = line.replace(":", " ").split()
        if rest and rest[0].isdigit():
            found[name] = int(rest[0])
    return found
