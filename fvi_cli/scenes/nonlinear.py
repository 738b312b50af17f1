"""Scenes with nonlinear potentials and a constant mass."""

from __future__ import annotations

from typing import Unpack

import numpy as np

from fvi_cli.effects.potential import ExpressionPotential, Potential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.data import SceneData, make_scene


def duffing(
    *,
    mass: float = 1.0,
    stiffness: float = 1.0,
    cubic_stiffness: float = 1.0,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of :math:`m x'' + \sum_j \mu_j D^{\gamma_j} x + k x + k_3 x^3 = f(t)`.

    Parameters
    ----------
    stiffness, cubic_stiffness
        k and :math:`k_3`; with k < 0 < :math:`k_3` the potential has two wells, with
        :math:`k_3 = 0` the scene is linear.
    """
    names = ("x", "k", "c")
    potential: Potential = ExpressionPotential(
        coordinates=("x",),
        parameters={"k": float(stiffness), "c": float(cubic_stiffness)},
        energy_expression=Expression.parse("x*x*(k/2 + c/4*x*x)", variables=names),
        gradient_expressions=(Expression.parse("x*(k + c*x*x)", variables=names),),
        hessian_expressions=((Expression.parse("k + 3*c*x*x", variables=names),),),
    )
    if cubic_stiffness == 0:
        potential = QuadraticPotential(stiffness=np.array([[float(stiffness)]]))
    return make_scene([[float(mass)]], potential, **data)


def kepler(
    *,
    attraction: float = 1.0,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of a unit mass in the plane around a centre, with fractional drag.

    .. math:: q'' + \sum_j \mu_j D^{\gamma_j} q + k q / |q|^3 = f(t), \qquad q = (x, y)

    Parameters
    ----------
    attraction
        k, the gravitational parameter.

    Raises
    ------
    ValueError
        If the motion begins in the centre, where the force is infinite.
    """
    if not np.any(np.asarray(data.get("initial_position", 0.0))):
        raise ArgumentError("initial_position", "the force is infinite in the centre, x = y = 0")
    names = ("x", "y", "k")

    def parse(text: str) -> Expression:
        return Expression.parse(text.replace("R", "(x*x + y*y)"), variables=names)

    mixed = parse("-3*k*x*y*R**-2.5")
    potential = ExpressionPotential(
        coordinates=("x", "y"),
        parameters={"k": float(attraction)},
        energy_expression=parse("-k*R**-0.5"),
        gradient_expressions=(parse("k*x*R**-1.5"), parse("k*y*R**-1.5")),
        hessian_expressions=(
            (parse("k*(y*y - 2*x*x)*R**-2.5"), mixed),
            (mixed, parse("k*(x*x - 2*y*y)*R**-2.5")),
        ),
    )
    return make_scene(np.eye(2), potential, **data)
