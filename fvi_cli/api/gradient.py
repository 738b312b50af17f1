"""Derivatives of runs, for programs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.adjoint.entries import Entry, entries_of
from fvi_cli.integrator.adjoint.gradient import gradient_of
from fvi_cli.integrator.adjoint.quantity import Quantity
from fvi_cli.integrator.adjoint.variation import Variation
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.runge_kutta import AnySteps
from fvi_cli.runner.scenes import method_on

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Gradient:
    r"""A number of a trajectory, and what it changes by.

    Parameters
    ----------
    value
        The number.
    derivatives
        For every parameter an array G of the shape of its value, such that the number changes by
        :math:`\sum G\, d\theta`.
    n_steps, step_solves
        Steps of the run, and the linear systems of a step that the derivatives took, the run
        itself aside: one for every step, however many parameters there are.
    """

    value: float
    derivatives: Mapping[str, Array]
    n_steps: int
    step_solves: int

    def __getitem__(self, name: str) -> Array:
        """The derivative by one parameter."""
        return self.derivatives[name]


def gradient(
    scene: Scene | Callable[..., Scene],
    method: Method | str,
    steps: AnySteps,
    quantity: Quantity,
    parameters: Sequence[str] | Mapping[str, float] | None = None,
) -> Gradient:
    """Derivatives of one number of a run, by the adjoint of its discrete equations.

    They are derivatives of what the run computes, on its own mesh (that of an adaptive run is held
    fixed), good to about ten digits, and cost one run and one sweep backwards.

    Parameters
    ----------
    scene
        What moves; or a function that makes it of the parameters, given by name.
    method
        A Runge-Kutta method that takes any mesh, or the name of one.
    steps
        As for :func:`fvi_cli.integrate`.
    quantity
        What is differentiated: :func:`fvi_cli.position_at`, :func:`fvi_cli.velocity_at`,
        :func:`fvi_cli.misfit`, or a :class:`fvi_cli.Quantity` of your own.
    parameters
        Of a scene the names of its numbers: ``mass``, ``stiffness``, ``damping.0.order``,
        ``damping.0.coefficient``, ``initial_position``, ``initial_velocity``,
        ``potential.<parameter>``, ``laws.0.order`` and the like; None: all of them. Of a function
        its arguments with their values.

    Raises
    ------
    ValueError
        For names that do not exist, a method without polynomials, and a run that does not come to
        its end.

    Notes
    -----
    A Caputo derivative of order above 1 subtracts the start velocity, one of order 1 or less does
    not: with a start velocity the motion jumps where an order passes 1, and the derivative is that
    from the side of its value (at 1 from below).
    """
    chosen = method_on(method, steps)
    if not isinstance(chosen, Method):
        raise ValueError(f"method: {chosen.case} keeps no polynomials; take a Gauss method")
    if isinstance(scene, Scene):
        entries = _named(scene, parameters)
        parts = [list(one.variations()) for one in entries]
        changes = [change for part in parts for _, change in part]
        found = gradient_of(scene, chosen, steps, quantity, changes)
        rates = iter(found.derivatives.tolist())
        derivatives = {
            one.name: one.gathered({index: next(rates) for index, _ in part})
            for one, part in zip(entries, parts, strict=True)
        }
    else:
        if not isinstance(parameters, Mapping):
            raise ValueError("parameters: give the arguments of the function with their values")
        values = {name: float(value) for name, value in parameters.items()}
        changes = [
            Variation(family=partial(_made, scene, values, name), value=value, name=name)
            for name, value in values.items()
        ]
        found = gradient_of(scene(**values), chosen, steps, quantity, changes)
        derivatives = {
            name: np.array(rate) for name, rate in zip(values, found.derivatives, strict=True)
        }
    return Gradient(
        value=found.value,
        derivatives=derivatives,
        n_steps=found.n_steps,
        step_solves=found.step_solves,
    )


def _named(scene: Scene, parameters: Sequence[str] | Mapping[str, float] | None) -> list[Entry]:
    if isinstance(parameters, Mapping):
        raise ValueError("parameters: their values stand in the scene; give names")
    known = entries_of(scene)
    names = list(known) if parameters is None else list(parameters)
    for name in names:
        if name not in known:
            raise ValueError(f"parameters: {name!r} is not one of {', '.join(known)}")
    return [known[name] for name in names]


def _made(
    family: Callable[..., Scene], values: Mapping[str, float], name: str, number: float
) -> Scene:
    return family(**{**values, name: number})
