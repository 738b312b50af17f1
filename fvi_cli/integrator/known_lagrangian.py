"""The part of the motion of a general Lagrangian that is known in advance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.known_motion import KnownMotion
from fvi_cli.integrator.moments import StepFunction
from fvi_cli.integrator.start import StartDecision
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.windowed_series import WindowedSeries

Array = NDArray[np.float64]


def known_motion(
    lagrangian: Lagrangian,
    window: WindowedSeries,
    tables: StepTables,
    step_size: float,
    first: int,
    last: int,
) -> KnownMotion:
    """S and what belongs to it on the steps `first` <= k < `last`."""
    at = step_size * (np.arange(first, last, dtype=float)[:, None] + tables.points)
    position, velocity = window.position(at), window.velocity(at)
    with np.errstate(all="ignore"):
        return KnownMotion(
            position=position,
            velocity=velocity,
            momentum=lagrangian.momentum(position, velocity, at),
            force=lagrangian.force(position, velocity, at),
        )


def lagrangian_residual(
    scene: Scene, lagrangian: Lagrangian, decision: StartDecision
) -> StepFunction:
    r"""The force on u = x - S: what drives x, less what drives S.

    .. math:: f - \sum_j \mu_j D^{\gamma_j} S - \frac{d}{dt} \partial_v L(S, S', t)
              + \partial_q L(S, S', t)

    Close to 0, where unbounded terms cancel, it is zero to round-off.
    """
    window, expansion = decision.window, decision.expansion
    if window is None or expansion is None:
        raise ValueError(f"no known part: {decision.reason}")
    near = decision.tau * 1e-17 ** (1.0 / max(expansion.cutoff - 2.0, 1.0))

    def force(start: Array, step_size: float, offsets: Array) -> Array:
        at = start[:, None] + step_size * offsets
        # at t = 0 unbounded terms of both signs meet
        with np.errstate(all="ignore"):
            position, velocity = window.position(at), window.velocity(at)
            total = lagrangian.force(position, velocity, at) - lagrangian.momentum_rate(
                position, velocity, window.acceleration(at), at
            )
            for term in scene.active_damping:
                derivative = window.fractional_derivative(at, term.order, scene.derivative)
                total -= derivative @ term.coefficient
            if scene.forcing is not None:
                total += scene.forcing.on_steps(start, step_size, offsets)
        return np.where((at < near)[..., None], 0.0, total)

    return force
