r"""Works and momenta beside a known part S of the motion.

With u what the steps gave and F[u] its damping force, an integral of forces times a field falls
into parts: those of u alone by the scheme's quadrature, those in which S takes part to round-off,
since S and its fractional derivatives begin with fractional powers at 0 and at every break.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.effects.symmetry import Symmetry
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.expansion import forcing_is_smooth
from fvi_cli.integrator.known_part import FORCING_CUTOFF, KnownPart
from fvi_cli.integrator.moments import StepFunction, exact_integrals, exact_moments
from fvi_cli.integrator.motion import Motion, grid_velocity, paired, running_sum
from fvi_cli.integrator.stage_basis import legendre_stages
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.lagrange import LagrangeBasis
from fvi_cli.mathematics.power_series import SeriesError

Array = NDArray[np.float64]


def collocated_rates(motion: Motion, known: KnownPart, rates: Array) -> Array:
    """Velocity of u as the momentum makes it: one degree higher, from the start of every step.

    It agrees with the derivative of the positions at the quadrature points and is better between
    them, which matters where it meets the singular force of a jump.
    """
    tables, n = motion.tables, motion.n_steps
    points = tables.sample_points
    if points[0] == 0.0 or points.size != tables.degree:
        return rates
    grid = motion.step_size * np.arange(n + 1, dtype=float)
    start = grid_velocity(motion, motion.momentum) - known.on_grid(grid)[1]
    at_points = np.einsum("vm,kvd->kmd", tables.sample_basis, rates)
    through = LagrangeBasis(control_points=np.concatenate([[0.0], points]))
    values = np.concatenate([start[:n, None], at_points], axis=1)
    return np.asarray(np.einsum("vc,kvd->kcd", through.values(tables.control_points), values))


def direction_of_known(known: KnownPart, symmetry: Symmetry) -> StepFunction:
    """The motion of a symmetry at S."""

    def direction(start: Array, step_size: float, offsets: Array) -> Array:
        return symmetry.direction(known.position(start, step_size, offsets))

    return direction


def damping_beside_known(motion: Motion, of_unknown: Array, of_known: StepFunction) -> Array:
    """Running integral of the whole damping force times a field, shape ``(n + 1,)``.

    Parameters
    ----------
    motion
        With a known part S.
    of_unknown
        The part of the field that depends on u, at the control points, shape ``(n, s + 1, d)``.
    of_known
        The part that depends on S.
    """
    known = motion.known
    if known is None:
        raise ValueError("diagnostics: the motion has no known part")
    tables, n = motion.tables, motion.n_steps
    force = motion.stepped.end_force[:n]
    if motion.method.is_runge_kutta:
        values = legendre_stages(tables.sample_points).to_values
        force = np.einsum("im,kmd->kid", values, force)
    field = np.einsum("vm,kvd->kmd", tables.sample_basis, of_unknown)
    changes = np.einsum("m,kmd,kmd->k", motion.step_size * tables.sample_weights, force, field)
    at_control = np.einsum("iv,kid->kvd", _from_samples(tables), force)
    changes += paired(_known_moments(motion, of_known), at_control, n)
    changes += _known_force_on(motion, known.damping_force, of_unknown, of_known)
    if motion.jump is not None:
        changes -= _known_force_on(motion, motion.jump, of_unknown, of_known)
    return running_sum(changes)


def _from_samples(tables: StepTables) -> Array:
    """The polynomials on the sampling points at the control points, shape ``(m, s + 1)``."""
    if tables.sample_points.size == 1:
        return np.ones((1, tables.control_points.size))
    return LagrangeBasis(control_points=tables.sample_points).values(tables.control_points)


def forcing_beside_known(motion: Motion, of_unknown: Array, of_known: StepFunction) -> Array:
    """Running integral of the forcing times a field, as the scheme sees the forcing.

    That is its interpolant on the quadrature points; a forcing that starts with a fractional power
    drives S too, and is taken as it is.
    """
    forcing, tables, n = motion.scene.forcing, motion.tables, motion.n_steps
    if forcing is None:
        return np.zeros(n + 1)
    if not _starts_smoothly(motion.scene):
        return running_sum(_known_force_on(motion, forcing.on_steps, of_unknown, of_known))
    left = motion.step_size * np.arange(n, dtype=float)
    values = forcing.on_steps(left, motion.step_size, tables.sample_points)
    field = np.einsum("vm,kvd->kmd", tables.sample_basis, of_unknown)
    changes = np.einsum("m,kmd,kmd->k", motion.step_size * tables.sample_weights, values, field)
    at_control = np.einsum("iv,kid->kvd", _from_samples(tables), values)
    return running_sum(changes + paired(_known_moments(motion, of_known), at_control, n))


def _starts_smoothly(scene: Scene) -> bool:
    try:
        return forcing_is_smooth(scene, FORCING_CUTOFF)
    except SeriesError:
        return True


def _known_force_on(
    motion: Motion, force: StepFunction, of_unknown: Array, of_known: StepFunction
) -> Array:
    """Integral over every step of a known force times a field, shape ``(n,)``."""

    def product(start: Array, step_size: float, offsets: Array) -> Array:
        pair = force(start, step_size, offsets) * of_known(start, step_size, offsets)
        return np.asarray(pair.sum(axis=-1, keepdims=True))

    n = motion.n_steps
    both = exact_integrals(product, motion.step_size, n, _singular_steps(motion))[:, 0]
    return np.asarray(both + paired(_known_moments(motion, force), of_unknown, n))


def _known_moments(motion: Motion, function: StepFunction) -> Array:
    """Moments to round-off, since what is known begins with fractional powers at every break."""
    return exact_moments(
        function, motion.method, motion.step_size, motion.n_steps, _singular_steps(motion)
    )


def _singular_steps(motion: Motion) -> tuple[int, ...]:
    breaks = steps_at_break_points(motion.scene, round(motion.scene.final_time / motion.step_size))
    return tuple(step for step in (0, *breaks) if step < motion.n_steps)
