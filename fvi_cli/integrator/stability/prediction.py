r"""Linear stability, known before the run.

A mode of the step equations that grows by :math:`1/|z|` in a step makes a run **unstable** when
its growth over all the steps exceeds that of the exact scene a thousandfold,

.. math:: N \log\frac{1}{|z|} > T \max \mathrm{Re}\, s + \log 10^3,

where s runs over the zeros of :math:`\det(s^2 M + \sum_j s^{\gamma_j} D_j + K)` with Re s > 0 and
:math:`|\mathrm{Im}\, s| h < \pi`, unless it is itself an approximation of such an s: with
:math:`\tilde s = -\log(z) / h`

.. math::
   |\tilde s - s| \le \tfrac14 |s|, \qquad \mathrm{Re}\, \tilde s \le \tfrac54 \mathrm{Re}\, s .

So a scene of negative damping, which really grows, is not called unstable, not even if the growth
is so long, or so poorly resolved, that a small error of its rate makes a large factor.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Baseline
from fvi_cli.integrator.method_by_name import as_method
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.stability.determinants import step_determinants
from fvi_cli.integrator.stability.linearisation import linearised_along, linearised_at_start
from fvi_cli.integrator.stability.modes import (
    growing_frequencies,
    growing_modes,
    largest_rate,
)
from fvi_cli.integrator.stability.patterns import has_patterns
from fvi_cli.integrator.stability.systems import MatrixPencil, independent_systems
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import ComplexArray
from fvi_cli.mathematics.transforms.zeros import ZeroCountError, find_zeros

Verdict = Literal["stable", "unstable", "unknown"]

TOLERATED_GROWTH = 1e3
"""Factor by which a run may exceed the growth of the exact scene."""

NOTICED_GROWTH = 10.0
"""Factor that gives a warning: a digit."""

RESOLVED = 0.25
"""Relative error up to which a mode that grows counts as a mode of the exact scene."""

LARGEST_DIMENSION = 24
"""Most coupled components of one system that is examined."""

LARGEST_NUMBER_OF_SYSTEMS = 20_000
"""Most independent systems of one scene that is examined."""


@dataclass(frozen=True, kw_only=True)
class StabilityPrediction:
    """Prediction for a run from the modes of the step equations."""

    verdict: Verdict  # unknown where nothing is proved
    growth_per_step: float = 0.0  # log(1/|z|) of the worst mode; 0 where none grows
    exact_growth: float = 0.0  # h max Re s of the exact scene; 0 where nothing grows
    growing_modes: int = 0  # with multiplicity, that grow by a tenth or more over the run
    reason: str = ""
    linearised_verdict: Verdict = "unknown"  # of a nonlinear scene, linearised at the start

    def is_noticed(self, n_steps: int) -> bool:
        """Whether a mode grows that the exact scene lacks, too slowly for an unstable run."""
        grows = self.growth_per_step * n_steps >= math.log(NOTICED_GROWTH)
        return grows and self.verdict == "stable" and self.exact_growth == 0.0


NO_GAIN = StabilityPrediction(
    verdict="stable",
    reason="the scene has no source of energy, and no step of the method gains energy",
)


def predict_stability(scene: Scene, method: AnyMethod | str, n_steps: int) -> StabilityPrediction:
    """Predict whether a run of `scene` by `method` in `n_steps` steps would blow up, and why.

    A method may be given by its name. For a nonlinear scene the numbers are those of the
    scene linearised at its start, without a verdict.

    Raises
    ------
    ValueError
        If N is not positive.
    """
    method = as_method(method)
    if n_steps < 1:
        raise ValueError(f"n_steps: {n_steps!r} is not allowed; it must be an integer >= 1")
    if not has_patterns(method):
        return StabilityPrediction(
            verdict="unknown", reason=f"no prediction for {method_name(method)}"
        )
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
    if gains_no_energy(method) and scene.is_dissipative:
        return NO_GAIN
    systems = () if scene.is_sparse or scene.active_laws else independent_systems(scene)
    if reason := _why_not(scene, systems):
        return StabilityPrediction(verdict="unknown", reason=reason)
    h = scene.final_time / n_steps
    found = [(part, growing_frequencies(part, scene.final_time, h)) for part in systems]
    exact = h * max(largest_rate(part, frequencies, h) for part, frequencies in found)
    try:
        growing = growing_modes(systems, method, h, n_steps)
        limit = exact + math.log(TOLERATED_GROWTH) / n_steps
        is_spurious = growing.growth > limit
        if is_spurious and exact > 0.0:
            is_spurious = any(
                _has_spurious_mode(
                    _zeros_beyond(part, method, h, limit) if zeros is None else zeros,
                    frequencies,
                    h,
                    limit,
                )
                for zeros, (part, frequencies) in zip(growing.zeros, found, strict=True)
            )
    except ZeroCountError as error:
        return StabilityPrediction(verdict="unknown", exact_growth=exact, reason=str(error))
    reason = (
        f"a mode grows by a factor {_factor(growing.growth)} per step, the exact scene by "
        f"{_factor(exact)}"
    )
    if not growing.count:
        reason = "no mode grows"
    elif growing.growth <= exact:
        reason = "no mode outgrows the exact scene"
    elif growing.growth <= limit:
        reason += f"; over the run by {_factor((growing.growth - exact) * n_steps)} more"
    elif not is_spurious:
        reason += ": the same mode, not resolved well"
    return StabilityPrediction(
        verdict="unstable" if is_spurious else "stable",
        growth_per_step=growing.growth,
        exact_growth=exact,
        growing_modes=growing.count,
        reason=reason,
    )


def _why_not(scene: Scene, systems: Sequence[MatrixPencil]) -> str:
    """Why the determinants of a scene are not computed; empty if they are."""
    if scene.active_laws:
        return "modes are not computed for scenes with relaxation laws"
    if scene.is_sparse:
        return f"modes are not computed for {scene.dimension} coupled components"
    size = systems[0].dimension
    if size > LARGEST_DIMENSION:
        return (
            f"modes are not computed for {size} components that cannot be decoupled; "
            f"at most {LARGEST_DIMENSION}"
        )
    if len(systems) > LARGEST_NUMBER_OF_SYSTEMS:
        return (
            f"modes are not computed for {len(systems)} independent systems; at most "
            f"{LARGEST_NUMBER_OF_SYSTEMS}"
        )
    return ""


def gains_no_energy(method: AnyMethod) -> bool:
    r"""Whether no run of a dissipative scene can grow by this method, whatever its matrices.

    Gauss: the damping force does negative work over every run, and the rest keeps the energy, for
    the symbol is a matrix of positive real part. One point and BDF1 or BDF2: divided by
    :math:`((1 + z) / 2)^2` the equations are
    :math:`\sigma(z)^2 M + K + \sum_j (\gamma_p(z) / h)^{\gamma_j} D_j` with the
    trapezoidal rule's :math:`\sigma`; all terms have negative imaginary parts where Im z > 0.
    """
    if isinstance(method, Baseline):
        return False
    if method.is_runge_kutta:
        return method.cq == "gauss"
    rule = method.rule
    is_midpoint = method.degree == 1 and (rule.rule, rule.points) == ("gauss", 1)
    return is_midpoint and method.sampling == "points" and method.bdf_order <= 2


def stability_along(
    scene: Scene, method: AnyMethod, n_steps: int, trajectory: Trajectory
) -> tuple[float, StabilityPrediction] | None:
    """Time and prediction of the worst of some linearisations along a finished run.

    None for a linear scene, and if no point could be linearised. The verdict is that of the scene
    linearised there, and only a warning: a mode needs time to grow, and the motion moves on.
    """
    found = [
        (time, predict_stability(near, method, n_steps))
        for time, near in linearised_along(scene, trajectory)
    ]
    return max(
        found,
        key=lambda one: (one[1].verdict == "unstable", one[1].growth_per_step),
        default=None,
    )


def _factor(growth: float) -> str:
    return f"{math.exp(min(growth, 700.0)):.4g}"


def _zeros_beyond(
    system: MatrixPencil, method: AnyMethod, step_size: float, limit: float
) -> ComplexArray | None:
    """The z of modes that grow faster than `limit` per step; None: they cannot be separated."""
    determinant = step_determinants([system], method, step_size)
    return find_zeros(determinant.of(0), math.exp(-limit), determinant.degree)


def _has_spurious_mode(
    zeros: ComplexArray | None, frequencies: ComplexArray | None, step_size: float, limit: float
) -> bool:
    """Whether a mode that grows faster than `limit` per step is no mode of the exact scene."""
    if zeros is not None:
        zeros = zeros[np.abs(zeros) < math.exp(-limit)]
        if not zeros.size:
            return False
    if zeros is None or frequencies is None or not frequencies.size:
        return True
    with np.errstate(divide="ignore"):
        modes = -np.log(zeros)[:, None] / step_size
    # the logarithm is ambiguous where the mode alternates, and zeros come in conjugate pairs
    exact = np.concatenate([frequencies, frequencies.conj()])[None, :]
    is_near = np.abs(modes - exact) <= RESOLVED * np.abs(exact)
    is_no_faster = modes.real <= (1.0 + RESOLVED) * exact.real
    return not bool((is_near & is_no_faster).any(axis=1).all())
