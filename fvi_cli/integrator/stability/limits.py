"""Up to which step a method is stable, and what to do beyond.

Windows of instability lie between stable steps, so that halving a step may find none. The zeros of
the step determinants of many steps are counted at once; those with zeros are then predicted one by
one.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.stability.determinants import step_determinants
from fvi_cli.integrator.stability.linearisation import linearised_at_start
from fvi_cli.integrator.stability.modes import FASTEST, growing_frequencies
from fvi_cli.integrator.stability.prediction import (
    RESOLVED,
    TOLERATED_GROWTH,
    StabilityPrediction,
    gains_no_energy,
    predict_stability,
)
from fvi_cli.integrator.stability.systems import MatrixPencil, independent_systems
from fvi_cli.mathematics.arrays import Array, Integers
from fvi_cli.mathematics.transforms.zeros import count_zeros

LARGEST_N_STEPS = 1 << 30  # beyond, no step counts as stable

NEGLIGIBLE = 1e-3
"""Forces of a step that are this small relative to inertia make no mode grow."""

EVERY_UP_TO = 200
"""Every number of steps up to this is examined."""

SPACING = 0.005
"""Relative distance of the step sizes that are examined beyond: wider windows are found."""

FEW = 8
"""Most independent systems of a scene for which this distance is used."""

WIDE_SPACING = 0.05
"""Relative distance for more systems, and for scenes with a source of energy."""

BLOCK = 2.0
"""Ratio of the numbers of steps that are examined together."""


def least_stable_n_steps(scene: Scene, method: AnyMethod, *, fewest: int = 1) -> int | None:
    """Number of steps, `fewest` or more, from which on the run is stable with any more of them.

    All numbers of steps up to 200 are examined, and beyond numbers whose steps are half a per cent
    apart, until only inertia matters in a step: narrower windows of instability may be missed. For
    scenes with a source of energy, and for more than 8 independent systems, the limits are 50 and 5
    per cent. Modes that outgrow a growing scene by less than a quarter are searched for at halved
    steps only. The last change of the verdict is located by bisection to a thousandth. A nonlinear
    scene is linearised at its start. None if the finest step is unstable.
    """
    linear = linearised_at_start(scene)
    systems = independent_systems(linear)
    is_fed = not all(system.is_dissipative for system in systems)
    if gains_no_energy(method) and not is_fed:
        return fewest

    def is_stable(n_steps: int) -> bool:
        if is_fed:
            return predict_stability(linear, method, n_steps).verdict == "stable"
        # the same without the modes themselves
        step_size = np.array([scene.final_time / n_steps])
        tolerated = math.log(TOLERATED_GROWTH) / n_steps
        return not _grow_faster(systems, method, step_size, tolerated).any()

    numbers = numbers_of_steps(
        fewest,
        _most_steps(systems, scene.final_time, fewest),
        is_wide=is_fed or len(systems) > FEW,
    )
    growth = _permitted_growth(systems, scene.final_time, numbers)
    candidates = _suspects(systems, method, scene.final_time, numbers, growth)
    if is_fed:
        # also modes that outgrow the exact scene by no more than a poorly resolved mode may
        doubled = np.searchsorted(numbers, fewest * 2.0 ** np.arange(32))
        doubled = np.unique(numbers[doubled.clip(max=numbers.size - 1)])
        candidates = heapq.merge(candidates, doubled[::-1].tolist(), reverse=True)
    low = next((n_steps for n_steps in candidates if not is_stable(n_steps)), None)
    if low is None:
        return fewest
    high = int(min(numbers[numbers > low], default=2 * low))
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


def numbers_of_steps(fewest: int, most: int, *, is_wide: bool = False) -> Integers:
    """Numbers of steps that are examined, increasing."""
    spacing, every = (WIDE_SPACING, EVERY_UP_TO // 4) if is_wide else (SPACING, EVERY_UP_TO)
    each = np.arange(fewest, min(most, every) + 1)
    if most <= every:
        return each
    first = max(fewest, every)
    count = 1 + math.ceil(math.log(most / first) / math.log1p(spacing))
    return np.unique(np.concatenate([each, np.geomspace(first, most, count).round().astype(int)]))


def _most_steps(systems: Sequence[MatrixPencil], final_time: float, fewest: int) -> int:
    """Number of steps, doubled from `fewest` until only inertia matters in a step."""
    sizes = [pair for system in systems for pair in system.sizes]
    most = fewest
    while most < LARGEST_N_STEPS:
        h = final_time / most
        if max((size * h ** (2.0 - order) for order, size in sizes), default=0.0) < NEGLIGIBLE:
            break
        most *= 2
    return most


def _permitted_growth(
    systems: Sequence[MatrixPencil], final_time: float, numbers: Integers
) -> Array:
    """Logarithm of the growth over the run that the exact scene and the tolerances permit."""
    rates = np.zeros(numbers.size)
    for system in systems:
        found = growing_frequencies(system, final_time, final_time / int(numbers[-1]))
        if found is None:
            # as in the prediction, modes that cannot be separated do not count against the method
            return np.full(numbers.size, np.inf)
        for s in found.tolist():
            is_seen = abs(s.imag) * final_time / numbers < math.pi
            rates = np.maximum(rates, np.where(is_seen, s.real, 0.0))
    return np.asarray((1.0 + RESOLVED) * final_time * rates + math.log(TOLERATED_GROWTH))


def _suspects(
    systems: Sequence[MatrixPencil],
    method: AnyMethod,
    final_time: float,
    numbers: Integers,
    growth: Array,
) -> Iterator[int]:
    """Numbers of steps, decreasing, at which a mode outgrows `growth`, or where it may.

    The growths are logarithms over the whole run, one for each of `numbers`.
    """
    end = numbers.size
    while end:
        begin = int(np.searchsorted(numbers, numbers[end - 1] / BLOCK))
        some = numbers[begin:end]
        # one circle for all: that of the slowest growth
        slowest = float((growth[begin:end] / some).min())
        if slowest <= FASTEST:
            grows = _grow_faster(systems, method, final_time / some, slowest)
            yield from some[grows][::-1].tolist()
        end = begin


def _grow_faster(
    systems: Sequence[MatrixPencil], method: AnyMethod, step_sizes: Array, growth: float
) -> NDArray[np.bool_]:
    """At which step sizes a mode grows, or may grow, by more than `growth`, a logarithm."""
    grows = np.zeros(step_sizes.size, dtype=bool)
    for system in systems:
        left = np.flatnonzero(~grows)
        if left.size:
            determinants = step_determinants([system], method, step_sizes[left])
            grows[left] = count_zeros(determinants, math.exp(-growth)) != 0
    return grows


def largest_stable_step(scene: Scene, method: AnyMethod, *, fewest: int = 1) -> float | None:
    """The step T / N of :func:`least_stable_n_steps`; None where no step is stable."""
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
    """Why a run is refused, and what to do instead."""
    parts = [f"predicted unstable: {prediction.reason}"]
    steps = least_stable_n_steps(scene, method)
    if steps is None:
        parts.append(
            f"{method_name(method)} is unstable for all steps down to T / {LARGEST_N_STEPS}"
        )
    else:
        parts.append(
            f"the largest stable step of {method_name(method)} is about "
            f"{scene.final_time / steps:.3g} (N = {steps})"
        )
    other = stable_method(scene, method, n_steps)
    if other is not None:
        parts.append(f"at this step {other.cq} of degree {other.degree} is stable")
    parts.append("allow_unstable: true computes the run nevertheless")
    return "; ".join(parts)
