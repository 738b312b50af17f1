"""Up to which step a method is stable, and what to do beyond."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.stability.determinant import MatrixPencil, independent_systems
from fvi_cli.integrator.stability.linearisation import linearised_at_start
from fvi_cli.integrator.stability.prediction import (
    RESOLVED,
    TOLERATED_GROWTH,
    StabilityPrediction,
    gains_no_energy,
    growing_frequencies,
    predict_stability,
)
from fvi_cli.integrator.stability.scan import FEW, grow_faster, numbers_of_steps, suspects
from fvi_cli.mathematics.arrays import Array, Integers

LARGEST_N_STEPS = 1 << 30

NEGLIGIBLE = 1e-3
"""Forces of a step this small beside inertia make no mode grow."""


def least_stable_n_steps(scene: Scene, method: AnyMethod, *, fewest: int = 1) -> int | None:
    """Number of steps from which on the run is stable with any more of them.

    Looked at are all numbers of steps up to 200, and beyond such that their steps are half a per
    cent apart, until nothing but inertia matters in a step: windows of instability that are
    narrower may be missed. Of scenes that are fed, and of more than 8 independent systems, it is up
    to 50, and 5 per cent. Modes that outgrow a growing scene by less than a quarter are looked for
    at halved steps only. The last change of the verdict is closed in by bisection to a thousandth.

    Parameters
    ----------
    scene, method
        What is integrated and how; a nonlinear scene is linearised at its start.
    fewest
        Least number of steps that is of interest.

    Returns
    -------
    int or None
        None where the finest step is unstable.
    """
    linear = linearised_at_start(scene)
    systems = independent_systems(linear)
    is_fed = not all(system.is_dissipative for system in systems)
    if gains_no_energy(method) and not is_fed:
        return fewest

    def is_stable(n_steps: int) -> bool:
        if not is_fed:
            # the prediction, without the modes themselves
            step_size = np.array([scene.final_time / n_steps])
            tolerated = math.log(TOLERATED_GROWTH) / n_steps
            return not grow_faster(systems, method, step_size, tolerated).any()
        return predict_stability(linear, method, n_steps).verdict == "stable"

    most = fewest
    sizes = [pair for system in systems for pair in system.sizes]
    while most < LARGEST_N_STEPS and _largest_force(sizes, scene.final_time / most) >= NEGLIGIBLE:
        most *= 2
    # each step of a scene that is fed is predicted by itself
    numbers = numbers_of_steps(fewest, most, is_wide=is_fed or len(systems) > FEW)
    growth = _permitted_growth(systems, scene.final_time, numbers)
    last = None
    candidates: Iterator[int] = suspects(systems, method, scene.final_time, numbers, growth)
    if is_fed:
        # also what outgrows the exact scene by less than a mode of it may be resolved
        doubled = numbers[
            np.searchsorted(numbers, fewest * 2.0 ** np.arange(32)).clip(max=numbers.size - 1)
        ]
        candidates = heapq.merge(candidates, np.unique(doubled)[::-1].tolist(), reverse=True)
    for n_steps in candidates:
        if not is_stable(n_steps):
            last = n_steps
            break
    if last is None:
        return fewest
    if last < numbers[-1]:
        low, high = last, int(numbers[np.searchsorted(numbers, last) + 1])
    else:
        low, high = last, 2 * last
        while high <= LARGEST_N_STEPS and not is_stable(high):
            low, high = high, 2 * high
        if high > LARGEST_N_STEPS:
            return None
    while high - low > max(1, low // 1024):
        middle = (low + high) // 2
        if is_stable(middle):
            high = middle
        else:
            low = middle
    return high


def _largest_force(sizes: Sequence[tuple[float, float]], step_size: float) -> float:
    """Of a step, beside inertia."""
    return max((size * step_size ** (2.0 - order) for order, size in sizes), default=0.0)


def _permitted_growth(
    systems: Sequence[MatrixPencil], final_time: float, numbers: Integers
) -> Array:
    """Logarithm of the growth over the run that is the exact scene's, resolved or tolerated."""
    finest = final_time / int(numbers[-1])
    found = [growing_frequencies(system, final_time, finest) for system in systems]
    rates = np.zeros(numbers.size)
    for frequencies in found:
        if frequencies is None:
            # as in the prediction, what cannot be told apart is not held against the method
            rates[:] = np.inf
            continue
        for s in frequencies.tolist():
            is_seen = abs(s.imag) * final_time / numbers < math.pi
            rates = np.maximum(rates, np.where(is_seen, s.real, 0.0))
    return np.asarray((1.0 + RESOLVED) * final_time * rates + math.log(TOLERATED_GROWTH))


def largest_stable_step(scene: Scene, method: AnyMethod, *, fewest: int = 1) -> float | None:
    """Largest step T / N, N an integer, from which on smaller ones are predicted stable.

    None where no step is; see :func:`least_stable_n_steps`.
    """
    n_steps = least_stable_n_steps(scene, method, fewest=fewest)
    return None if n_steps is None else scene.final_time / n_steps


def stable_method(scene: Scene, method: AnyMethod, n_steps: int) -> Method | None:
    """A Gauss method of the same degree, or else of a lower one, that is stable at this step."""
    degree = method.degree if isinstance(method, Method) else 1
    for lower in range(degree, 0, -1):
        candidate = Method(cq="gauss", degree=lower, start="graded")
        if predict_stability(scene, candidate, n_steps).verdict == "stable":
            return candidate
    return None


def refusal(scene: Scene, method: AnyMethod, n_steps: int, prediction: StabilityPrediction) -> str:
    """Why a run is not worth its time, and what would be."""
    parts = [f"predicted unstable: {prediction.reason}"]
    steps = least_stable_n_steps(scene, method)
    if steps is None:
        parts.append(f"no step of {method.case} is stable down to T / {LARGEST_N_STEPS}")
    else:
        parts.append(
            f"the largest stable step of {method.case} is about {scene.final_time / steps:.3g} "
            f"(N = {steps})"
        )
    other = stable_method(scene, method, n_steps)
    if other is not None:
        parts.append(f"at this step {other.cq} of degree {other.degree} is stable")
    parts.append("allow_unstable computes the run all the same")
    return "; ".join(parts)
