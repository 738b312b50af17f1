r"""The solution's expansion in fractional powers at the start."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.expansions.lagrangian import lagrangian_expansion
from fvi_cli.integrator.expansions.separable import separable_expansion
from fvi_cli.integrator.expansions.values import Expansion
from fvi_cli.mathematics.series.power_series import PowerSeries


def solution_series(scene: Scene, cutoff: float) -> tuple[PowerSeries, ...]:
    """The solution's expansion at t = 0 below t**cutoff, one series per component.

    Raises
    ------
    SeriesError
        If forcing or potential have no expansion in powers of t, or more than 128 exponents lie
        below the cutoff.
    """
    return solution_expansion(scene, cutoff).components


def solution_expansion(scene: Scene, cutoff: float) -> Expansion:
    r"""The solution's expansion at t = 0, by Picard iteration.

    .. math:: x \leftarrow x_0 + v_0 t + J^2 M^{-1}\Bigl[f - \sum_j \mu_j D^{\gamma_j} x
              - \nabla V(x)\Bigr]

    Every sweep determines more powers; the series keep account of how many. A linear scene needs
    one: each power of its solution follows from those below.

    Raises
    ------
    SeriesError
        As :func:`solution_series`.
    """
    if scene.lagrangian is not None:
        return lagrangian_expansion(scene, scene.lagrangian, cutoff)
    return separable_expansion(scene, cutoff)
