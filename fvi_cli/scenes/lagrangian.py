"""Scenes from the formula of a Lagrangian."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Unpack

import numpy as np

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.lagrangian import TIME, Lagrangian, velocity_name
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import Form, dense
from fvi_cli.effects.potential import (
    ExpressionPotential,
    LinearPotential,
    Potential,
    QuadraticPotential,
    with_stiffness,
)
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.observe.dampers import damper_values
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.algebra.builder import bound, derivatives, negative, terms_with
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.definite import singular_words
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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Recognised:
    """The parts of a Lagrangian: mass, potential and forces, or only its general form."""

    mass: Array | None = None
    potential: Potential | None = None
    linear: LinearPotential | None = None
    forcing: tuple[Expression, ...] | None = None
    general: Lagrangian | None = None


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
        With a message that begins with the key: ``coordinates``, ``parameters``, ``lagrangian`` or
        ``initial_position``.
    """
    names = tuple(coordinates)
    values = dict(parameters or {})
    check_names(names, values)
    velocities = tuple(velocity_name(name) for name in names)
    effects = (*data.get("damping", ()), *data.get("laws", ()))
    laws = [one for one in effects if isinstance(one, Law)]
    stored = [law.stiffness for law in laws if law.relaxed]
    data["laws"] = [law.without_stiffness() for law in laws]
    data["damping"] = [one for one in effects if not isinstance(one, Law)]
    try:
        expression = Expression.parse(
            lagrangian, variables=(*names, *velocities, TIME), constants=values
        )
        if not expression.names & set(velocities):
            raise ArgumentError(
                "lagrangian",
                f"it contains no velocity ({', '.join(velocities)}); "
                "a Lagrangian needs a kinetic energy",
            )
        found = _recognise(names, velocities, expression)
    except ExpressionError as error:
        raise ArgumentError("lagrangian", str(error)) from None
    for stiffness in stored:
        found = _with_stiffness(found, stiffness)
    position = per_coordinate(data.get("initial_position", 0.0), len(names), "initial_position")
    velocity = per_coordinate(data.get("initial_velocity", 0.0), len(names), "initial_velocity")
    at_start = _values_at(found, position, velocity)
    if not all(np.isfinite(one).all() for one in at_start):
        words = "it or a derivative of it is not finite at the initial position and velocity"
        raise ArgumentError("lagrangian", words)
    mass = at_start[0] if found.mass is None else found.mass
    if found.mass is None:
        _check_mass(mass, velocities, " at the start")
    if found.forcing is not None:
        given = given_force(data.get("forcing"))
        own = Forcing(pieces=(ForcingPiece(components=found.forcing),))
        data["forcing"] = own if given is None else given.plus(found.forcing)
    made = make_scene(
        mass, found.potential, lagrangian=found.general, linear_potential=found.linear, **data
    )
    check_names(names, values, names_of_dampers(made))
    return replace(made, coordinates=names)


def _values_at(found: _Recognised, position: Array, velocity: Array) -> list[Array]:
    """What must be finite at the start; of a general form the mass matrix first."""
    if found.general is not None:
        at = found.general.derivatives(position, velocity, 0.0)
        value = found.general.lagrangian(position, velocity, 0.0)
        return [at.mass, value, at.momentum, at.force, at.stiffness]
    if found.potential is None:
        return []
    own = found.potential
    return [own.energy(position), own.gradient(position), own.hessian(position)]


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


def check_names(
    coordinates: Sequence[str],
    parameters: Mapping[str, float],
    others: Mapping[str, str] | None = None,
) -> None:
    """Refuse parameters whose names formulas of the motion already use.

    Used are coordinates, names derived from them, t, and `others` (name to meaning).
    """
    taken = {TIME: "the time"}
    for index, name in enumerate(coordinates):
        derived = {name: "a coordinate", velocity_name(name): f"the velocity of {name}"}
        for given in derived:
            if given in taken:
                raise ArgumentError(f"coordinates.{index}", f"{given!r} is {taken[given]} already")
            _check_name(given, f"coordinates.{index}")
        taken |= derived
    for name in coordinates:
        taken.setdefault(f"a{name}", f"the acceleration of {name}")
        taken.setdefault(f"d{name}", f"the damping force on {name}")
    taken = {**(others or {}), **taken}
    for name in parameters:
        if name in taken:
            words = f"the name is {taken[name]} already; write another, such as {name}_0"
            raise ArgumentError(f"parameters.{name}", words)
        _check_name(name, f"parameters.{name}")


def names_of_dampers(scene: Scene) -> dict[str, str]:
    """Names that formulas may use for the dampers of a scene, with their meaning."""
    return {name: f"the {one.kind} of a damper" for name, one in damper_values(scene).items()}


def _check_name(name: str, place: str) -> None:
    try:
        Expression.parse("0", variables=(name,))
    except ExpressionError as error:
        raise ArgumentError(place, str(error)) from None


@lru_cache(maxsize=64)
def _recognise(
    names: tuple[str, ...], velocities: tuple[str, ...], expression: Expression
) -> _Recognised:
    parameters = dict(expression.constants)
    general = Lagrangian(coordinates=names, value=expression.system, parameters=parameters)
    d, every = len(names), (*names, *velocities, TIME)
    kinks = expression.system.kinked
    masses = general.second[2 * d : 2 * d + d * d]
    mass = None if kinks & set(velocities) else _matrix(masses, parameters, every)
    if mass is None:
        return _Recognised(general=general)
    _check_mass(mass, velocities, "")
    at_rest = dict.fromkeys(velocities, 0.0)
    try:
        momenta = bound(general.first[:d], at_rest).constants(parameters, every)
        if momenta is None or any(momenta):
            return _Recognised(general=general)
        separated = _separate(general, at_rest, is_smooth=not kinks & set(names))
    except ExpressionError:
        # the Lagrangian has no value at rest
        separated = None
    return _Recognised(general=general) if separated is None else replace(separated, mass=mass)


def _with_stiffness(found: _Recognised, stiffness: Form) -> _Recognised:
    r"""The parts of a Lagrangian less :math:`q^T K q / 2`."""
    if found.general is None:
        return replace(found, potential=with_stiffness(found.potential, stiffness))
    own = found.general.stiffness
    total = dense(stiffness) if own is None else own + dense(stiffness)
    return replace(found, general=replace(found.general, stiffness=total))


def _separate(
    general: Lagrangian, at_rest: Mapping[str, float], *, is_smooth: bool
) -> _Recognised | None:
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
        own = _forces(loads, parameters)
        return _Recognised(potential=potential, linear=linear, forcing=own)
    moving = derivatives(timed, along)[1:]
    rest = derivatives(moving, along)[len(names) :].constants(parameters, (*names, TIME))
    if rest is None or any(rest) or timed.kinked & set(names):
        return None
    variables = (*names, *parameters)
    energy = Expression("the potential energy", variables, system=negative(static))
    own = _forces(bound(moving, origin), parameters)
    smooth = ExpressionPotential(coordinates=names, energy_expression=energy, parameters=parameters)
    return _Recognised(potential=smooth, forcing=own)


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


def _forces(
    system: FormulaSystem, parameters: Mapping[str, float]
) -> tuple[Expression, ...] | None:
    """Forces in t; None where all are 0."""
    if system.constants(parameters, (TIME,)) == [0.0] * len(system.outputs):
        return None
    constants = tuple(sorted(parameters.items()))
    return tuple(
        Expression("the force in the Lagrangian", (TIME,), constants, system[k : k + 1])
        for k in range(len(system.outputs))
    )


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


def _check_mass(mass: Array, velocities: tuple[str, ...], where: str) -> None:
    missing = [v for v, row in zip(velocities, mass, strict=True) if not np.any(row)]
    if singular_words(mass):
        smallest = float(np.linalg.eigvalsh(mass)[0])
        reason = f" ({', '.join(missing)} does not occur quadratically)" if missing else ""
        raise ArgumentError(
            "lagrangian",
            f"the mass matrix d2L/dv2 is not positive definite{where}: its smallest "
            f"eigenvalue is {smallest:g}{reason}",
        )
