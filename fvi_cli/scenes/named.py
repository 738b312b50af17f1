"""Named scenes: what their equations are, as functions of their parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import ExpressionPotential, Potential, QuadraticPotential
from fvi_cli.effects.scene import Derivative, Scene
from fvi_cli.mathematics.expressions import Expression


def linear_oscillator(
    *,
    final_time: float,
    mass: ArrayLike = 1.0,
    stiffness: ArrayLike = 1.0,
    damping: Sequence[FractionalDamping] = (),
    forcing: Forcing | None = None,
    initial_position: ArrayLike = 0.0,
    initial_velocity: ArrayLike = 0.0,
    derivative: Derivative = "caputo",
) -> Scene:
    r"""Scene of :math:`M x'' + \sum_j \mu_j D^{\gamma_j} x + K x = f(t)`.

    With one term of order 1 this is the damped oscillator of the paper (section "Numerical
    examples"), with one term of order 1/2 or 3/2 its Bagley-Torvik equation. A stiffness of zero
    is no potential at all.
    """
    potential: Potential | None = None
    if np.any(np.asarray(stiffness) != 0):
        potential = QuadraticPotential(stiffness=np.asarray(stiffness, dtype=float))
    return Scene(
        inertia=Inertia(mass=np.asarray(mass, dtype=float)),
        potential=potential,
        damping=tuple(damping),
        forcing=forcing,
        initial_position=np.atleast_1d(np.asarray(initial_position, dtype=float)),
        initial_velocity=np.atleast_1d(np.asarray(initial_velocity, dtype=float)),
        final_time=final_time,
        derivative=derivative,
    )


def pendulum(
    *,
    final_time: float,
    omega: float = 1.0,
    damping: Sequence[FractionalDamping] = (),
    forcing: Forcing | None = None,
    initial_position: ArrayLike = 0.0,
    initial_velocity: ArrayLike = 0.0,
    derivative: Derivative = "caputo",
) -> Scene:
    r"""Scene of :math:`x'' + \sum_j \mu_j D^{\gamma_j} x + \omega^2 \sin x = f(t)`."""
    names = ("x", "omega")
    potential = ExpressionPotential(
        coordinates=("x",),
        parameters={"omega": float(omega)},
        energy_expression=Expression.parse("omega**2*(1 - cos(x))", variables=names),
        gradient_expressions=(Expression.parse("omega**2*sin(x)", variables=names),),
        hessian_expressions=((Expression.parse("omega**2*cos(x)", variables=names),),),
    )
    return Scene(
        inertia=Inertia(mass=np.array([[1.0]])),
        potential=potential,
        damping=tuple(damping),
        forcing=forcing,
        initial_position=np.atleast_1d(np.asarray(initial_position, dtype=float)),
        initial_velocity=np.atleast_1d(np.asarray(initial_velocity, dtype=float)),
        final_time=final_time,
        derivative=derivative,
    )
