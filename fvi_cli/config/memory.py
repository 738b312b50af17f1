"""How much memory a run is going to take."""

from __future__ import annotations

from typing import Final

from fvi_cli.integrator.method import AnyMethod, Baseline

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
