"""Scenes to trajectories: the one function in which scene and method meet, for one or many."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.matrices import Form, dense
from fvi_cli.effects.potential import ExpressionPotential, SuppliedPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.baselines import integrate_baseline
from fvi_cli.integrator.decoupling import linear_decoupling
from fvi_cli.integrator.failure import no_unique_solution
from fvi_cli.integrator.material import material_response
from fvi_cli.integrator.memory.damping import damping_of, law_objection, pattern_of
from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.graded import start_power
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import AnyMethod, Baseline, Method, as_method
from fvi_cli.integrator.observe.dampers import damper_values
from fvi_cli.integrator.observe.impacts import integrate_with_impacts
from fvi_cli.integrator.observe.observer import Impacted, observe_runs
from fvi_cli.integrator.observe.request import (
    Event,
    Observations,
    check_observable,
    names_of,
    observations,
)
from fvi_cli.integrator.run.on_mesh import AnySteps, integrate_scenes, mesh_for
from fvi_cli.integrator.trajectory import Trajectory, thinned
from fvi_cli.mathematics.threads import in_one_thread

LARGEST_STEP = 24
"""Most unknowns of a step of a member: larger matrix products are quicker one by one."""
FEWEST = 4
"""Fewest scenes of a batch. Four pendulums take .5 to 1.5 of the time that they take alone, which
is least for thousands of steps without damping; 16 take .1 to .5."""
MOST_TOGETHER = 512
"""Most members that are stepped together: more would not stay in the cache."""


def integrate(
    scene: Scene,
    method: AnyMethod | str,
    steps: AnySteps,
    *,
    every: int = 1,
    diagnostics: bool = False,
    with_steps: bool = False,
    output: ArrayLike | None = None,
    quantities: Mapping[str, str | float] | None = None,
    events: Mapping[str, str | Event | Mapping[str, object]] | None = None,
    impacts: Mapping[str, Mapping[str, object]] | None = None,
    coordinates: Sequence[str] | None = None,
    parameters: Mapping[str, float] | None = None,
) -> Trajectory:
    """Integrate a scene over [0, T].

    Parameters
    ----------
    scene
        Effects and initial data; absent effects are not computed.
    method
        A method, or its name (:func:`fvi_cli.method_named`): ``gauss3``, ``bdf2-nodes``.
        With a mesh or adaptive steps the name of a Gauss method means the one with ``start: none``.
    steps
        N >= 1 for N equal steps; for Runge-Kutta methods also a :class:`Mesh`
        (:func:`uniform_mesh`, :func:`graded_mesh`, :func:`mesh_of`), or :class:`AdaptiveSteps`,
        which are chosen during the run.
    every
        Keep every n-th point of the grid, the first and the last.
    diagnostics
        Compute works, stored energy and energy balance too; they do not change the trajectory.
    with_steps
        Keep the polynomials of the steps, for ``trajectory(t)`` and ``trajectory.velocity(t)``;
        for Runge-Kutta methods.
    output
        Times at which the motion is reported; the points of the mesh by default.
    quantities
        Expressions by name, in coordinates, ``v<name>``, ``a<name>``, ``d<name>`` (the damping
        force on the coordinate) and t; their values at the reported times are
        ``trajectory.observed.quantities``, their peaks etc. ``trajectory.observed.extents``.
    events
        Such expressions, or ``{"when": ..., "direction": ..., "stop": ...}``, by name; the times
        at which they change sign are ``trajectory.observed.events``.
    impacts
        ``{"when": ..., "restitution": ...}`` by name: where the expression ``when`` in coordinates
        and t falls to 0, the velocity along its gradient is reversed and scaled.
    coordinates, parameters
        Names in these expressions: by default ``x``, or ``x1``, ``x2``, ..., or the coordinates of
        the Lagrangian; and values of further names.

    Returns
    -------
    Trajectory
        With its status: ``ok``, or ``failed`` (equations unsolved, or numbers that are not finite);
        finished steps are kept, and no exception is raised.

    Raises
    ------
    ValueError
        For numbers out of range, unknown names, and what the method does not support.
    """
    if not isinstance(scene, Scene):
        raise TypeError(
            f"integrate: scene: {type(scene).__name__} is no scene; write one such as "
            "fvi.duffing(final_time=10.0); a configuration is computed by fvi.run"
        )
    names = tuple(coordinates or names_of(scene))
    request = Observations(coordinates=names)
    if not (output is None and quantities is events is impacts is None):
        request = observations(
            names,
            output=output,
            quantities=quantities,
            events=events,
            impacts=impacts,
            parameters=parameters,
            further=tuple(damper_values(scene)),
        )
    (found,) = integrate_members(
        [scene],
        method_on(method, steps),
        steps,
        observe=[request],
        every=every,
        diagnostics=diagnostics,
        with_steps=with_steps,
    )
    if scene.forcing is None:
        return found
    longest = 0.0 if isinstance(steps, AdaptiveSteps) else found.step_size
    longest = float(steps.sizes.max()) if isinstance(steps, Mesh) else longest
    remarks = scene.forcing.remarks(scene.final_time, longest)
    return replace(found, remarks=(*found.remarks, *remarks)) if remarks else found


@in_one_thread
def integrate_members(
    scenes: Sequence[Scene],
    method: AnyMethod | str,
    steps: AnySteps | Sequence[AnySteps],
    *,
    observe: Sequence[Observations] = (),
    every: int = 1,
    diagnostics: bool = False,
    with_steps: bool = False,
) -> list[Trajectory]:
    """Integrate every scene by one method, those of one kind (:func:`batch_kind`) as one batch.

    Arguments are those of :func:`integrate`, the same for all; `steps` may be one for each scene,
    and so are the requested outputs `observe`, which have the same formulas. Scenes with impacts or
    diagnostics are integrated individually. Returns one trajectory per scene, in order, with its
    own status: the result of :func:`integrate` to round-off. Run times are equal shares of those of
    the batch.

    Raises
    ------
    ValueError
        As :func:`integrate` does, for the first scene that is not allowed.
    """
    method = as_method(method)
    each = list(steps) if isinstance(steps, Sequence) else [steps] * len(scenes)
    requests = observe or [Observations()] * len(scenes)
    is_observed = any(not one.is_empty for one in requests)
    if is_observed:
        check_observable(method)
    for one in each:
        _check_counts(1 if isinstance(one, Mesh | AdaptiveSteps) else one, every)
    found: dict[int, Trajectory] = {}
    impacted: dict[int, Impacted] = {}
    is_individual = diagnostics or any(one.impacts for one in requests)
    groups = [[k] for k in range(len(scenes))]
    are_alike = len({id(one) if isinstance(one, Mesh) else one for one in each}) == 1
    if are_alike and not is_individual and isinstance(method, Method):
        groups = group(scenes, method, each[0])
    for places in groups:
        first, own = places[0], [scenes[k] for k in places]
        keeps = with_steps or is_observed
        if (
            len(places) > 1
            and isinstance(method, Method)
            and not isinstance(each[0], AdaptiveSteps)
        ):
            runs = integrate_batch(own, method, each[0], every=every, with_steps=keeps)
            found.update(zip(places, runs, strict=True))
        elif requests[first].impacts and isinstance(method, Method):
            n_steps = each[first]
            if isinstance(n_steps, Mesh | AdaptiveSteps):
                raise ValueError("impacts: steps are cut where these are; give a number of steps")
            run, impacted[first] = integrate_with_impacts(
                own[0], method, n_steps, requests[first], diagnostics=diagnostics
            )
            found[first] = thinned(run, every)
        else:
            found[first] = _integrate(own[0], method, each[first], every, diagnostics, keeps)
    runs = [found[k] for k in range(len(scenes))]
    if is_observed:
        runs = observe_runs(scenes, method, runs, requests, impacted)
    return [
        replace(run, coordinates=one.coordinates, steps=run.steps if with_steps else None)
        for run, one in zip(runs, requests, strict=True)
    ]


def _integrate(
    scene: Scene,
    method: AnyMethod,
    steps: AnySteps,
    every: int,
    diagnostics: bool,
    with_steps: bool,
) -> Trajectory:
    """The run of one scene without impacts."""
    if scene.prescribed is not None:
        if diagnostics:
            raise ValueError("diagnostics: the motion is given; it has no energy and no momentum")
        return material_response(scene, method, steps, every=every, with_steps=with_steps)
    if reason := law_objection(scene, method):
        raise ValueError(f"method: {reason}")
    is_number = not isinstance(steps, Mesh | AdaptiveSteps)
    if isinstance(method, Baseline) or not method.is_runge_kutta:
        if not is_number:
            raise ValueError(
                f"mesh: {method.label} takes equal steps only; give a number, "
                "or take rk: gauss with start: none"
            )
        if with_steps:
            raise ValueError(
                f"with_steps: {method.label} has no polynomials to keep; "
                "take rk: gauss, such as gauss3"
            )
    if isinstance(method, Method):
        (found,) = integrate_scenes(
            [scene],
            method,
            steps if isinstance(steps, AdaptiveSteps) else mesh_for(scene, method, steps),
            every=every,
            diagnostics=diagnostics,
            with_steps=with_steps,
        )
        return found
    if diagnostics:
        raise ValueError(f"diagnostics: {method.label} keeps no increments of its steps")
    assert not isinstance(steps, Mesh | AdaptiveSteps)
    try:
        return thinned(integrate_baseline(scene, method, steps), every)
    except np.linalg.LinAlgError:
        # singular equations, as with negative stiffness: the start only
        position, velocity = scene.initial_position[None], scene.initial_velocity[None]
        momentum = scene.momentum(position, velocity, np.zeros(1))
        return Trajectory(
            time=np.zeros(1),
            position=position,
            momentum=momentum,
            energy=scene.energy(position, momentum, np.zeros(1)),
            n_steps=steps,
            step_size=scene.final_time / steps,
            status="failed",
            message=str(no_unique_solution(scene.final_time / steps)),
        )


def method_on(method: AnyMethod | str, steps: AnySteps) -> AnyMethod:
    """A method, also by name; on a mesh the name of a Gauss method means ``start: none``."""
    chosen = as_method(method)
    is_default = isinstance(method, str) and "graded" not in method.lower()
    if not (is_default and isinstance(steps, Mesh | AdaptiveSteps)):
        return chosen
    if isinstance(chosen, Method) and chosen.start == "graded":
        return replace(chosen, start="none")
    return chosen


def _check_counts(n_steps: object, every: object) -> None:
    """Refuse numbers of steps and of points that are no positive integers."""
    for name, value in (("n_steps", n_steps), ("every", every)):
        if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < 1:
            others = ", a Mesh or AdaptiveSteps" if name == "n_steps" else ""
            raise ValueError(
                f"{name}: {value!r} is not allowed; it must be an integer >= 1{others}"
            )


# batches


def integrate_batch(
    scenes: Sequence[Scene],
    method: Method,
    steps: int | Mesh,
    *,
    every: int = 1,
    with_steps: bool = False,
) -> list[Trajectory]:
    """Integrate scenes of one kind, as many at a time as stay in the cache."""
    mesh, width = mesh_for(scenes[0], method, steps), _width(scenes[0])
    found: list[Trajectory] = []
    together = max(1, MOST_TOGETHER // width)
    for first in range(0, len(scenes), together):
        part = scenes[first : first + together]
        found += integrate_scenes(part, method, mesh, every=every, with_steps=with_steps)
    return found


def group(scenes: Sequence[Scene], method: Method, steps: AnySteps) -> list[list[int]]:
    """Places of the scenes that are integrated together; a single place for individual scenes."""
    alone = [[place] for place in range(len(scenes))]
    if len(scenes) == 1 or isinstance(steps, AdaptiveSteps):
        return alone
    kinds: dict[Hashable, list[int]] = {}
    for place, scene in enumerate(scenes):
        kind = batch_kind(scene, method, steps)
        kinds.setdefault(("alone", place) if kind is None else kind, []).append(place)
    found: list[list[int]] = []
    for places in kinds.values():
        found += [places] if len(places) >= FEWEST else [alone[place] for place in places]
    return found


def batch_kind(scene: Scene, method: Method, steps: int | Mesh) -> Hashable | None:
    """A key, equal for scenes of one batch; None: the scene is integrated individually."""
    if scene.is_sparse or scene.prescribed is not None:
        return None
    memory: Hashable = any(term.order != 1 for term in scene.active_damping)
    if not method.is_runge_kutta:
        is_corrected = method.start == "weights" and scene.active_damping
        if scene.active_laws or is_corrected:
            return None
        memory = tuple(term.order for term in scene.active_damping)
    elif scene.active_laws:
        # laws have rates of their own
        mesh = mesh_for(scene, method, steps)
        shortest, equivalent = mesh.shortest_step, mesh.equivalent_steps
        damping = damping_of([scene], method, shortest_step=shortest, steps=equivalent)
        if damping is not None and isinstance(damping.memory, Exponentials):
            memory = damping.memory.kernel.rates.tobytes()
    width = _width(scene)
    if method.degree * (scene.dimension // width) > LARGEST_STEP:
        return None
    powers = None
    if method.start == "graded":
        powers = tuple(start_power(scene, at_start=at_start) for at_start in (True, False))
    return (
        *(scene.dimension, width, scene.final_time, scene.break_points, scene.derivative),
        *(_formulas_of(scene.lagrangian or scene.potential), powers, memory),
        pattern_of(scene),
    )


def _formulas_of(energy: object) -> Hashable:
    """The formulas, or functions, of a nonlinear scene; None for linear ones."""
    if isinstance(energy, SuppliedPotential):
        return (id(energy.functions), _entries(energy.stiffness))
    if isinstance(energy, ExpressionPotential):
        formulas = energy.gradient_system, energy.hessian_system
    elif isinstance(energy, Lagrangian):
        formulas = energy.first, energy.second
    else:
        return None
    return (
        energy.coordinates,
        tuple(sorted(energy.parameters)),
        formulas,
        _entries(energy.stiffness),
    )


def _entries(stiffness: Form | None) -> bytes | None:
    return None if stiffness is None else dense(stiffness).tobytes()


def _width(scene: Scene) -> int:
    """Number of independent systems that make a scene."""
    found = linear_decoupling(scene) if scene.dimension > 1 else None
    return 1 if found is None else found.batch
