"""Up to which step a method is stable, and what to do beyond."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.stability.determinant import independent_systems
from fvi_cli.integrator.stability.linearisation import linearised_at_start
from fvi_cli.integrator.stability.prediction import StabilityPrediction, predict_stability

LARGEST_N_STEPS = 1 << 30

NEGLIGIBLE = 1e-3
"""Forces of a step this small beside inertia make no mode grow."""


def least_stable_n_steps(scene: Scene, method: AnyMethod) -> int | None:
    """Number of steps from which on halving the step keeps the run stable.

    The step is halved until nothing but inertia matters in a step, and the last change of the
    verdict is closed in by bisection to a thousandth. None where the finest step is unstable.
    """
    linear = linearised_at_start(scene)
    sizes = [pair for system in independent_systems(linear) for pair in system.sizes]

    def is_unstable(n_steps: int) -> bool:
        return predict_stability(linear, method, n_steps).verdict == "unstable"

    n_steps, last = 1, 0
    while n_steps <= LARGEST_N_STEPS:
        if is_unstable(n_steps):
            last = n_steps
        h = scene.final_time / n_steps
        if max((size * h ** (2.0 - order) for order, size in sizes), default=0.0) < NEGLIGIBLE:
            break
        n_steps *= 2
    if 2 * last > LARGEST_N_STEPS:
        return None
    if not last:
        return 1
    low, high = last, 2 * last
    while high - low > max(1, low // 1024):
        middle = (low + high) // 2
        if is_unstable(middle):
            low = middle
        else:
            high = middle
    return high


def largest_stable_step(scene: Scene, method: AnyMethod) -> float | None:
    """Largest step T / N, N an integer, from which on smaller ones are predicted stable.

    None where no step is.
    """
    n_steps = least_stable_n_steps(scene, method)
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
