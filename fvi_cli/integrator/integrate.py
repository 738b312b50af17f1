"""Scenes to trajectories: the one function in which scene and method meet, for one or many."""

from __future__ import annotations

import time as clock
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.potential import ExpressionPotential, SuppliedPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.baselines import integrate_baseline
from fvi_cli.integrator.decoupling import linear_decoupling
from fvi_cli.integrator.material import material_response
from fvi_cli.integrator.memory.damping import damping_of, law_objection, pattern_of
from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.graded import start_power
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import AnyMethod, Baseline, Method, as_method
from fvi_cli.integrator.observe.dampers import damper_values
from fvi_cli.integrator.observe.impacts import integrate_with_impacts
from fvi_cli.integrator.observe.observer import observe_runs
from fvi_cli.integrator.observe.request import (
    Observations,
    check_observable,
    names_of,
    observations,
)
from fvi_cli.integrator.run.on_mesh import AnySteps, Kept, integrate_scenes, mesh_for
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.threads import in_one_thread

LARGEST_STEP = 24
"""Most unknowns of a step of a member: larger matrix products are quicker one by one."""
MOST_TOGETHER = 512
"""Most members that are stepped together: more would not stay in the cache."""


def integrate(
    scene: Scene,
    method: AnyMethod | str,
    steps: AnySteps,
    *,
    diagnostics: bool = False,
    with_steps: bool = False,
    output: ArrayLike | None = None,
    quantities: Mapping[str, str | float] | None = None,
    events: Mapping[str, str | Mapping[str, object]] | None = None,
    impacts: Mapping[str, Mapping[str, object]] | None = None,
) -> Trajectory:
    """Integrate a scene over [0, T].

    Parameters
    ----------
    scene
        Effects and initial data; absent effects are not computed.
    method
        A method, or its name (:func:`fvi_cli.method_named`): ``gauss3``, ``bdf2-nodes``.
    steps
        N >= 1 for N equal steps; for Runge-Kutta methods also a :class:`Mesh`
        (:func:`uniform_mesh`, :func:`graded_mesh`, :func:`mesh_of`), or :class:`AdaptiveSteps`,
        which are chosen during the run.
    diagnostics
        Compute works, stored energy and energy balance too; they do not change the trajectory.
    with_steps
        Keep the polynomials of the steps, for ``trajectory(t)`` and ``trajectory.velocity(t)``;
        for Runge-Kutta methods.
    output
        Times at which the motion is reported; the points of the mesh by default.
    quantities
        Expressions by name, in coordinates (those of the scene; or ``x``, or ``x1``, ``x2``, ...),
        ``v<name>``, ``a<name>``, ``d<name>`` (the damping
        force on the coordinate) and t; their values at the reported times are
        ``trajectory.observed.quantities``, their peaks etc. ``trajectory.observed.extents``.
    events
        Such expressions, or ``{"when": ..., "direction": ..., "stop": ...}``, by name; the times
        at which they change sign are ``trajectory.observed.events``.
    impacts
        ``{"when": ..., "restitution": ...}`` by name: where the expression ``when`` in coordinates
        and t falls to 0, the velocity along its gradient is reversed and scaled.

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
    names = names_of(scene)
    request = Observations(coordinates=names)
    if not (output is None and quantities is events is impacts is None):
        request = observations(
            names,
            output=output,
            quantities=quantities,
            events=events,
            impacts=impacts,
            further=tuple(damper_values(scene)),
        )
    (found,) = integrate_members(
        [scene],
        method,
        steps,
        observe=[request],
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
    diagnostics: bool = False,
    with_steps: bool = False,
) -> list[Trajectory]:
    """Integrate every scene by one method, those of one kind (:func:`batch_kind`) as one batch.

    Arguments are those of :func:`integrate`, the same for all; `steps` may be one for each scene,
    and so are the requested outputs `observe`, which have the same formulas. Scenes with impacts
    are integrated individually. Returns one trajectory per scene, in order, with its own status:
    the result of :func:`integrate` to round-off. Run times are equal shares of those of the batch.

    Raises
    ------
    ValueError
        As :func:`integrate` does, for the first scene that is not allowed.
    """
    method = as_method(method)
    each = list(steps) if isinstance(steps, Sequence) else [steps] * len(scenes)
    requests = list(observe) or [Observations()] * len(scenes)
    is_observed = any(not one.is_empty for one in requests)
    if with_steps or is_observed:
        check_observable(method)
    for value in each:
        if isinstance(value, Mesh | AdaptiveSteps):
            continue
        if not isinstance(value, int | np.integer) or value < 1:
            raise ValueError(f"n_steps: {value!r} is not allowed; it must be an integer >= 1")
    kinds: dict[Hashable, list[int]] = {}
    for place, (scene, own, request) in enumerate(zip(scenes, each, requests, strict=True)):
        kind = None
        if len(scenes) > 1 and isinstance(method, Method) and not request.impacts:
            kind = batch_kind(scene, method, own)
        kinds.setdefault(("alone", place) if kind is None else kind, []).append(place)
    found: dict[int, Trajectory] = {}
    for places in kinds.values():
        together = 1
        if len(places) > 1:
            together = max(1, MOST_TOGETHER // _width(scenes[places[0]]))
        for first in range(0, len(places), together):
            part = places[first : first + together]
            members, asked = [scenes[k] for k in part], [requests[k] for k in part]
            began = clock.perf_counter()
            runs = _integrated(
                members,
                method,
                each[part[0]],
                asked[0],
                Kept(diagnostics, with_steps or is_observed),
            )
            seconds = (clock.perf_counter() - began) / len(part)
            runs = [replace(run, seconds=seconds) for run in runs]
            if is_observed:
                runs = observe_runs(members, method, runs, asked)
            found.update(zip(part, runs, strict=True))
    return [
        replace(
            found[place],
            coordinates=request.coordinates,
            steps=found[place].steps if with_steps else None,
        )
        for place, request in enumerate(requests)
    ]


def _integrated(
    scenes: Sequence[Scene],
    method: AnyMethod,
    steps: AnySteps,
    request: Observations,
    kept: Kept,
) -> list[Trajectory]:
    """The runs of one scene, or of a batch."""
    first = scenes[0]
    if first.prescribed is not None:
        if kept.diagnostics:
            raise ValueError("diagnostics: the motion is given; it has no energy and no momentum")
        return [material_response(first, method, steps, with_steps=kept.with_steps)]
    if reason := law_objection(first, method):
        raise ValueError(f"method: {reason}")
    if isinstance(method, Baseline):
        if isinstance(steps, Mesh | AdaptiveSteps) or kept.diagnostics:
            raise ValueError(
                f"method: {method.label} has points on equal steps only, without works; give a "
                "number, or take rk: gauss"
            )
        return [integrate_baseline(first, method, steps)]
    if request.impacts:
        if isinstance(steps, Mesh | AdaptiveSteps):
            raise ValueError("impacts: steps are cut where these are; give a number of steps")
        return [integrate_with_impacts(first, method, steps, request, kept)]
    chosen = steps if isinstance(steps, AdaptiveSteps) else mesh_for(first, method, steps)
    return integrate_scenes(scenes, method, chosen, kept)


# batches


def batch_kind(scene: Scene, method: Method, steps: AnySteps) -> Hashable | None:
    """A key, equal for scenes of one batch; None: the scene is integrated individually."""
    if scene.is_sparse or scene.prescribed is not None or isinstance(steps, AdaptiveSteps):
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
    if method.start == "graded" and not isinstance(steps, Mesh):
        powers = tuple(start_power(scene, at_start=at_start) for at_start in (True, False))
    return (
        id(steps) if isinstance(steps, Mesh) else steps,
        *(scene.dimension, width, scene.final_time, scene.break_points, scene.derivative),
        *(_formulas_of(scene.lagrangian or scene.potential), powers, memory),
        pattern_of(scene),
    )


def _formulas_of(energy: object) -> Hashable:
    """The formulas, or functions, of a nonlinear scene; None for linear ones."""
    if isinstance(energy, SuppliedPotential):
        stiffness = energy.stiffness
        return id(energy.functions), None if stiffness is None else dense(stiffness).tobytes()
    if isinstance(energy, ExpressionPotential):
        formulas = energy.gradient_system, energy.derivatives_system
    elif isinstance(energy, Lagrangian):
        formulas = energy.first, energy.second
    else:
        return None
    return energy.coordinates, tuple(sorted(energy.parameters)), formulas


def _width(scene: Scene) -> int:
    """Number of independent systems that make a scene."""
    return 1 if linear_decoupling(scene) is None else scene.dimension
