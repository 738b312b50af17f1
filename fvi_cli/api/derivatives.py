"""Derivatives of results of runs, for programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.gradients.gradient import gradient_of
from fvi_cli.integrator.gradients.parameters import (
    Described,
    Entry,
    Parameter,
    entries_of,
    parameter_of,
)
from fvi_cli.integrator.gradients.quantity import Quantity
from fvi_cli.integrator.integrate import method_on
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.request import Observations, known_names, names_of
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.keys.complaints import excerpt
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import FUNCTION_NAMES
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment

Subject = Scene | Problem | Experiment


@dataclass(frozen=True, kw_only=True, eq=False)
class Gradient:
    r"""A number of a trajectory, and its derivatives.

    Parameters
    ----------
    value
        The number.
    derivatives
        For every parameter an array G of the shape of its value, such that the number changes by
        :math:`\sum G\, d\theta`.
    left_out
        Where all parameters were requested, those without a derivative, and why.
    n_steps, step_solves
        Number of steps of the run, and number of linear systems of a step that were solved for the
        derivatives (not for the run): one for every step, for any number of parameters.
    """

    value: float
    derivatives: Mapping[str, Array]
    left_out: Mapping[str, str]
    n_steps: int
    step_solves: int

    def __getitem__(self, name: str) -> Array:
        """The derivative by one parameter."""
        if name in self.left_out:
            raise ArgumentError(name, f"left out, without a derivative: {self.left_out[name]}")
        return self.derivatives[name]


def gradient(
    scene: Subject | Callable[..., Subject],
    method: Method | str,
    steps: AnySteps,
    quantity: Quantity,
    parameters: Sequence[str] | Mapping[str, float] | None = None,
) -> Gradient:
    """Derivatives of one number of a run, by the adjoint of its discrete equations.

    They are derivatives of the computed number on the mesh of the run (the mesh of an adaptive run
    is fixed), accurate to about ten digits, and cost one run and one backward sweep.

    Parameters
    ----------
    scene
        A :class:`fvi_cli.Scene`, a :class:`fvi_cli.Problem`, or an :class:`fvi_cli.Experiment` with
        its ``quantities``; or a function that makes one of these from the parameters, which are
        its keyword arguments.
    method
        A Runge-Kutta method that takes any mesh, or the name of one.
    steps
        As for :func:`fvi_cli.integrate`.
    quantity
        The number to differentiate: :func:`fvi_cli.position_at`, :func:`fvi_cli.velocity_at`,
        :func:`fvi_cli.acceleration_at`, :func:`fvi_cli.quantity_at` for an expression or a quantity
        of the experiment, or :func:`fvi_cli.misfit`. Expressions may contain the parameters.
    parameters
        For a scene names of its numbers: ``mass``, ``stiffness``, ``damping.0.order``,
        ``damping.0.coefficient``, ``initial_position``, ``initial_velocity``,
        ``potential.<parameter>``, ``lagrangian.<parameter>``, ``forcing.<parameter>``,
        ``laws.0.order`` and similar; None: all that have a derivative; `left_out` names the others.
        For a function its arguments with their values: they may change numbers with names, no
        numbers inside the text of formulas.

    Raises
    ------
    ValueError
        For names that do not exist, a number that accumulates over the run (the work on a damper),
        a motion with impacts, a method without polynomials, and a run that does not reach its end.

    Notes
    -----
    A Caputo derivative of order above 1 subtracts the start velocity, a derivative of order 1 or
    less does not. So with a start velocity the motion jumps where an order passes 1; the derivative
    is then one-sided, from the side of the value (at 1 from below). At a break point of a force the
    acceleration before it is taken.
    """
    if not isinstance(quantity, Quantity):
        raise ArgumentError(
            "quantity",
            f"{excerpt(repr(quantity))} is none; write fvi.position_at(time), "
            "fvi.quantity_at(expression, time) or fvi.misfit(times, data)",
        )
    chosen = method_on(method, steps)
    if not isinstance(chosen, Method):
        raise ValueError(f"method: {chosen.label} keeps no polynomials; take a Gauss method")
    if isinstance(scene, Scene | Problem | Experiment):
        entries = _named(_scene(scene), parameters)
        own = _scene(scene).lagrangian or _scene(scene).potential
        described = _described(scene, getattr(own, "parameters", {}))
    elif not isinstance(parameters, Mapping):
        raise ValueError("parameters: give the arguments of the function with their values")
    else:
        values = {name: float(value) for name, value in parameters.items()}
        described = _described(scene(**values), values)
        entries = {}
        for name, value in values.items():
            family = partial(_made, scene, values, name)
            part = parameter_of(name, family, value, described)
            entries[name] = Entry(value=np.array(value), parameter=partial(_whole, part))
    changes = (one.parameter(index) for one in entries.values() for index in one.indices)
    found = gradient_of(described[0], chosen, steps, quantity, changes, described[1])
    left_out = found.left_out
    if left_out and parameters is not None:
        raise ValueError(next(iter(left_out.values())))
    rates = iter(found.derivatives.tolist())
    gathered = {
        name: one.gathered([next(rates) for _ in one.indices]) for name, one in entries.items()
    }
    return Gradient(
        value=found.value,
        derivatives={name: one for name, one in gathered.items() if name not in left_out},
        left_out=left_out,
        n_steps=found.n_steps,
        step_solves=found.step_solves,
    )


def _scene(subject: Subject) -> Scene:
    """The scene.

    Raises
    ------
    ValueError
        If there is no motion, or one with impacts.
    """
    if isinstance(subject, Scene):
        return subject
    if isinstance(subject, Experiment) and subject.observations.impacts:
        raise ValueError("impacts: a motion that bounces has no derivatives here")
    problem = subject.problem if isinstance(subject, Experiment) else subject
    if not isinstance(problem, Problem):
        raise ValueError(f"kind: a derivative has no gradient: {problem.kind}")
    return problem.scene


def _names(subject: Subject, values: Mapping[str, float]) -> Observations:
    """The names in expressions; variables of the motion hide arguments of the same name."""
    given = Observations(coordinates=names_of(_scene(subject)))
    problem: object = subject
    if isinstance(subject, Experiment):
        request, problem = subject.observations, subject.problem
        given = replace(given, quantities=request.quantities)
    if isinstance(problem, Problem):
        names = problem.coordinates or given.coordinates
        given = replace(
            given,
            coordinates=names,
            inputs=problem.inputs,
            parameters=problem.numbers,
            ready=problem.ready,
        )
    taken = {*known_names(given.coordinates), *given.inputs, *FUNCTION_NAMES, "pi"}
    own = {name: value for name, value in values.items() if name not in taken}
    return replace(given, parameters={**given.parameters, **own})


def _described(subject: Subject, values: Mapping[str, float]) -> Described:
    return _scene(subject), _names(subject, values)


def _made(
    family: Callable[..., Subject], values: Mapping[str, float], name: str, value: float
) -> Described:
    changed = {**values, name: value}
    return _described(family(**changed), changed)


def _whole(one: Parameter, index: tuple[int, ...]) -> Parameter:
    """The parameter of a number, which has one part."""
    return one


def _named(
    scene: Scene, parameters: Sequence[str] | Mapping[str, float] | None
) -> dict[str, Entry]:
    if isinstance(parameters, Mapping):
        raise ValueError("parameters: their values stand in the scene; give names")
    known = entries_of(scene)
    names = list(known) if parameters is None else list(parameters)
    for name in names:
        if name not in known:
            raise ValueError(f"parameters: {name!r} is not one of {', '.join(known)}")
    return {name: known[name] for name in names}
