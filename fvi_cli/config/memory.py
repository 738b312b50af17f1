"""How much memory a run is going to take."""

from __future__ import annotations

from typing import Final

from fvi_cli.effects.scene import Scene
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


def run_bytes(
    scene: Scene,
    method: AnyMethod,
    n_steps: int,
    *,
    every: int = 1,
    members: int = 1,
    diagnosed: bool = False,
) -> int:
    """Memory of a run by its plan, in bytes.

    Parameters
    ----------
    scene, method, n_steps
        The run.
    every
        Only every n-th point is kept, which is of use with Runge-Kutta methods.
    members
        How many scenes of this kind are integrated together.
    diagnosed
        Whether diagnostics are asked for.
    """
    # plans know the whole engine, which takes long to import
    from fvi_cli.planning.plan import planned_bytes

    return planned_bytes(scene, method, n_steps, every=every, members=members, diagnosed=diagnosed)


def in_gigabytes(size: int) -> str:
    """`size` in bytes as ``1.5 GB``."""
    return f"{size / 1e9:.3g} GB"
