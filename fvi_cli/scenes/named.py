"""The linear oscillator and the pendulum, as functions of their parameters."""

from __future__ import annotations

from typing import Unpack

from numpy.typing import ArrayLike

from fvi_cli.effects.matrices import SparseMatrix, is_zero
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.data import SceneData, make_scene


def linear_oscillator(
    *,
    mass: ArrayLike | SparseMatrix = 1.0,
    stiffness: ArrayLike | SparseMatrix = 1.0,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of :math:`M x'' + \sum_j \mu_j D^{\gamma_j} x + K x = f(t)`.

    With one term of order 1 this is the damped oscillator of the paper (section "Numerical
    examples"), with one term of order 1/2 or 3/2 its Bagley-Torvik equation. A stiffness of zero
    is no potential at all.
    """
    potential = QuadraticPotential(stiffness=stiffness)
    return make_scene(mass, None if is_zero(potential.form) else potential, **data)


def pendulum(*, omega: float = 1.0, **data: Unpack[SceneData]) -> Scene:
    r"""Scene of :math:`x'' + \sum_j \mu_j D^{\gamma_j} x + \omega^2 \sin x = f(t)`."""
    names = ("x", "omega")
    potential = ExpressionPotential(
        coordinates=("x",),
        parameters={"omega": float(omega)},
        energy_expression=Expression.parse("omega**2*(1 - cos(x))", variables=names),
        gradient_expressions=(Expression.parse("omega**2*sin(x)", variables=names),),
        hessian_expressions=((Expression.parse("omega**2*cos(x)", variables=names),),),
    )
    return make_scene([[1.0]], potential, **data)
