"""Derivatives of results of runs, for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError, excerpt
from fvi_cli.integrator.gradients.gradient import gradient_of
from fvi_cli.integrator.gradients.parameters import (
    Described,
    Parameter,
    entries_of,
    parameter_of,
)
from fvi_cli.integrator.gradients.quantity import Quantity
from fvi_cli.integrator.method import Method, as_method
from fvi_cli.integrator.observe.request import Observations, known_names, names_of
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import FUNCTION_NAMES
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import build_problem
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
    """

    value: float
    derivatives: Mapping[str, Array]

    def __getitem__(self, name: str) -> Array:
        """The derivative by one parameter."""
        return self.derivatives[name]


def gradient(
    scene: Subject,
    method: Method | str,
    steps: AnySteps,
    quantity: Quantity,
    parameters: Sequence[str] | None = None,
) -> Gradient:
    """Derivatives of one number of a run, by its linearised discrete equations.

    They are derivatives of the computed number on the mesh of the run (the mesh of an adaptive run
    is fixed), accurate to about ten digits.

    Parameters
    ----------
    scene
        A :class:`fvi_cli.Scene`, a :class:`fvi_cli.Problem`, or an :class:`fvi_cli.Experiment` with
        its ``quantities``.
    method
        A Runge-Kutta method that takes any mesh, or the name of one.
    steps
        As for :func:`fvi_cli.integrate`.
    quantity
        The number to differentiate: :func:`fvi_cli.position_at`, :func:`fvi_cli.velocity_at`,
        :func:`fvi_cli.acceleration_at`, :func:`fvi_cli.quantity_at` for an expression or a quantity
        of the experiment, or :func:`fvi_cli.misfit`. Expressions may contain the parameters.
    parameters
        Names of numbers of the scene: ``mass``, ``stiffness``, ``damping.0.order``,
        ``damping.0.coefficient``, ``initial_position``, ``initial_velocity``,
        ``potential.<parameter>``, ``lagrangian.<parameter>``, ``forcing.<parameter>``,
        ``laws.0.order`` and similar; for an experiment also the ``parameters`` of its problem by
        their names, wherever these stand; None: all of them.

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
    described = own, names = _described(scene)
    entries, named = entries_of(*described), dict[str, float]()
    if isinstance(scene, Experiment):
        named = dict(scene.problem_specification.get("parameters", {}))
    known = (*entries, *named)
    chosen = known if parameters is None else parameters
    if unknown := [name for name in chosen if name not in known]:
        raise ValueError(
            f"parameters: {', '.join(map(repr, unknown))} unknown; give some of {', '.join(known)}"
        )
    changes: dict[str, list[Parameter]] = {}
    for name in chosen:
        if isinstance(scene, Experiment) and name in named:
            family = partial(_with_parameter, scene, name)
            changes[name] = [parameter_of(name, family, float(named[name]), described)]
        else:
            changes[name] = [entries[name].parameter(index) for index in entries[name].indices]
    every = [one for each in changes.values() for one in each]
    value, found = gradient_of(own, as_method(method), steps, quantity, every, names)
    rates = iter(found.tolist())
    derivatives = {}
    for name, parts in changes.items():
        each = [next(rates) for _ in parts]
        derivatives[name] = entries[name].gathered(each) if name in entries else np.array(each[0])
    return Gradient(value=value, derivatives=derivatives)


def _with_parameter(experiment: Experiment, name: str, value: float) -> Described:
    """An experiment with another value of one of the parameters of its problem."""
    given = experiment.problem_specification
    problem = build_problem({**given, "parameters": {**given["parameters"], name: value}})
    return _described(replace(experiment, problem=problem))


def _described(subject: Subject) -> Described:
    """The scene, and the names in expressions; those of the motion hide its parameters."""
    problem: object = subject.problem if isinstance(subject, Experiment) else subject
    parameters: Mapping[str, float] = {}
    if isinstance(problem, Scene):
        scene, names = problem, Observations(coordinates=names_of(problem))
        parameters = getattr(scene.lagrangian or scene.potential, "parameters", {})
    elif isinstance(problem, Problem):
        scene, names = problem.scene, problem.names
    else:
        raise ValueError(f"scene: a {type(problem).__name__} has no motion, and no gradient")
    if isinstance(subject, Experiment):
        if subject.observations.impacts:
            raise ValueError("impacts: a motion that bounces has no derivatives here")
        names = replace(names, quantities=subject.observations.quantities)
    taken = {*known_names(names.coordinates), *FUNCTION_NAMES, "pi"}
    own = {name: value for name, value in parameters.items() if name not in taken}
    return scene, replace(names, parameters={**names.parameters, **own})
