r"""Linear stability, known before the run.

A mode of the step equations that grows by :math:`1/|z|` in a step makes a run **unstable** when
its growth over all the steps exceeds that of the exact scene a thousandfold,

.. math:: N \log\frac{1}{|z|} > T \max \mathrm{Re}\, s + \log 10^3,

where s runs over the zeros of :math:`\det(s^2 M + \sum_j s^{\gamma_j} D_j + K)` with Re s > 0 and
:math:`|\mathrm{Im}\, s| h < \pi`. So a scene of negative damping, whose growth is the truth, is not
called unstable.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.stability_determinant import (
    LinearSystem,
    half_plane,
    independent_systems,
    number_of_unknowns,
    step_determinant,
)
from fvi_cli.mathematics.disc_zeros import (
    LogFunction,
    ZeroCountError,
    enclosed_zero_modulus,
    find_zeros,
    zeros_in_disc,
)

Verdict = Literal["stable", "unstable", "unknown"]

TOLERATED_GROWTH = 1e3
"""Factor by which a run may exceed the growth of the exact scene."""

LARGEST_DIMENSION = 24
"""Coupled components of one system that are looked at."""

LARGEST_NUMBER_OF_SYSTEMS = 256
"""Independent systems of one scene that are looked at."""

LARGEST_N_STEPS = 1 << 30

NEGLIGIBLE = 1e-3
"""Forces of a step this small beside inertia make no mode grow."""


@dataclass(frozen=True, kw_only=True)
class StabilityPrediction:
    r"""What the modes of the step equations say about a run.

    Parameters
    ----------
    verdict
        ``stable``, ``unstable``, or ``unknown`` where nothing is proved.
    growth_per_step
        :math:`\log(1/|z|)` of the worst mode; 0 where none grows.
    exact_growth
        :math:`h \max \mathrm{Re}\, s` of the exact scene, per step; 0 where nothing grows.
    growing_modes
        Number of modes, with their multiplicity, that grow by a tenth or more over the run.
    reason
        In words.
    linearised_verdict
        Of a nonlinear scene, that of the scene linearised at the start.
    """

    verdict: Verdict
    growth_per_step: float = 0.0
    exact_growth: float = 0.0
    growing_modes: int = 0
    reason: str = ""
    linearised_verdict: Verdict = "unknown"


def predict_stability(scene: Scene, method: AnyMethod, n_steps: int) -> StabilityPrediction:
    """Tell whether a run of `scene` by `method` in `n_steps` steps would blow up.

    Parameters
    ----------
    scene, method
        What is integrated and how.
    n_steps
        Number N of steps.

    Returns
    -------
    StabilityPrediction
        Of a nonlinear scene, the numbers of the scene linearised at its start, and no verdict.

    Raises
    ------
    ValueError
        If N is not positive.
    """
    if n_steps < 1:
        raise ValueError(f"n_steps: {n_steps!r} is not allowed; it must be an integer >= 1")
    if not scene.is_linear:
        try:
            linear = linearised_at_start(scene)
        except ValueError as error:
            reason = f"nonlinear; it cannot be linearised at the start: {error}"
            return StabilityPrediction(verdict="unknown", reason=reason)
        linearised = predict_stability(linear, method, n_steps)
        return replace(
            linearised,
            verdict="unknown",
            linearised_verdict=linearised.verdict,
            reason=f"nonlinear; linearised at the start: {linearised.reason}",
        )
    systems = independent_systems(scene)
    size = systems[0].mass.shape[0]
    if size > LARGEST_DIMENSION or len(systems) > LARGEST_NUMBER_OF_SYSTEMS:
        return StabilityPrediction(
            verdict="unknown",
            reason=(
                f"{len(systems)} systems of {size} coupled components are too many to be looked "
                f"at; at most {LARGEST_NUMBER_OF_SYSTEMS} of {LARGEST_DIMENSION}"
            ),
        )
    h = scene.final_time / n_steps
    exact = h * max(exact_growth(system, scene.final_time, h) for system in systems)
    counts, worst = 0, 0.0
    try:
        for system in systems:
            count, growth = _growing_modes(
                step_determinant(system, method, h), n_steps, number_of_unknowns(system, method)
            )
            counts, worst = counts + count, max(worst, growth)
    except ZeroCountError as error:
        return StabilityPrediction(verdict="unknown", exact_growth=exact, reason=str(error))
    excess = n_steps * (worst - exact)
    if excess > math.log(TOLERATED_GROWTH):
        verdict: Verdict = "unstable"
        reason = (
            f"a mode grows by a factor {_factor(worst)} per step, the exact scene by "
            f"{_factor(exact)}"
        )
    else:
        verdict = "stable"
        reason = "no mode grows" if not counts else "no mode outgrows the exact scene"
    return StabilityPrediction(
        verdict=verdict,
        growth_per_step=worst,
        exact_growth=exact,
        growing_modes=counts,
        reason=reason,
    )


def _factor(growth: float) -> str:
    return f"{math.exp(min(growth, 700.0)):.4g}"


def _growing_modes(log_determinant: LogFunction, n_steps: int, degree: int) -> tuple[int, float]:
    """Number of modes that grow by a tenth or more over the run, and the growth of the worst."""
    # a little different where a zero lies on the circle itself
    for share in (10.0, 10.7, 9.1):
        radius = 1.0 - 1.0 / (share * n_steps)
        try:
            found = zeros_in_disc(log_determinant, radius, degree)
            if found.count == 0:
                return 0, 0.0
            if found.zeros is None:
                modulus = enclosed_zero_modulus(log_determinant, radius, degree)
            else:
                modulus = float(np.abs(found.zeros[0]))
        except ZeroCountError:
            continue
        return found.count, -math.log(modulus) if modulus > 0 else 700.0
    raise ZeroCountError("a mode lies too close to the circle of no growth to be counted")


def exact_growth(system: LinearSystem, final_time: float, step_size: float) -> float:
    r"""Largest Re s of the exact scene that a step of this size can follow; 0 where none grows.

    Parameters
    ----------
    system
        The scene's matrices.
    final_time, step_size
        T and h: growth by less than a tenth over T is none, and zeros with
        :math:`|\mathrm{Im}\, s| h \ge \pi` are left out.
    """
    if system.is_dissipative:
        return 0.0
    plane = half_plane(system, step_size)
    least = 0.05 / final_time
    if least >= plane.scale:
        return 0.0
    for nudge in (1.0, 1.1, 0.9):
        radius = plane.radius(least * nudge)
        try:
            zeros = find_zeros(plane.log_determinant, radius, 4 * system.mass.shape[0])
        except ZeroCountError:
            continue
        if zeros is None:
            continue
        s = plane.frequency(zeros)
        seen = s[np.abs(s.imag) * step_size < math.pi]
        return max(0.0, float(seen.real.max(initial=0.0)))
    # what cannot be told apart is not held against the method
    return plane.scale


def linearised_at_start(scene: Scene) -> Scene:
    """The linear scene that a nonlinear one is close to its start.

    Of a Lagrangian its second derivatives at the start, without the gyroscopic part.

    Raises
    ------
    ValueError
        If these are not those of a mass and a stiffness.
    """
    if scene.lagrangian is not None:
        at = scene.lagrangian.derivatives(scene.initial_position, scene.initial_velocity, 0.0)
        inertia, hessian = Inertia(mass=0.5 * (at.mass + at.mass.T)), -at.stiffness
    elif scene.potential is not None and not scene.is_linear:
        inertia, hessian = scene.inertia, scene.potential.hessian(scene.initial_position)
    else:
        return scene
    potential = QuadraticPotential(stiffness=0.5 * (hessian + hessian.T))
    return replace(scene, inertia=inertia, potential=potential, lagrangian=None)


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
        candidate = Method(cq="gauss", degree=lower, start="series")
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
