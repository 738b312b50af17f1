"""Scenes from the formula of a Lagrangian."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, Unpack

import numpy as np

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.lagrangian import TIME, Lagrangian, velocity_name
from fvi_cli.effects.potential import (
    ExpressionPotential,
    LinearPotential,
    QuadraticPotential,
)
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.algebra.builder import bound, derivatives, negative, terms_with
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.data import (
    Effect,
    SceneData,
    given_force,
    make_scene,
    per_coordinate,
    scene_function,
    with_dampers,
)


@scene_function
def lagrangian_scene(
    *,
    coordinates: Sequence[str],
    lagrangian: str,
    parameters: Mapping[str, float] | None = None,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of a Lagrangian with fractional damping; ``vx`` is the velocity of ``x``.

    .. math:: \frac{d}{dt} \frac{\partial L}{\partial v} - \frac{\partial L}{\partial q}
              = f(t) - \sum_j \mu_j D^{\gamma_j} q

    Derivatives are taken symbolically. A Lagrangian that is quadratic in q and v becomes matrices
    and constant forces; the potential of these counts in the energy. A Lagrangian with a constant
    mass matrix and without products of q or t with v becomes an inertia and a potential. In both
    cases terms linear in q that contain t become forcing. All other Lagrangians keep their general
    form.

    Raises
    ------
    ValueError
        For names, formulas and masses that are not allowed.
    """
    names, d = tuple(coordinates), len(coordinates)
    velocities = tuple(map(velocity_name, names))
    try:
        expression = Expression.parse(
            lagrangian, variables=(*names, *velocities, TIME), constants=dict(parameters or {})
        )
        effects = dict(_recognise(names, velocities, expression))
    except ExpressionError as error:
        raise ArgumentError("lagrangian", str(error)) from None
    if "mass" not in effects:
        position = per_coordinate(data.get("initial_position", 0.0), d, "initial_position")
        velocity = per_coordinate(data.get("initial_velocity", 0.0), d, "initial_velocity")
        effects["mass"] = effects["lagrangian"].derivatives(position, velocity, 0.0).mass
    if (own := effects.pop("forcing", None)) is not None:
        given = given_force(data.get("forcing"))
        data["forcing"] = own if given is None else given.plus(own)
    try:
        return make_scene(**effects, coordinates=names, **data)
    except ArgumentError as error:
        if error.key == "mass":
            error.key = "lagrangian"
        raise


@scene_function
def double_pendulum(
    *,
    masses: tuple[float, float] = (1.0, 1.0),
    lengths: tuple[float, float] = (1.0, 1.0),
    gravity: float = 1.0,
    joints: Sequence[Effect] = (),
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of two rods in a row with point masses at their ends and damped joints.

    With the angles :math:`\theta_1, \theta_2` from the vertical,

    .. math:: L = \tfrac12 (m_1 + m_2) l_1^2 \dot\theta_1^2
              + \tfrac12 m_2 l_2^2 \dot\theta_2^2
              + m_2 l_1 l_2 \dot\theta_1 \dot\theta_2 \cos(\theta_1 - \theta_2)
              + (m_1 + m_2) g l_1 \cos\theta_1 + m_2 g l_2 \cos\theta_2,

    and every joint, the one at the ceiling and the one between the rods, turns against
    :math:`c D^\gamma` of its own angle, :math:`\theta_1` and :math:`\theta_2 - \theta_1`.
    `joints` are terms and laws whose coefficients c are numbers.
    """
    (m1, m2), (l1, l2) = masses, lengths
    rows = np.array([[1.0, 0.0], [-1.0, 1.0]])
    return lagrangian_scene(
        coordinates=("theta1", "theta2"),
        lagrangian="(m1 + m2)/2*(l1*vtheta1)**2 + m2/2*(l2*vtheta2)**2"
        " + m2*l1*l2*vtheta1*vtheta2*cos(theta1 - theta2)"
        " + (m1 + m2)*g*l1*cos(theta1) + m2*g*l2*cos(theta2)",
        parameters={"m1": m1, "m2": m2, "l1": l1, "l2": l2, "g": gravity},
        **with_dampers(data, joints, rows, "joints"),
    )


@lru_cache(maxsize=64)
def _recognise(
    names: tuple[str, ...], velocities: tuple[str, ...], expression: Expression
) -> Mapping[str, Any]:
    """The effects of a Lagrangian as arguments of :func:`make_scene`."""
    parameters, kinks = dict(expression.constants), expression.system.kinked
    general = Lagrangian(coordinates=names, value=expression.system, parameters=parameters)
    d, every = len(names), (*names, *velocities, TIME)
    masses = general.second[2 * d : 2 * d + d * d]
    mass = None if kinks & set(velocities) else _matrix(masses, parameters, every)
    at_rest = dict.fromkeys(velocities, 0.0)
    try:
        momenta = bound(general.first[:d], at_rest).constants(parameters, every)
        if mass is not None and momenta is not None and not any(momenta):
            parts = _separate(general, at_rest, is_smooth=not kinks & set(names))
            if parts is not None:
                return {"mass": mass, **parts}
    except ExpressionError:
        # the Lagrangian has no value at rest
        pass
    return {"lagrangian": general}


def _separate(
    general: Lagrangian, at_rest: Mapping[str, float], *, is_smooth: bool
) -> dict[str, Any] | None:
    """V(q), the linear potential c - f q, and f(t), with V + c - f q - f(t) q = -L at rest.

    None where L has no such form.
    """
    names, parameters = general.coordinates, general.parameters
    lagrangian, forces = bound(general.value, at_rest), bound(general.first[len(names) :], at_rest)
    origin = dict.fromkeys(names, 0.0)
    along = [{name: 1.0} for name in names]
    hessian = derivatives(forces, along)[len(names) :]
    stiffness = _matrix(hessian, parameters, (*names, TIME)) if is_smooth else None
    timed, static = terms_with(lagrangian, TIME)
    if stiffness is not None:
        # terms linear in q act as forces, also constant ones
        potential = QuadraticPotential(stiffness=-stiffness) if np.any(stiffness) else None
        loads = bound(forces, origin)
        linear = _linear(static, loads, origin, parameters)
        forcing = _forces(loads, parameters)
        return {"potential": potential, "linear_potential": linear, "forcing": forcing}
    moving = derivatives(timed, along)[1:]
    rest = derivatives(moving, along)[len(names) :].constants(parameters, (*names, TIME))
    if rest is None or any(rest) or timed.kinked & set(names):
        return None
    variables = (*names, *parameters)
    energy = Expression("the potential energy", variables, system=negative(static))
    smooth = ExpressionPotential(coordinates=names, energy_expression=energy, parameters=parameters)
    return {"potential": smooth, "forcing": _forces(bound(moving, origin), parameters)}


def _linear(
    static: FormulaSystem,
    loads: FormulaSystem,
    origin: Mapping[str, float],
    parameters: Mapping[str, float],
) -> LinearPotential | None:
    """The constant and linear terms of -L at rest without t; None where all are 0."""
    along = [{name: 1.0} for name in origin]
    values = bound(derivatives(static, along), origin).constants(parameters, (TIME,))
    if values is None:  # pragma: no cover - neither q, v nor t is left
        return None
    # exactly the acting forces where none of them depends on t
    force = loads.constants(parameters, (TIME,)) or values[1:]
    if not values[0] and not any(force):
        return None
    return LinearPotential(offset=-values[0], force=np.array(force))


def _forces(system: FormulaSystem, parameters: Mapping[str, float]) -> Forcing | None:
    """The force in t; None where it is 0."""
    if system.constants(parameters, (TIME,)) == [0.0] * len(system.outputs):
        return None
    constants = tuple(sorted(parameters.items()))
    components = tuple(
        Expression("the force in the Lagrangian", (TIME,), constants, system[k : k + 1])
        for k in range(len(system.outputs))
    )
    return Forcing(pieces=(ForcingPiece(components=components),))


def _matrix(
    entries: FormulaSystem, parameters: Mapping[str, float], names: Sequence[str]
) -> Array | None:
    """The matrix of numbers; None if an entry still depends on a variable."""
    values = entries.constants(parameters, names)
    if values is None:
        return None
    size = math.isqrt(len(values))
    matrix = np.array(values).reshape(size, size)
    return np.asarray(0.5 * (matrix + matrix.T))
