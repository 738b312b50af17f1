"""Arguments that all scenes share, and scenes of one mass or a few."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final, Required, TypedDict, TypeVar, Unpack

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.laws import Law
from fvi_cli.effects.matrices import Factored, SparseMatrix, is_sparse
from fvi_cli.effects.potential import (
    ExpressionPotential,
    LinearPotential,
    Potential,
    QuadraticPotential,
)
from fvi_cli.effects.scene import Derivative, Scene, dampers_of
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.records.matrices import matrix_of

Effect = FractionalDamping | Law
"""A damping term or a law."""


class SceneData(TypedDict, total=False):
    r"""Keyword arguments of all scenes."""

    final_time: Required[float]
    damping: Sequence[Effect]
    laws: Sequence[Law]
    forcing: Forcing | str | Sequence[str] | None
    initial_position: ArrayLike
    initial_velocity: ArrayLike
    derivative: Derivative


MEANING: Final = r"""
Parameters
----------
final_time
    T: the motion is sought on [0, T].
damping
    Terms :math:`\mu D^\gamma q` of the equation of motion, and relaxation laws: a list of
    :class:`fvi_cli.FractionalDamping`, and of what ``fvi.fractional_zener``,
    ``fvi.fractional_maxwell`` and ``fvi.prony`` return. Coefficients are symmetric matrices, or
    numbers for every coordinate.
laws
    Further laws.
forcing
    f(t): a :class:`fvi_cli.Forcing`, or its formula in t, ``"0.3*cos(1.2*t)"``; for several
    coordinates a list of formulas.
initial_position, initial_velocity
    q(0) and q'(0), shape ``(d,)``; a number stands for every coordinate.
derivative
    ``"caputo"`` or ``"riemann-liouville"``.

Raises
------
ValueError
    For values that are not allowed.
"""
"""Section of the docstring of every scene on the shared arguments."""

_Make = TypeVar("_Make", bound=Callable[..., Scene])


def scene_function(make: _Make) -> _Make:
    """The function with the shared arguments in its docstring."""
    make.__doc__ = f"{inspect.cleandoc(make.__doc__ or '')}\n{MEANING}"
    return make


def given_force(given: Forcing | str | Sequence[str] | None) -> Forcing | None:
    """A force; formulas in t are converted to one."""
    if given is None or isinstance(given, Forcing):
        return given
    return Forcing.from_text(*([given] if isinstance(given, str | float) else given))


def make_scene(
    mass: ArrayLike | SparseMatrix,
    potential: Potential | None = None,
    *,
    lagrangian: Lagrangian | None = None,
    linear_potential: LinearPotential | None = None,
    coordinates: tuple[str, ...] = (),
    **data: Unpack[SceneData],
) -> Scene:
    """The scene of a mass matrix, shape ``(d, d)`` or a number, and its other effects."""
    inertia = Inertia(mass=mass)
    given: dict[str, Any] = {**data, "forcing": given_force(data.get("forcing"))}
    for name in ("damping", "laws"):
        forces = dampers_of(given.get(name, ()), name)
        given[name] = [_on_coordinates(one, inertia, name) for one in forces]
    for name in ("initial_position", "initial_velocity"):
        given[name] = per_coordinate(given.get(name, 0.0), inertia.dimension, name)
    return Scene(
        inertia=inertia,
        potential=potential,
        lagrangian=lagrangian,
        linear_potential=linear_potential,
        coordinates=coordinates,
        **given,
    )


def _on_coordinates(force: Effect, inertia: Inertia, name: str) -> Effect:
    """A force with a matrix; a number as its coefficient stands for every coordinate."""
    if force.factored is None and force.storeys:
        raise ArgumentError(name, "a storey is one of dampers between parts, with a number")
    if force.dimension != 1 or inertia.dimension == 1:
        return force
    sparse = is_sparse(inertia.form)
    matrix = matrix_of(force.matrix[0, 0], inertia.dimension, sparse=sparse)
    return replace(force, coefficient=matrix)


def per_coordinate(value: ArrayLike, size: int, name: str) -> Array:
    """A vector ``(size,)``: equal numbers from one number, or the given ones."""
    vector = np.asarray(value, dtype=float)
    vector = np.full(size, float(vector)) if vector.ndim == 0 else vector
    if vector.shape != (size,):
        raise ArgumentError(name, f"{size} numbers are needed, got {vector.tolist()}")
    return vector


def with_dampers(
    data: SceneData, dampers: Sequence[Effect], rows: Array, name: str = "dampers"
) -> SceneData:
    """The data with dampers on deformations B q of parts after its other damping.

    A damper whose coefficient is a number acts on every part, or on those of its storeys.
    """
    placed = [*data.get("damping", ())]
    for one in dampers_of(dampers, name):
        if not set(one.storeys) <= set(range(1, len(rows) + 1)):
            words = f"storey {max(one.storeys)} is not allowed; write 1 to {len(rows)}"
            raise ArgumentError(name, words)
        if one.factored is None and one.dimension == 1:
            own = rows[[storey - 1 for storey in one.storeys]] if one.storeys else rows
            one = replace(one, coefficient=Factored(rows=own, inner=one.matrix[0, 0]))
        placed.append(one)
    return {**data, "damping": placed}


@scene_function
def pendulum(*, omega: float = 1.0, **data: Unpack[SceneData]) -> Scene:
    r"""Scene of :math:`x'' + \sum_j \mu_j D^{\gamma_j} x + \omega^2 \sin x = f(t)`."""
    potential = _potential(("x",), "omega**2*(1 - cos(x))", omega=omega)
    return make_scene([[1.0]], potential, **data)


@scene_function
def duffing(
    *,
    mass: float = 1.0,
    stiffness: float = 1.0,
    cubic_stiffness: float = 1.0,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of :math:`m x'' + \sum_j \mu_j D^{\gamma_j} x + k x + k_3 x^3 = f(t)`.

    With k < 0 < :math:`k_3` the potential has two wells, with :math:`k_3 = 0` the scene is linear.
    """
    potential: Potential = QuadraticPotential(stiffness=stiffness)
    if cubic_stiffness != 0:
        energy = "k*x**2/2 + c*x**2*x**2/4"
        potential = _potential(("x",), energy, k=stiffness, c=cubic_stiffness)
    return make_scene([[float(mass)]], potential, **data)


@scene_function
def kepler(
    *,
    attraction: float = 1.0,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of a unit mass in the plane around a centre, with fractional drag.

    .. math:: q'' + \sum_j \mu_j D^{\gamma_j} q + k q / |q|^3 = f(t), \qquad q = (x, y)
    """
    potential = _potential(("x", "y"), "-k*(x*x + y*y)**-0.5", k=attraction)
    return make_scene(np.eye(2), potential, **data)


def _potential(names: tuple[str, ...], energy: str, **parameters: float) -> ExpressionPotential:
    """The potential energy of a formula in the coordinates and parameters."""
    return ExpressionPotential(
        coordinates=names,
        parameters={name: float(value) for name, value in parameters.items()},
        energy_expression=Expression.parse(energy, variables=(*names, *parameters)),
    )
