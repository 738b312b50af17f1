"""The one function in which scene and method meet."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.baselines import integrate_baseline
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.continuation import UNKNOWN, asks_for_paths, paths_of
from fvi_cli.integrator.diagnostics import NOTHING, Asked, diagnose
from fvi_cli.integrator.engine import run
from fvi_cli.integrator.growth_bound import cut_at_bound, growth_bound
from fvi_cli.integrator.known_part import (
    NO_SERIES,
    KnownPart,
    KnownTable,
    SeriesPlan,
    method_order,
    plan_series,
    settled_method,
    window_rule,
)
from fvi_cli.integrator.memory import ChannelSource, build_memory
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import AnyMethod, Baseline, Method, takes_any_mesh
from fvi_cli.integrator.moments import (
    StepFunction,
    exact_moments,
    galerkin_moments,
    projected_moments,
)
from fvi_cli.integrator.motion import Motion
from fvi_cli.integrator.run.loop import no_unique_solution
from fvi_cli.integrator.run.objections import check_laws
from fvi_cli.integrator.run.runge_kutta import AnySteps, integrate_runge_kutta
from fvi_cli.integrator.run.unfinished import RunKeeper
from fvi_cli.integrator.step_increments import run_with_increments
from fvi_cli.integrator.step_tables import StepTables, step_tables
from fvi_cli.integrator.stepping import Stepped, StepProblem
from fvi_cli.integrator.trajectory import Trajectory, thinned

Array = NDArray[np.float64]

LONGEST_PILOT = 2**20
"""Steps to the last break point beyond which nothing is found out about the motion there."""


def integrate(
    scene: Scene,
    method: AnyMethod,
    n_steps: AnySteps,
    *,
    every: int = 1,
    diagnostics: Asked = NOTHING,
    with_steps: bool = False,
    checkpoints: RunKeeper | None = None,
) -> Trajectory:
    """Integrate `scene` over [0, T] by `method` in `n_steps` steps.

    Parameters
    ----------
    scene
        Effects and initial data; what is absent is not simulated.
    method
        Method or baseline.
    n_steps
        Number N >= 1 of steps, h = T / N; for Runge-Kutta methods also a mesh or `AdaptiveSteps`.
    every
        Keep every n-th point of the grid, the first and the last.
    diagnostics
        What else is computed; it does not change the trajectory.
    with_steps
        Keep the steps of a Runge-Kutta method as polynomials, for values at any time.
    checkpoints
        Where a run keeps a checkpoint, and goes on from one, if its method takes any mesh.

    Returns
    -------
    Trajectory
        With status ``ok``, ``diverged`` (it left the bound of what the scene can do, or numbers
        ceased to be finite) or ``failed`` (equations unsolved); it keeps what was finished.

    Raises
    ------
    ValueError
        If N or `every` is no positive integer, a break point lies between two steps of a method of
        equal ones, or it is not made for a general Lagrangian, laws, or diagnostics.
    """
    is_given = isinstance(n_steps, Mesh | AdaptiveSteps)
    check_counts(1 if is_given else n_steps, every)
    steps = n_steps if isinstance(n_steps, Mesh | AdaptiveSteps) else int(n_steps)
    if isinstance(method, Method) and takes_any_mesh(method):
        return integrate_runge_kutta(
            scene,
            method,
            steps,
            every=every,
            diagnostics=diagnostics,
            with_steps=with_steps,
            checkpoints=checkpoints,
        )
    check_laws(scene, method)
    if not isinstance(steps, int):
        raise ValueError(
            f"mesh: {method.case} takes equal steps only; give a number, or take a Gauss method "
            "with start: none"
        )
    if with_steps:
        raise ValueError(
            f"with_steps: {method.case} keeps no polynomials; take a Gauss method with start: "
            "graded or none, such as gauss3-graded"
        )
    if not diagnostics.is_empty and not can_be_diagnosed(method):
        raise ValueError(f"diagnostics: {method.case} keeps no increments of its steps")
    try:
        return thinned(_integrate(scene, method, steps, diagnostics), every)
    except np.linalg.LinAlgError:
        return _without_steps(scene, steps)


def _without_steps(scene: Scene, n_steps: int) -> Trajectory:
    """The start of a motion whose steps have singular equations, as with negative stiffness."""
    h = scene.final_time / n_steps
    position, momentum, energy = scene.initial_position[None], None, None
    if scene.lagrangian is None:
        momentum = (scene.inertia.mass @ scene.initial_velocity)[None]
        energy = scene.energy(position, momentum)
    return Trajectory(
        time=np.zeros(1),
        position=position,
        momentum=momentum,
        energy=energy,
        n_steps=n_steps,
        step_size=h,
        status="failed",
        message=no_unique_solution(h),
    )


def check_counts(n_steps: object, every: object) -> None:
    """Refuse numbers of steps and of points that are no positive integers.

    Raises
    ------
    ValueError
        With the number and what is allowed.
    """
    for name, value in (("n_steps", n_steps), ("every", every)):
        if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < 1:
            others = ", a Mesh or AdaptiveSteps" if name == "n_steps" else ""
            raise ValueError(
                f"{name}: {value!r} is not allowed; it must be an integer >= 1{others}"
            )


def can_be_diagnosed(method: AnyMethod) -> bool:
    """Whether a method keeps what diagnostics are made of, the increments of its steps."""
    return isinstance(method, Method)


def _integrate(scene: Scene, method: AnyMethod, n_steps: int, asked: Asked) -> Trajectory:
    """The whole trajectory by a history that needs all samples."""
    if scene.lagrangian is not None:
        from fvi_cli.integrator.general import integrate_general

        return integrate_general(scene, method, n_steps, asked)
    if isinstance(method, Baseline):
        return integrate_baseline(scene, method, n_steps)
    began = time.perf_counter()
    prepared = prepare(scene, method, n_steps)
    if method.start == "weights" and scene.active_damping:
        from fvi_cli.integrator.starting_weights import correct_start

        corrected, remarks = correct_start(prepared.problem, method, scene)
        prepared = replace(prepared, problem=corrected, remarks=remarks)
    bound = growth_bound(prepared.problem)
    farthest = float(bound.at(np.asarray(scene.final_time)))
    prepared = replace(prepared, problem=replace(prepared.problem, stop_beyond=farthest))
    ready = time.perf_counter()
    if asked.is_empty:
        stepped = run(prepared.problem, method.history)
    else:
        stepped = run_with_increments(prepared.problem, method)
    stepped = cut_at_bound(prepared.problem, stepped, bound)
    finished = time.perf_counter()
    trajectory = finished_trajectory(
        method, prepared, stepped, setup=ready - began, stepping=finished - ready
    )
    if asked.is_empty or trajectory.momentum is None or trajectory.energy is None:
        return trajectory
    problem = prepared.problem
    motion = Motion(
        scene=scene,
        method=method,
        tables=problem.tables,
        memory=problem.memory,
        step_size=problem.step_size,
        stepped=stepped,
        moments=problem.moments,
        forcing_moments=prepared.forcing_moments,
        known=prepared.known,
        jump=prepared.jump,
        position=trajectory.position,
        momentum=trajectory.momentum,
        energy=trajectory.energy,
    )
    with np.errstate(over="ignore", invalid="ignore"):
        return replace(trajectory, diagnostics=diagnose(motion, asked))


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """What is ready before the first step: the step problem, the known part, and remarks.

    Beside a known part there are no `forcing_moments`; `jump` is the force of :func:`jump_force`
    where the known part does not hold it; `table` holds values of the known part that were made
    beforehand.
    """

    problem: StepProblem
    known: KnownPart | None
    remarks: tuple[str, ...]
    forcing_moments: Array | None = None
    jump: StepFunction | None = None
    table: KnownTable | None = None


def series_of(scene: Scene, method: Method, n_steps: int) -> SeriesPlan:
    """The series of a run, with the paths of a nonlinear motion at its break points.

    These come of a run up to the last of them that does without.
    """
    if method.start != "series":
        return NO_SERIES
    rule = window_rule(method)
    if rule is None or not asks_for_paths(scene):
        return plan_series(scene, method, n_steps)
    last = steps_at_break_points(scene, n_steps)[-1]
    if last > LONGEST_PILOT:
        return plan_series(scene, method, n_steps, paths=UNKNOWN)
    shorter = replace(scene, final_time=scene.break_points[-1])
    quick = replace(method, history="auto")
    prepared = prepare(
        shorter, quick, last, series=plan_series(shorter, quick, last, paths=UNKNOWN)
    )
    stepped = run(prepared.problem, "auto")
    pilot = finished_trajectory(quick, prepared, stepped, setup=0.0, stepping=0.0)
    paths = paths_of(scene, pilot, n_steps, method_order(method) + rule.powers)
    return plan_series(scene, method, n_steps, paths=paths)


def prepare(
    scene: Scene,
    method: Method,
    n_steps: int,
    source: ChannelSource | None = None,
    series: SeriesPlan | None = None,
    table: KnownTable | None = None,
) -> Prepared:
    """Everything that is known before the first step.

    `source` as for `build_memory`; `series` and the `table` of its values are made here where they
    are not given.
    """
    tables = step_tables(method)
    h = scene.final_time / n_steps
    breaks = steps_at_break_points(scene, n_steps)
    if series is None:
        series = series_of(scene, method, n_steps)
    known = series.known
    method = settled_method(scene, method, series)
    from_rest = known is not None and known.carries_start
    memory = build_memory(
        scene, method, tables, n_steps, scene.active_damping, from_rest=from_rest, source=source
    )
    moments = None
    if table is not None:
        moments = table.moments
    elif known is not None:
        # smooth by construction: the action's own rule is exact enough
        moments = galerkin_moments(known.residual(), tables, h, n_steps)
    elif scene.forcing is not None:
        moments = force_moments(scene.forcing.on_steps, method, tables, h, n_steps, (0, *breaks))
    of_forcing = None if known is not None else moments
    jump = None if from_rest or method.sampling == "nodes" else jump_force(scene)
    if jump is not None:
        # singular at 0: always by exact moments
        added = exact_moments(jump, method, h, n_steps)
        moments = added if moments is None else moments + added
    shift = None
    if table is not None and scene.potential is not None:
        shift = table.position
    elif known is not None and scene.potential is not None:
        shift = known.position(h * np.arange(n_steps, dtype=float), h, tables.points)
    rest = np.zeros(scene.dimension)
    problem = StepProblem(
        scene=scene,
        tables=tables,
        memory=memory,
        step_size=h,
        n_steps=n_steps,
        position=rest if from_rest else scene.initial_position,
        momentum=rest if from_rest else scene.inertia.mass @ scene.initial_velocity,
        moments=moments,
        position_shift=shift,
        skip_first_kick=method.sampling == "nodes",
    )
    return Prepared(
        problem=problem,
        known=known,
        remarks=series.remarks,
        forcing_moments=of_forcing,
        jump=jump,
        table=table,
    )


def force_moments(
    force: StepFunction,
    method: Method,
    tables: StepTables,
    h: float,
    n_steps: int,
    singular_steps: tuple[int, ...],
) -> Array:
    """Moments of a known force as the method's ``forcing_quadrature`` asks for them."""
    if method.forcing_quadrature == "galerkin":
        return galerkin_moments(force, tables, h, n_steps)
    exact = exact_moments(force, method, h, n_steps, singular_steps)
    if method.forcing_quadrature == "exact":
        return exact
    return projected_moments(exact, method, tables)


def jump_force(scene: Scene) -> StepFunction | None:
    r"""What Riemann-Liouville adds to Caputo: :math:`-\mu q_0 t^{-\gamma} / \Gamma(1 - \gamma)`."""
    terms = [term for term in scene.active_damping if term.order < 1]
    if scene.derivative == "caputo" or not terms or not np.any(scene.initial_position != 0):
        return None
    from scipy.special import rgamma

    def force(start: Array, h: float, offsets: Array) -> Array:
        time_values = start[:, None] + h * offsets
        total = np.zeros((*time_values.shape, scene.dimension))
        for term in terms:
            shape = -rgamma(1 - term.order) * time_values ** (-term.order)
            total += shape[..., None] * (scene.initial_position @ term.coefficient)
        return total

    return force


def finished_trajectory(
    method: Method, prepared: Prepared, stepped: Stepped, *, setup: float, stepping: float
) -> Trajectory:
    """What the steps gave, with the known part of the solution added."""
    problem, known = prepared.problem, prepared.known
    scene = problem.scene
    momentum = stepped.momentum
    if method.sampling == "nodes" and problem.memory.channels:
        # p_k of the scheme is the one before the kick, of order 1 only; half the kick mends that
        momentum = momentum.copy()
        momentum[1:] -= 0.5 * problem.step_size * stepped.end_force[1:, 0]
    position = stepped.position
    grid = problem.step_size * np.arange(position.shape[0], dtype=float)
    if known is not None:
        known_position, known_velocity = (
            known.on_grid(grid)
            if prepared.table is None
            else (values[: grid.size] for values in prepared.table.on_grid)
        )
        position = position + known_position
        momentum = momentum + known_velocity @ scene.inertia.mass
    with np.errstate(over="ignore", invalid="ignore"):
        energy = scene.energy(position, momentum)
    diverged = stepped.failure.startswith("diverged") or not np.isfinite(position).all()
    status = "ok" if not stepped.failure else ("diverged" if diverged else "failed")
    trajectory = Trajectory(
        time=grid,
        position=position,
        momentum=momentum,
        energy=energy,
        n_steps=problem.n_steps,
        step_size=problem.step_size,
        message=stepped.failure,
        history_operations=stepped.operations,
        newton=stepped.newton,
        setup_seconds=setup,
        stepping_seconds=stepping,
        remarks=prepared.remarks,
    )
    if status == "failed":
        return replace(trajectory, status="failed")
    return replace(trajectory, status="diverged") if status == "diverged" else trajectory
