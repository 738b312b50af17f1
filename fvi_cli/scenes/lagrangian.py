"""Scenes from a Lagrangian that is written as a formula."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Unpack

import numpy as np

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.lagrangian import TIME, Lagrangian, velocity_name
from fvi_cli.effects.matrices import Form, dense
from fvi_cli.effects.potential import (
    ExpressionPotential,
    Potential,
    QuadraticPotential,
    with_stiffness,
)
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics import symbolic
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.data import Damper, SceneData, make_scene, per_coordinate, with_dampers

LEAST_MASS = 1e-12
"""Smallest eigenvalue of a mass matrix that counts as positive, relative to the largest."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Recognised:
    """What a Lagrangian was found to consist of."""

    mass: Array | None = None
    potential: Potential | None = None
    forcing: tuple[Expression, ...] | None = None
    general: Lagrangian | None = None


def lagrangian_scene(
    *,
    coordinates: Sequence[str],
    lagrangian: str,
    parameters: Mapping[str, float] | None = None,
    **data: Unpack[SceneData],
) -> Scene:
    r"""Scene of a Lagrangian with fractional damping.

    .. math:: \frac{d}{dt} \frac{\partial L}{\partial v} - \frac{\partial L}{\partial q}
              = f(t) - \sum_j \mu_j D^{\gamma_j} q

    Derivatives are taken symbolically. A Lagrangian that is quadratic in q and v becomes matrices
    (with a force where it is linear in q, which then does not count in the energy); one with a
    constant mass matrix and without products of q or t with v becomes an inertia and a potential;
    all others keep their general form.

    Parameters
    ----------
    coordinates
        Names of the d coordinates; the velocity of ``x`` is ``vx``.
    lagrangian
        L in coordinates, velocities, parameters and ``t``.
    parameters
        Values of further names.

    Raises
    ------
    ValueError
        ``coordinates...``, ``parameters...``, ``lagrangian...`` or ``initial_position...:`` what
        is wrong.
    """
    names = tuple(coordinates)
    values = dict(parameters or {})
    check_names(names, values)
    velocities = tuple(velocity_name(name) for name in names)
    laws = tuple(data.get("laws", ()))
    stored = [law.stiffness for law in laws if law.relaxed]
    data["laws"] = tuple(law.without_stiffness() for law in laws)
    try:
        expression = Expression.parse(
            lagrangian, variables=(*names, *velocities, TIME), constants=values
        )
        if not expression.names & set(velocities):
            raise ValueError(
                f"lagrangian: no velocity occurs in it ({', '.join(velocities)}); "
                "without a kinetic energy nothing moves"
            )
        found = _recognise(names, velocities, expression)
    except ExpressionError as error:
        raise ValueError(f"lagrangian: {error}") from None
    for stiffness in stored:
        found = _with_stiffness(found, stiffness)
    position = per_coordinate(data.get("initial_position", 0.0), len(names))
    velocity = per_coordinate(data.get("initial_velocity", 0.0), len(names))
    mass = found.mass
    if found.general is not None:
        at_start = found.general.derivatives(position, velocity, 0.0)
        mass = at_start.mass
        value = found.general.lagrangian(position, velocity, 0.0)
        first = np.concatenate(
            [np.atleast_1d(value), at_start.momentum, at_start.force, at_start.stiffness.ravel()]
        )
        if not (np.isfinite(mass).all() and np.isfinite(first).all()):
            raise ValueError(
                "lagrangian: it or a derivative of it is not finite at the initial position and "
                "velocity"
            )
        _check_mass(mass, velocities, " at the start")
    if isinstance(found.potential, ExpressionPotential):
        _check_start(found.potential, position)
    if mass is None:  # pragma: no cover - one of the two is there
        raise ValueError("lagrangian: no mass matrix")
    data["forcing"] = _with(data.get("forcing"), found.forcing)
    return make_scene(mass, found.potential, lagrangian=found.general, **data)


def double_pendulum(
    *,
    masses: tuple[float, float] = (1.0, 1.0),
    lengths: tuple[float, float] = (1.0, 1.0),
    gravity: float = 1.0,
    joints: Sequence[Damper] = (),
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

    Parameters
    ----------
    masses, lengths, gravity
        :math:`m_1, m_2`, :math:`l_1, l_2` and g.
    joints
        Pairs of order and coefficient c of the dampers in both joints.
    damping
        Further terms :math:`\mu D^\gamma \theta`.
    """
    (m1, m2), (l1, l2) = masses, lengths
    relative = np.array([[2.0, -1.0], [-1.0, 1.0]])
    return lagrangian_scene(
        coordinates=("theta1", "theta2"),
        lagrangian="(m1 + m2)/2*(l1*vtheta1)**2 + m2/2*(l2*vtheta2)**2"
        " + m2*l1*l2*vtheta1*vtheta2*cos(theta1 - theta2)"
        " + (m1 + m2)*g*l1*cos(theta1) + m2*g*l2*cos(theta2)",
        parameters={"m1": m1, "m2": m2, "l1": l1, "l2": l2, "g": gravity},
        **with_dampers(data, relative, joints),
    )


def check_names(coordinates: Sequence[str], parameters: Mapping[str, float]) -> None:
    """Coordinates, their velocities, t and parameters must be different names.

    Raises
    ------
    ValueError
        ``coordinates.<index>: ...`` or ``parameters.<name>: ...``.
    """
    taken = {TIME: "the time"}
    for index, name in enumerate(coordinates):
        for given, what in (
            (name, "a coordinate"),
            (velocity_name(name), f"the velocity of {name}"),
        ):
            if given in taken:
                raise ValueError(f"coordinates.{index}: {given!r} is {taken[given]} already")
            _check_name(given, f"coordinates.{index}")
            taken[given] = what
    for name in parameters:
        if name in taken:
            raise ValueError(f"parameters.{name}: the name is {taken[name]}")
        _check_name(name, f"parameters.{name}")


def _check_name(name: str, place: str) -> None:
    try:
        Expression.parse("0", variables=(name,))
    except ExpressionError as error:
        raise ValueError(f"{place}: {error}") from None


@lru_cache(maxsize=64)
def _recognise(
    names: tuple[str, ...], velocities: tuple[str, ...], expression: Expression
) -> _Recognised:
    formula = symbolic.symbolic(expression)
    q = [symbolic.symbol(name) for name in names]
    v = [symbolic.symbol(name) for name in velocities]
    t = symbolic.symbol(TIME)
    momenta = [formula.diff(one) for one in v]
    rows = [[symbolic.settled(p.diff(one)) for one in v] for p in momenta]
    mass = _matrix(rows)
    if mass is not None:
        _check_mass(mass, velocities, "")
    at_rest = dict.fromkeys(v, 0)
    moves_apart = mass is not None and all(symbolic.settled(p.subs(at_rest)) == 0 for p in momenta)
    if mass is not None and moves_apart:
        separated = _separate(names, q, t, -formula.subs(at_rest))
        if separated is not None:
            potential, force = separated
            return _Recognised(mass=mass, potential=potential, forcing=force)
    return _Recognised(general=compiled_lagrangian(names, formula))


def compiled_lagrangian(names: tuple[str, ...], formula: symbolic.Symbolic) -> Lagrangian:
    """The effect with all derivatives of `formula`."""
    q = [symbolic.symbol(name) for name in names]
    v = [symbolic.symbol(velocity_name(name)) for name in names]
    t = symbolic.symbol(TIME)
    momenta = [formula.diff(one) for one in v]
    forces = [formula.diff(one) for one in q]
    second = [
        [p.diff(one) for p in momenta for one in v],
        [p.diff(one) for p in momenta for one in q],
        [f.diff(one) for f in forces for one in q],
    ]
    return Lagrangian(
        coordinates=names,
        value=symbolic.compile_formulas([formula]),
        first=symbolic.compile_formulas([*momenta, *forces]),
        second=symbolic.compile_formulas([*momenta, *forces, *itertools.chain(*second)]),
        drift=symbolic.compile_formulas([p.diff(t) for p in momenta]),
        depends_on_time=bool(formula.has(t)),
        rate=symbolic.compile_formulas([formula.diff(t)]),
    )


def _with_stiffness(found: _Recognised, stiffness: Form) -> _Recognised:
    r"""What a Lagrangian consists of, less :math:`q^T K q / 2`."""
    if found.general is None:
        return replace(found, potential=with_stiffness(found.potential, stiffness))
    own = found.general.stiffness
    total = dense(stiffness) if own is None else own + dense(stiffness)
    return replace(found, general=replace(found.general, stiffness=total))


def _separate(
    names: tuple[str, ...],
    q: list[symbolic.Symbolic],
    t: symbolic.Symbolic,
    potential: symbolic.Symbolic,
) -> tuple[Potential | None, tuple[Expression, ...] | None] | None:
    """V(q) and f(t) with V(q) - f(t) q = `potential`; None where there are no such two."""
    if potential.has(t):
        potential = symbolic.multiplied_out(potential)
    timed, static = symbolic.terms_with(potential, t)
    force = [symbolic.settled(-timed.diff(one)) for one in q]
    if any(f.has(*q) for f in force):
        return None
    gradient = [static.diff(one) for one in q]
    hessian = [[symbolic.settled(g.diff(one)) for one in q] for g in gradient]
    stiffness = _matrix(hessian)
    result: Potential | None
    if stiffness is not None:
        origin = dict.fromkeys(q, 0)
        # what is linear in q is a constant force
        force = [f - symbolic.settled(g.subs(origin)) for f, g in zip(force, gradient, strict=True)]
        result = QuadraticPotential(stiffness=stiffness) if np.any(stiffness) else None
    else:
        result = ExpressionPotential(
            coordinates=names,
            energy_expression=symbolic.as_expression(static, names),
            gradient_expressions=tuple(symbolic.as_expression(one, names) for one in gradient),
            hessian_expressions=tuple(
                tuple(symbolic.as_expression(one, names) for one in row) for row in hessian
            ),
        )
    if all(f == 0 for f in force):
        return result, None
    return result, tuple(symbolic.as_expression(f, (TIME,)) for f in force)


def _matrix(rows: list[list[symbolic.Symbolic]]) -> Array | None:
    """The matrix of numbers, None if a variable is left in an entry."""
    values = [[symbolic.constant(entry) for entry in row] for row in rows]
    if any(value is None for row in values for value in row):
        return None
    matrix = np.array(values, dtype=float)
    # mixed derivatives may differ by round-off in the order of their factors
    return np.asarray(0.5 * (matrix + matrix.T))


def _check_mass(mass: Array, velocities: tuple[str, ...], where: str) -> None:
    missing = [v for v, row in zip(velocities, mass, strict=True) if not np.any(row)]
    eigenvalues = np.linalg.eigvalsh(mass)
    if not eigenvalues[0] > LEAST_MASS * max(abs(eigenvalues[-1]), 0.0):
        reason = f" ({', '.join(missing)} does not occur quadratically)" if missing else ""
        raise ValueError(
            f"lagrangian: the mass matrix d2L/dv2 is not positive definite{where}: its smallest "
            f"eigenvalue is {eigenvalues[0]:g}{reason}"
        )


def _check_start(potential: ExpressionPotential, position: Array) -> None:
    """The potential energy and its derivatives must be numbers where the motion begins."""
    for what, values in (
        ("the potential energy", potential.energy(position)),
        ("the force", potential.gradient(position)),
        ("the derivative of the force", potential.hessian(position)),
    ):
        if np.isfinite(values).all():
            continue
        # roots and logarithms of negative numbers are no real numbers here
        reason = "not a real number" if np.isnan(values).any() else "infinite"
        at = ", ".join(
            f"{name} = {value:g}"
            for name, value in zip(potential.coordinates, position, strict=True)
        )
        raise ValueError(f"lagrangian: {what} is {reason} at the initial position, {at}")


def _with(forcing: Forcing | None, own: tuple[Expression, ...] | None) -> Forcing | None:
    """The force that is given plus the one that L holds."""
    if own is None:
        return forcing
    if forcing is None:
        return Forcing(pieces=(ForcingPiece(components=own, until=math.inf),))
    pieces = []
    for piece in forcing.pieces:
        total = tuple(
            a.plus(b)
            if not isinstance(a, Expression)
            else a.plus(b)
            for a, b in zip(piece.components, own, strict=True)
        )
        pieces.append(ForcingPiece(components=total, until=piece.until))
    return Forcing(pieces=tuple(pieces))
