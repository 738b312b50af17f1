"""How much memory there is, and how much a run is going to take."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Final

# Trajectory, samples, weights, their transforms and the copies that are made when storing.
DOUBLES_PER_STEP: Final = 20
_CONTAINER_LIMIT: Final = Path("/sys/fs/cgroup/memory.max")


def predicted_bytes(n_steps: int, dimension: int) -> int:
    """Estimated memory of a run, in bytes."""
    return 8 * DOUBLES_PER_STEP * n_steps * dimension


def machine_bytes() -> int | None:
    """Memory of this machine, or of the container, in bytes; None when it does not tell."""
    limits = []
    with contextlib.suppress(AttributeError, OSError, ValueError):
        limits.append(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    with contextlib.suppress(OSError, ValueError):
        # the file says "max" where there is no limit
        limits.append(int(_CONTAINER_LIMIT.read_text()))
    return min(limits, default=None)


def in_gigabytes(size: int) -> str:
    """`size` in bytes as ``1.5 GB``."""
    return f"{size / 1e9:.3g} GB"
