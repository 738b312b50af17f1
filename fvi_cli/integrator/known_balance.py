r"""Works and momenta beside a known part S of the motion.

With u what the steps gave and F[u] its damping force, an integral of forces times a field falls
into parts: those of u alone by the scheme's quadrature, those in which S takes part to round-off,
since S and its fractional derivatives begin with fractional powers at 0 and at every break.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.effects.symmetry import Symmetry
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.expansion import forcing_is_smooth
from fvi_cli.integrator.known_part import FORCING_CUTOFF, KnownPart
from fvi_cli.integrator.moments import FINE_POINTS, LEAST_POWER, StepFunction, exact_moments
from fvi_cli.integrator.motion import Motion, grid_velocity, paired, running_sum
from fvi_cli.integrator.stage_basis import legendre_stages
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.lagrange import LagrangeBasis
from fvi_cli.mathematics.power_series import SeriesError, initial_terms

Array = NDArray[np.float64]

FAR_POINTS: Final = 8
"""Points of the rule on steps that are not close to where S is singular."""


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


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownField:
    """A field along S with what S does to it, made once for all the balances that it enters.

    Parameters
    ----------
    values
        The part of a field that depends on S, on steps.
    moments
        Its moments to round-off, shape ``(n, s + 1, d)``.
    force_moments
        Those of the damping force of S, less the jump of Riemann-Liouville.
    pairing
        Integral of the two over every step, shape ``(n,)``.
    """

    values: StepFunction
    moments: Array
    force_moments: Array
    pairing: Array


def known_field(motion: Motion, values: StepFunction) -> KnownField:
    """Moments of a field along S, of the damping force of S, and of the two together.

    Raises
    ------
    ValueError
        If the motion has no known part.
    """
    known, jump = motion.known, motion.jump
    if known is None:
        raise ValueError("diagnostics: the motion has no known part")
    d = motion.scene.dimension

    def together(start: Array, step_size: float, offsets: Array) -> Array:
        field = values(start, step_size, offsets)
        force = known.damping_force(start, step_size, offsets)
        if jump is not None:
            force = force - jump(start, step_size, offsets)
        return np.concatenate([field, force, (field * force).sum(-1, keepdims=True)], axis=-1)

    moments = _known_moments(
        motion, together, far_points=FAR_POINTS, least_power=_least_power(motion, known)
    )
    return KnownField(
        values=values,
        moments=moments[..., :d],
        force_moments=moments[..., d : 2 * d],
        # the basis sums to one
        pairing=moments[..., -1].sum(axis=1),
    )


def damping_beside_known(motion: Motion, of_unknown: Array, field: KnownField) -> Array:
    """Running integral of the whole damping force times a field, shape ``(n + 1,)``.

    Parameters
    ----------
    motion
        With a known part S.
    of_unknown
        The part of the field that depends on u, at the control points, shape ``(n, s + 1, d)``.
    field
        The part that depends on S.
    """
    tables, n = motion.tables, motion.n_steps
    force = motion.stepped.end_force[:n]
    if motion.method.is_runge_kutta:
        values = legendre_stages(tables.sample_points).to_values
        force = np.einsum("im,kmd->kid", values, force)
    at_samples = np.einsum("vm,kvd->kmd", tables.sample_basis, of_unknown)
    changes = np.einsum("m,kmd,kmd->k", motion.step_size * tables.sample_weights, force, at_samples)
    at_control = np.einsum("iv,kid->kvd", _from_samples(tables), force)
    changes += paired(field.moments, at_control, n)
    changes += paired(field.force_moments, of_unknown, n) + field.pairing
    return running_sum(changes)


def _from_samples(tables: StepTables) -> Array:
    """The polynomials on the sampling points at the control points, shape ``(m, s + 1)``."""
    if tables.sample_points.size == 1:
        return np.ones((1, tables.control_points.size))
    return LagrangeBasis(control_points=tables.sample_points).values(tables.control_points)


def forcing_beside_known(motion: Motion, of_unknown: Array, field: KnownField) -> Array:
    """Running integral of the forcing times a field, as the scheme sees the forcing.

    That is its interpolant on the quadrature points; a forcing that starts with a fractional power
    drives S too, and is taken as it is.
    """
    forcing, tables, n = motion.scene.forcing, motion.tables, motion.n_steps
    if forcing is None:
        return np.zeros(n + 1)
    if not _starts_smoothly(motion.scene):
        return running_sum(_forcing_on(motion, forcing, of_unknown, field.values))
    left = motion.step_size * np.arange(n, dtype=float)
    values = forcing.on_steps(left, motion.step_size, tables.sample_points)
    at_samples = np.einsum("vm,kvd->kmd", tables.sample_basis, of_unknown)
    weights = motion.step_size * tables.sample_weights
    changes = np.einsum("m,kmd,kmd->k", weights, values, at_samples)
    at_control = np.einsum("iv,kid->kvd", _from_samples(tables), values)
    return running_sum(changes + paired(field.moments, at_control, n))


def _starts_smoothly(scene: Scene) -> bool:
    try:
        return forcing_is_smooth(scene, FORCING_CUTOFF)
    except SeriesError:
        return True


def _forcing_on(
    motion: Motion, forcing: Forcing, of_unknown: Array, of_known: StepFunction
) -> Array:
    """Integral over every step of the forcing times a field, shape ``(n,)``."""

    def together(start: Array, step_size: float, offsets: Array) -> Array:
        force = forcing.on_steps(start, step_size, offsets)
        pair = force * of_known(start, step_size, offsets)
        return np.concatenate([force, pair.sum(axis=-1, keepdims=True)], axis=-1)

    moments = _known_moments(motion, together)
    both = moments[..., -1].sum(axis=1)
    return np.asarray(both + paired(moments[..., :-1], of_unknown, motion.n_steps))


def _known_moments(
    motion: Motion,
    function: StepFunction,
    *,
    far_points: int = FINE_POINTS,
    least_power: float = LEAST_POWER,
) -> Array:
    """Moments to round-off, since what is known begins with fractional powers at every break."""
    return exact_moments(
        function,
        motion.method,
        motion.step_size,
        motion.n_steps,
        _singular_steps(motion),
        far_points=far_points,
        least_power=least_power,
    )


def _least_power(motion: Motion, known: KnownPart) -> float:
    """Least power of t with which the damping force of S begins; 0 where all are positive."""
    scene = motion.scene
    orders = [term.order for term in scene.active_damping]
    windows = [window for _, window in known.jumps]
    if known.start.window is not None:
        windows.append(known.start.window)
    least = 0.0 if motion.jump is None else -max(orders)
    for window in windows:
        for order in orders:
            kept = window.exponents
            if scene.derivative == "caputo":
                kept = kept[~initial_terms(kept, order)]
            least = min(least, float(kept.min(initial=2.0)) - order)
    return least


def _singular_steps(motion: Motion) -> tuple[int, ...]:
    breaks = steps_at_break_points(motion.scene, round(motion.scene.final_time / motion.step_size))
    return tuple(step for step in (0, *breaks) if step < motion.n_steps)
