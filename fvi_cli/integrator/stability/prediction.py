r"""Linear stability, known before the run.

A mode of the step equations that grows by :math:`1/|z|` in a step makes a run **unstable** when it
grows a thousandfold over all the steps,

.. math:: N \log\frac{1}{|z|} > \log 10^3 .

Modes are counted, as zeros of the determinant of the equations in a circle. This holds for linear
scenes without a source of energy, whose motions do not grow; of others nothing is said.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method, as_method
from fvi_cli.integrator.stability.determinants import (
    StepDeterminants,
    independent_systems,
    step_determinants,
)
from fvi_cli.integrator.stability.patterns import has_patterns
from fvi_cli.mathematics.zeros import UNDECIDED, count_zeros

Verdict = Literal["stable", "unstable", "unknown"]

TOLERATED_GROWTH = 1e3
"""Factor by which a mode may grow over a run."""

LARGEST_DIMENSION = 24
"""Most coupled components of one system that is examined."""

FASTEST = 700.0
"""Growth per step, as a logarithm, that exceeds every number."""

ACCURACY = 1e-6
"""Relative accuracy of the growth of the worst mode."""

# shares of log(1/|z|) N = 1; a little different where a zero lies on the circle itself
_SHARES = (10.0, 10.7, 9.1)


@dataclass(frozen=True, kw_only=True)
class StabilityPrediction:
    """Prediction for a run from the modes of the step equations."""

    verdict: Verdict  # unknown where nothing is proved
    growth_per_step: float = 0.0  # log(1/|z|) of the worst mode; 0 where none grows
    reason: str = ""


def predict_stability(scene: Scene, method: AnyMethod | str, n_steps: int) -> StabilityPrediction:
    """Predict whether a run of `scene` by `method` in `n_steps` steps would blow up, and why.

    A method may be given by its name.

    Raises
    ------
    ValueError
        If N is not positive.
    """
    method = as_method(method)
    if n_steps < 1:
        raise ValueError(f"n_steps: {n_steps!r} is not allowed; it must be an integer >= 1")
    if not has_patterns(method):
        return _unknown(f"no prediction for {method.label}")
    if not scene.is_linear:
        return _unknown("the scene is nonlinear")
    if not scene.is_dissipative:
        return _unknown("the scene has a source of energy")
    if isinstance(method, Method) and method.cq == "gauss":
        # its symbol has a positive real part: the damping force does negative work over every run,
        # and the rest keeps the energy
        reason = "the scene has no source of energy, and no step of the method gains energy"
        return StabilityPrediction(verdict="stable", reason=reason)
    if scene.active_laws:
        return _unknown("modes are not computed for scenes with relaxation laws")
    if scene.is_sparse:
        return _unknown(_no_modes(scene.dimension))
    systems = independent_systems(scene)
    if (size := systems.forms.shape[-1]) > LARGEST_DIMENSION:
        return _unknown(_no_modes(size))
    growth = _growth(step_determinants(systems, method, scene.final_time / n_steps), n_steps)
    if growth is None:
        return _unknown("a mode lies too close to the circle of no growth to be counted")
    if growth == 0.0:
        return StabilityPrediction(verdict="stable", reason="no mode grows")
    return StabilityPrediction(
        verdict="unstable" if growth * n_steps > math.log(TOLERATED_GROWTH) else "stable",
        growth_per_step=growth,
        reason=f"a mode grows by a factor {math.exp(min(growth, FASTEST)):.4g} per step",
    )


def _unknown(reason: str) -> StabilityPrediction:
    return StabilityPrediction(verdict="unknown", reason=reason)


def _no_modes(size: int) -> str:
    return f"modes are not computed for {size} coupled components; at most {LARGEST_DIMENSION}"


def _growth(determinants: StepDeterminants, n_steps: int) -> float | None:
    """Logarithm of the growth of the worst mode per step; 0 where none grows by a tenth over N.

    By bisection of the radius of a circle with zeros. None where the modes cannot be counted.
    """
    counts = np.full(determinants.number, UNDECIDED)
    for share in _SHARES:
        left = np.flatnonzero(counts == UNDECIDED)
        if left.size:
            counts[left] = count_zeros(determinants[left], 1.0 - 1.0 / (share * n_steps))
    if np.any(counts == UNDECIDED):
        return None
    if not counts.any():
        return 0.0
    determinants = determinants[np.flatnonzero(counts)]
    low, high = -math.log1p(-1.0 / (_SHARES[-1] * n_steps)), FASTEST
    while high > (1.0 + ACCURACY) * low:
        middle = math.sqrt(low * high)
        counts = count_zeros(determinants, math.exp(-middle))
        if counts.any():
            determinants, low = determinants[np.flatnonzero(counts)], middle
        else:
            high = middle
    return low
