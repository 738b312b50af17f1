r"""What single dampers have taken up along a motion: :math:`W_k(t) = \int_0^t F_k \cdot v\, ds`.

F_k is the force of one damping term or law, found anew from the velocities at the stages. Its power
is a polynomial on every step, whose integral over whole steps is the quadrature of the method.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array

PREFIX = "work_"


def work_names(scene: Scene) -> tuple[str, ...]:
    """``work_1``, ``work_2``, ...: one for each damping term, and then for each law."""
    count = len(scene.damping) + len(scene.laws)
    return tuple(f"{PREFIX}{number}" for number in range(1, count + 1))


def damper_place(scene: Scene, name: str) -> int | None:
    """Place of that damping term or law among the active ones; None: it does nothing.

    Raises
    ------
    ValueError
        For Riemann-Liouville derivatives of a motion that begins away from 0.
    """
    if scene.derivative != "caputo" and np.any(scene.initial_position != 0):
        raise ValueError(
            f"{name}: the power of a Riemann-Liouville derivative is infinite at the start; use "
            "caputo, or begin at 0"
        )
    every = (*scene.damping, *scene.laws)
    index = int(name.removeprefix(PREFIX)) - 1
    if not every[index].is_active:
        return None
    return sum(one.is_active for one in every[:index])


def running_work(shape: RunSteps, force: Array | None) -> Array:
    """Chebyshev coefficients, on every step, of the work since the start, ``(r + 1, n)``.

    The force on the damper is that at the stages, ``(n, r, d)``; None: it does nothing.
    """
    stages = shape.tables.points.size
    if force is None:
        return np.zeros((stages + 1, shape.n_steps))
    power = np.einsum("nrd,nrd->rn", force, shape.velocity)
    rates = shape.tables.stages_to_series @ power
    found = np.asarray(chebyshev.chebint(rates, lbnd=-1.0)) * 0.5 * shape.step_size
    found[0, 1:] += np.cumsum(found.sum(axis=0))[:-1]
    return found
