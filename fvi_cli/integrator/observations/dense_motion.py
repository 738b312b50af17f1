r"""The motion between the points of a mesh, to the order of the method at the points.

The polynomial of a step of an m-stage method has the order m + 1, its velocity m, and the damping
force along it less; at the mesh points the Gauss method has 2 m. So a second run on the same mesh,
by the Gauss method of 2 m stages, gives the shape of every step, and a cubic takes it to the
positions and velocities of the run at both ends: :math:`x(t_n) = q_n`, :math:`x'(t_n) = v_n`
exactly, and between them nothing is lost. With damping of an order above 1 the momenta are not
used: :math:`M v = p_0 - \mu I^{2 - \gamma} v - \dots` at the end of a step has an error of
:math:`h_1^{2 - \gamma}` (Riemann-Liouville, :math:`v_0 \neq 0`) or :math:`h_1^{3 - \gamma}` of the
first step that never decays, since the stability function of a Gauss method is +-1 at infinity;
a straight line then takes the shape to the positions. The slopes are those of the increments of
the steps: in the shortest ones the difference of two positions is round-off. The damping force at
any time is the polynomial through its stage values in that second run, and the acceleration
follows from the equation of motion,

.. math:: M a = f(t) - \nabla V(x) - \sum_j \mu_j D^{\gamma_j} x, \qquad
   L_{vv} a = L_x - L_{vx} v - L_{vt} + f - \sum_j \mu_j D^{\gamma_j} x,

never from differences. The one exception are Riemann-Liouville derivatives of an order above 1 with
:math:`v_0 \neq 0`, whose stage values keep the error of the first step as the momenta do: there
the acceleration is the derivative of the velocity polynomial, and the force follows from the
equation of motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fvi_cli.effects.matrices import times
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.mesh_balance import damping_along
from fvi_cli.integrator.engine.checkpoint import RunKeeper
from fvi_cli.integrator.meshes.singular_start import rate_jumps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.damper_work import alone, running_work, work_at
from fvi_cli.integrator.observations.impacts import replayed
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.on_mesh import integrate_on_mesh
from fvi_cli.integrator.run.setup import prepare_on_mesh
from fvi_cli.integrator.steps.dynamics import General, dynamics_of
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis

MOST_STAGES = 12
"""Stages of the second run at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseMotion:
    r"""A motion at any time of its run.

    Parameters
    ----------
    scene
        What moves.
    steps
        The run.
    shape
        Steps on the same mesh that say what lies between its points; those of the run itself
        where nothing better is known.
    force
        Damping force :math:`\sum \mu D^\gamma q` at the stages of `shape`, ``(n, r, d)``; None
        without damping.
    remark
        What the reader should know; empty: nothing.
    method
        By which the forces of single dampers along `shape` are found; None: they are not.
    """

    scene: Scene
    steps: RunSteps
    shape: RunSteps
    force: Array | None = None
    remark: str = ""
    method: Method | None = None
    _ends: tuple[Array, Array, Array, Array, Array] = field(init=False, repr=False)
    _works: dict[str, Array] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_ends", self._gaps())

    def _gaps(self) -> tuple[Array, Array, Array, Array, Array]:
        """What the shape lacks of positions and velocities at both ends, and of mean velocities.

        Mean velocities are those of the increments, since in short steps the difference of two
        positions is round-off.
        """
        steps, shape = self.steps, self.shape
        if shape is steps:
            nothing = np.zeros_like(steps.position[:-1])
            return nothing, nothing, nothing, nothing, nothing
        way = shape.step_size[:, None] * shape.unknowns[:, -1]
        begin = steps.position[:-1] - shape.position[:-1]
        end = steps.position[1:] - shape.position[:-1] - way
        mean = steps.unknowns[:, -1] - shape.unknowns[:, -1]
        if any(term.order > 1 for term in self.scene.active_damping):
            return begin, mean, end, mean, mean
        dynamics = dynamics_of(self.scene)
        with np.errstate(all="ignore"):
            velocity = dynamics.velocity(steps.position, steps.momentum, steps.time)
            before = velocity
            if steps.jump is not None:
                at_end = steps.momentum - steps.jump
                before = dynamics.velocity(steps.position, at_end, steps.time)
        slopes = lobatto_basis(shape.tables.degree).derivatives([0.0, 1.0])[1:]
        left, right = np.einsum("sk,nsd->knd", slopes, shape.unknowns)
        return begin, velocity[:-1] - left, end, before[1:] - right, mean

    @property
    def end(self) -> float:
        """Time at which the run ended."""
        return float(self.steps.time[-1])

    def located(self, time: Array) -> tuple[Places, Array]:
        """Number of the step and place in it, from 0 to 1, of every time, shape ``(n,)``.

        Raises
        ------
        ValueError
            For times outside of the run.
        """
        return self.steps.located(time, at_ends=True)

    def time(self, steps: Places, tau: Array) -> Array:
        """Times of places, shape ``(n,)``; the end of a step is the point of the mesh."""
        begin = self.steps.time[steps] + tau * self.steps.step_size[steps]
        return np.where(tau == 1.0, self.steps.time[steps + 1], begin)

    def position(self, steps: Places, tau: Array) -> Array:
        """Positions, shape ``(n, d)``."""
        h = self.steps.step_size[steps, None]
        return self.shape.position_in(steps, tau) + self._correction(steps, tau[:, None], h)

    def velocity(self, steps: Places, tau: Array) -> Array:
        """Velocities, shape ``(n, d)``."""
        found = self.shape.velocity_in(steps, tau) + self._correction_rate(steps, tau[:, None])
        if self.shape is not self.steps:  # derivatives of a run are those of its polynomials
            found[(steps == 0) & (tau == 0.0)] = self.scene.initial_velocity
        return np.asarray(found)

    def _correction(self, steps: Places, tau: Array, h: Array) -> Array:
        a, va, b, vb = (one[steps] for one in self._ends[:-1])
        rest, both = 1.0 - tau, tau**2 * (3.0 - 2.0 * tau)
        return np.asarray(a + (b - a) * both + h * tau * rest * (va * rest - vb * tau))

    def _correction_rate(self, steps: Places, tau: Array) -> Array:
        _, va, _, vb, mean = (one[steps] for one in self._ends)
        rest = 1.0 - tau
        return np.asarray(
            6.0 * tau * rest * mean + va * rest * (1.0 - 3.0 * tau) + vb * tau * (3.0 * tau - 2.0)
        )

    def damping(self, steps: Places, tau: Array) -> Array:
        r"""Force of the damping on every coordinate, :math:`-\sum \mu D^\gamma q`, ``(n, d)``."""
        total = np.zeros((steps.size, self.scene.dimension))
        if self.force is None:
            return total
        tables, time = self.shape.tables, self.time(steps, tau)
        if self._starts_with_a_jump:
            total = self._force_by_balance(steps, tau)
        elif tables.points.size == 1:
            total -= self.force[steps, 0]
        else:
            values = tables.stage_basis.values(tau)
            total -= np.einsum("rk,krd->kd", values, self.force[steps])
        with np.errstate(all="ignore"):
            total -= _riemann_liouville(self.scene, time)
        total[np.flatnonzero(time == 0.0)] = _damping_at_start(self.scene)
        return total

    def work(self, name: str, steps: Places, tau: Array) -> Array:
        """Work on a single damper since the start, shape ``(n,)``, see `work_names`."""
        if self.method is None:
            raise ValueError(f"{name}: the work on single dampers is not known here")
        if name not in self._works:
            force = stage_forces(alone(self.scene, name), self.method, self.shape)
            self._works[name] = running_work(self.shape, force)
        return work_at(self._works[name], steps, tau)

    def acceleration(self, steps: Places, tau: Array) -> Array:
        """Accelerations from the equation of motion, shape ``(n, d)``.

        At a break point of the forcing it is that before it.
        """
        time = self.time(steps, tau)
        if self._starts_with_a_jump:
            found = self._velocity_slope(steps, tau)
            found[time == 0.0] = np.nan
            return found
        position, velocity = self.position(steps, tau), self.velocity(steps, tau)
        force = self.damping(steps, tau)
        if self.scene.forcing is not None:
            force = force + self.scene.forcing(time)
        return accelerations(self.scene, position, velocity, force, time)

    @cached_property
    def _starts_with_a_jump(self) -> bool:
        return rate_jumps(self.scene)

    def _velocity_slope(self, steps: Places, tau: Array) -> Array:
        """Derivatives of the velocity polynomials, shape ``(n, d)``."""
        if self.shape.tables.points.size == 1:
            return np.zeros((steps.size, self.scene.dimension))
        slopes = self.shape.tables.stage_basis.derivatives(tau)
        rates = np.einsum("rk,krd->kd", slopes, self.shape.velocity[steps])
        return np.asarray(rates / self.shape.step_size[steps, None])

    def _force_by_balance(self, steps: Places, tau: Array) -> Array:
        """Damping force that the equation of motion asks for, shape ``(n, d)``."""
        scene, time = self.scene, self.time(steps, tau)
        position, velocity = self.position(steps, tau), self.velocity(steps, tau)
        known = np.zeros_like(position) if scene.forcing is None else scene.forcing(time)
        missing = self._velocity_slope(steps, tau)
        missing = missing - accelerations(scene, position, velocity, known, time)
        if scene.lagrangian is None:
            return np.asarray(times(missing, scene.inertia.form))
        with np.errstate(all="ignore"):
            mass = scene.lagrangian.derivatives(position, velocity, time).mass
        return np.asarray(np.einsum("nij,nj->ni", mass, missing))


def accelerations(
    scene: Scene, position: Array, velocity: Array, force: Array, time: Array
) -> Array:
    """Accelerations under forces beside those of the Lagrangian, all of shape ``(n, d)``."""
    dynamics = dynamics_of(scene)
    with np.errstate(all="ignore"):
        if isinstance(dynamics, General):
            lagrangian = dynamics.lagrangian
            at = lagrangian.derivatives(position, velocity, time)
            rest = lagrangian.momentum_rate(position, velocity, np.zeros_like(velocity), time)
            right = at.force + force - rest
            every = np.concatenate([at.mass, right[..., None]], axis=-1)
            usable = np.asarray(np.isfinite(every).all(axis=(-2, -1)))
            mass = np.where(usable[:, None, None], at.mass, np.eye(scene.dimension))
            found = np.linalg.solve(mass, right[..., None])[..., 0]
            return np.where(usable[:, None], found, np.nan)
        _, pull = dynamics.forces(position, velocity, time)
        return scene.inertia.velocity(pull + force)


def _riemann_liouville(scene: Scene, time: Array) -> Array:
    """What Riemann-Liouville derivatives of order below 1 have more than Caputo's."""
    total = np.zeros((time.size, scene.dimension))
    if scene.derivative == "caputo" or not np.any(scene.initial_position != 0):
        return total
    for term in scene.active_damping:
        if term.order < 1:
            power = time**-term.order / math.gamma(1.0 - term.order)
            total += power[:, None] * times(scene.initial_position, term.form)
    return total


def _damping_at_start(scene: Scene) -> Array:
    """The damping force at t = 0; nan where it is infinite."""
    total = np.zeros(scene.dimension)
    singular = scene.derivative == "riemann-liouville"
    for term in scene.active_damping:
        if term.order == 1:
            total -= times(scene.initial_velocity, term.form)
        elif singular:
            driver = scene.initial_position if term.order < 1 else scene.initial_velocity
            total[np.flatnonzero(times(driver, term.form))] = np.nan
    return total


def dense_motion(
    scene: Scene, method: Method, steps: RunSteps, checkpoints: RunKeeper | None = None
) -> DenseMotion:
    """The dense motion of a finished run, by a second run on its mesh.

    Parameters
    ----------
    scene, method
        What moved, and by which Runge-Kutta method.
    steps
        All steps of the run.
    checkpoints
        Where the second run keeps a checkpoint, and goes on from one.
    """
    stages = min(2 * method.degree, MOST_STAGES)
    shape, remark = steps, ""
    own: Method = method
    if stages > method.degree and steps.n_steps:
        own = Method(
            cq="gauss",
            degree=stages,
            start="none",
            forcing_quadrature=method.forcing_quadrature,
        )
        second, said = _second_run(scene, own, steps, checkpoints)
        if second is not None:
            shape = second
        else:
            own = method
            remark = (
                "between the points of the mesh the motion is known to the order of a step only: "
                f"the run of {stages} stages {said}"
            )
    return DenseMotion(
        scene=scene,
        method=own,
        steps=steps,
        shape=shape,
        force=stage_forces(scene, own, shape),
        remark=remark,
    )


def _second_run(
    scene: Scene, method: Method, steps: RunSteps, checkpoints: RunKeeper | None
) -> tuple[RunSteps | None, str]:
    """The run by another method on the same mesh, or why there is none."""
    shorter = replace(scene, final_time=float(steps.time[-1]))
    mesh = steps.mesh(scene.break_points)
    if steps.jump is None:
        second = integrate_on_mesh(shorter, method, mesh, with_steps=True, checkpoints=checkpoints)
        whole = second.steps if second.status == "ok" else None
        return whole, f"{second.status}: {second.message}"
    return replayed(prepare_on_mesh(shorter, method, mesh), steps, checkpoints), "failed"


def stage_forces(scene: Scene, method: Method, steps: RunSteps) -> Array | None:
    """Damping force at the stages of a run, shape ``(n, r, d)``; None without damping."""
    if not scene.active_forces or not steps.n_steps:
        return None
    damping = prepare_on_mesh(scene, method, steps.mesh(scene.break_points)).damping
    if damping is None:  # pragma: no cover - there are forces
        return None
    with np.errstate(all="ignore"):
        return damping_along(damping, steps.velocity, steps.step_size)[0]
