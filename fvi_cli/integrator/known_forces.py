"""What is known in advance of a run, a range of steps at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.exponential_history import exponential_kernel
from fvi_cli.integrator.integrate import force_moments, jump_force
from fvi_cli.integrator.known_lagrangian import known_motion
from fvi_cli.integrator.known_motion import KnownMotion
from fvi_cli.integrator.known_part import KnownPart
from fvi_cli.integrator.memory import Memory, build_channels
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.moments import StepFunction, exact_moments, galerkin_moments
from fvi_cli.integrator.step_tables import StepTables

Array = NDArray[np.float64]
MotionRange = Callable[[int, int], KnownMotion]
Range = Callable[[int, int], Array]
"""``(first, last)`` to rows for the steps `first` <= k < `last`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownForces:
    """Known forces and positions of a scene, as functions of a range of steps.

    Parameters
    ----------
    moment_parts
        Moments of known forces, each to shape ``(n, s + 1, d)``.
    shift
        Known part of the position at the quadrature points, to ``(n, r, d)``; None: zero.
    size
        s + 1 and d.
    motion
        Known part of the motion of a general Lagrangian; None: none.
    """

    moment_parts: tuple[Range, ...]
    shift: Range | None
    size: tuple[int, int]
    motion: MotionRange | None = None

    def moments(self, first: int, last: int) -> Array | None:
        """All moments together, shape ``(last - first, s + 1, d)``; None where there are none."""
        if not self.moment_parts:
            return None
        total = np.zeros((last - first, *self.size))
        for part in self.moment_parts:
            total += part(first, last)
        return total


def known_forces(
    scene: Scene,
    method: Method,
    tables: StepTables,
    memory: Memory,
    known: KnownPart | None,
    n_steps: int,
) -> KnownForces:
    """The forces that are known in advance for Runge-Kutta convolution quadrature.

    Parameters
    ----------
    scene, method, tables, memory
        What is integrated and how; `memory` without a known force.
    known
        The part of the solution that is known in advance; None without.
    n_steps
        Number N of steps of the whole run.
    """
    h = scene.final_time / n_steps
    breaks = steps_at_break_points(scene, n_steps)
    from_rest = known is not None and known.carries_start
    parts: list[Range] = []

    def by_moments(force: StepFunction, make: Callable[[StepFunction, int, int], Array]) -> Range:
        def moments(first: int, last: int) -> Array:
            def later(start: Array, step_size: float, offsets: Array) -> Array:
                return force(step_size * (np.rint(start / step_size) + first), step_size, offsets)

            return make(later, first, last)

        return moments

    def plain(force: StepFunction, first: int, last: int) -> Array:
        return galerkin_moments(force, tables, h, last - first)

    def as_asked(force: StepFunction, first: int, last: int) -> Array:
        singular = tuple(b - first for b in (0, *breaks) if first <= b < last)
        return force_moments(force, method, tables, h, last - first, singular)

    def to_round_off(force: StepFunction, first: int, last: int) -> Array:
        singular = (0,) if first == 0 else ()
        return exact_moments(force, method, h, last - first, singular)

    if known is not None:
        parts.append(by_moments(known.residual(), plain))
    elif scene.forcing is not None:
        parts.append(by_moments(scene.forcing.on_steps, as_asked))
    jump = None if from_rest else jump_force(scene)
    if jump is not None:
        parts.append(by_moments(jump, to_round_off))
    constant = None if from_rest else _subtracted_velocity(scene, method, tables, memory, n_steps)
    if constant is not None:
        parts.append(constant)
    shift: Range | None = None
    if known is not None and scene.potential is not None:
        part = known

        def position(first: int, last: int) -> Array:
            return part.position(h * np.arange(first, last, dtype=float), h, tables.points)

        if isinstance(scene.potential, QuadraticPotential):
            stiffness = scene.potential.stiffness

            def pull(first: int, last: int) -> Array:
                values = position(first, last) @ stiffness
                return np.asarray(-h * np.einsum("ni,kid->knd", tables.test_weights, values))

            parts.append(pull)
        else:
            shift = position
    return KnownForces(
        moment_parts=tuple(parts),
        shift=shift,
        size=(tables.degree + 1, scene.dimension),
        motion=_motion(scene, tables, known, h),
    )


def _motion(
    scene: Scene, tables: StepTables, known: KnownPart | None, step_size: float
) -> MotionRange | None:
    lagrangian = scene.lagrangian
    window = None if known is None else known.start.window
    if lagrangian is None or window is None:
        return None
    return partial(known_motion, lagrangian, window, tables, step_size)


def _subtracted_velocity(
    scene: Scene, method: Method, tables: StepTables, memory: Memory, n_steps: int
) -> Range | None:
    """Moments of the force of v0 t that Caputo derivatives of orders above 1 leave out.

    Where all orders are above 1 the samples do without v0 themselves.
    """
    velocity, h = scene.initial_velocity, scene.final_time / n_steps
    above = tuple(term for term in scene.active_damping if term.order > 1)
    if scene.derivative != "caputo" or not np.any(velocity != 0):
        return None
    if len(above) in (0, len(scene.active_damping)):
        return None
    channels = build_channels(method, h, 1, above, n_steps)
    kernel = exponential_kernel(method, h, n_steps, above, channels)
    if kernel is None:  # pragma: no cover - orders above 1 have a memory
        return None
    source = kernel

    def moments(first: int, last: int) -> Array:
        force = np.zeros((last - first, memory.sample_matrix.shape[1], scene.dimension))
        for index, channel in enumerate(channels):
            response = source.constant_response(index, channel.weights[0], first, last)
            force += response[:, :, None] * (velocity @ channel.direction)
        return np.asarray(h * np.einsum("ni,kid->knd", memory.force_weights, force))

    return moments
