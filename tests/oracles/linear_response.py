"""Exact solutions of linear scenes with constant coefficients.

The displacement of such a scene is a sum of responses with transforms N(s)/P(s), one for the
initial data and the force at the start, and one for every jump of the force, shifted to the time of
the jump.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np

from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.laws.law import RelaxationKernel
from fvi_cli.effects.scene import Derivative, Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression

from .characteristic import (
    characteristic_terms,
    characteristic_zeros,
)
from .powers import Powers
from .relaxation import LinearResponse, law_response

ZERO: Final = Powers.constant(0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactSolution:
    """The position of a scene as a function of time."""

    # times of shape ``(n,)`` to positions ``(n, d)``; times must not be negative
    position: Callable[[Array], Array]


def linear_response(
    *,
    mass: float,
    stiffness: float,
    damping: tuple[tuple[float, float], ...] = (),
    position: float = 0.0,
    velocity: float = 0.0,
    forcing: tuple[tuple[float, Powers], ...] = (),
    derivative: Derivative = "caputo",
    laws: tuple[tuple[RelaxationKernel, float], ...] = (),
) -> LinearResponse:
    r"""Exact solution of one linear equation, m > 0.

    .. math:: X(s) = \frac{m (s x_0 + v_0) + \sum_j \mu_j (s^{\gamma_j-1} x_0
              [+ s^{\gamma_j-2} v_0 \text{ if } \gamma_j > 1]) + F(s)}{P(s)}

    with the terms of the sum for Caputo's derivative, and for order 1 in any case. With
    Riemann-Liouville derivatives a position other than 0 is only possible for orders up to 1.
    `damping` has pairs (order, coefficient), `laws` pairs (kernel, size), `forcing` pairs (start,
    f): the force is f(t), a finite sum of powers, from `start` until the next start; the first
    start is 0. The difference of two successive f must be a polynomial.

    Raises
    ------
    ValueError
        For parameters out of range, a force that is not representable, or a characteristic
        function whose zeros cannot be separated.
    """
    terms = characteristic_terms(mass=mass, stiffness=stiffness, damping=damping)
    start = {1.0: mass * position, 0.0: mass * velocity}
    for order, coefficient in damping:
        if derivative == "caputo" or order == 1.0:
            _add(start, order - 1.0, coefficient * position)
            if order > 1:
                _add(start, order - 2.0, coefficient * velocity)
        elif order > 1 and position and coefficient:
            raise ArgumentError(
                "derivative",
                f"riemann-liouville of order {order!r} needs position 0 at the start",
            )
    inputs: list[tuple[float, Mapping[float, float]]] = []
    before = ZERO
    for begin, force in forcing:
        jump = transform(shift_polynomial(force - before, begin))
        before = force
        if begin == 0:
            for power, coefficient in jump.items():
                _add(start, power, coefficient)
        else:
            inputs.append((begin, jump))
    inputs.insert(0, (0.0, {power: c for power, c in start.items() if c}))
    if laws:
        return law_response(terms, inputs, laws, position)
    return LinearResponse(
        terms=terms,
        inputs=tuple(inputs),
        position=position,
        zeros=characteristic_zeros(terms),
    )


def match_scene(scene: Scene) -> ExactSolution | None:
    r"""Exact solution of a scene if it is known; None otherwise.

    It is known for linear scenes whose mass, stiffness, damping and law matrices are diagonal in
    common coordinates, with any number of damping terms and any initial data, under a force whose
    components are sums of powers :math:`c\,t^\beta`, in pieces that differ by polynomials.
    """
    if not scene.is_linear or scene.is_sparse:
        return None
    d = scene.dimension
    terms, laws = scene.active_damping, scene.active_laws
    matrices = [scene.stiffness, *(force.matrix for force in (*terms, *laws))]
    modes = _common_modes(scene.inertia.mass, matrices)
    if modes is None:
        return None
    shapes, diagonals = modes
    momenta = shapes.T @ scene.inertia.mass
    position, velocity = momenta @ scene.initial_position, momenta @ scene.initial_velocity
    forcing: list[tuple[float, tuple[Powers, ...]]] = []

    def response_of(i: int, entries: list[Array]) -> LinearResponse:
        own = [float(diagonal[i]) for diagonal in entries]
        return linear_response(
            mass=1.0 if d > 1 else float(scene.inertia.mass[0, 0]),
            stiffness=own[0],
            damping=tuple((term.order, one) for term, one in zip(terms, own[1:], strict=False)),
            laws=tuple(
                (law.kernel, law.size * one)
                for law, one in zip(laws, own[1 + len(terms) :], strict=True)
                if one
            ),
            position=float(position[i]) if d > 1 else float(scene.initial_position[0]),
            velocity=float(velocity[i]) if d > 1 else float(scene.initial_velocity[0]),
            forcing=tuple((begin, _combined(shapes[:, i], force)) for begin, force in forcing),
            derivative=scene.derivative,
        )

    try:
        forcing += _finite_sums(scene.forcing)
        responses = tuple(response_of(i, diagonals) for i in range(d))
    except (ValueError, ArithmeticError):
        return None

    def exact(time: Array) -> Array:
        return np.stack([response(time) for response in responses], axis=-1) @ shapes.T

    return ExactSolution(position=exact)


def _add(numerator: dict[float, float], power: float, coefficient: float) -> None:
    numerator[power] = numerator.get(power, 0.0) + coefficient


def _common_modes(mass: Array, matrices: list[Array]) -> tuple[Array, list[Array]] | None:
    """Shapes S with S^T M S = 1 and all S^T A S diagonal; these diagonals; None: there is no S."""
    d = mass.shape[0]
    if d == 1:
        own = [matrix.diagonal().copy() for matrix in matrices]
        return np.ones((1, 1)), own
    scales, vectors = np.linalg.eigh(mass)
    root = vectors / np.sqrt(scales)
    reduced = [root.T @ matrix @ root for matrix in matrices]
    norms = [float(np.linalg.norm(matrix, 2)) for matrix in reduced]
    # Square roots of integers are not rationally related: equal eigenvalues of the mixture are
    # equal in every matrix.
    mixture = np.zeros((d, d))
    for index, (matrix, norm) in enumerate(zip(reduced, norms, strict=True)):
        if norm:
            mixture += np.sqrt(index + 2.0) * matrix / norm
    rotation = np.linalg.eigh(mixture)[1]
    diagonals: list[Array] = []
    for matrix, norm in zip(reduced, norms, strict=True):
        rotated = rotation.T @ matrix @ rotation
        diagonal = rotated.diagonal().copy()
        if np.abs(rotated - np.diag(diagonal)).max() > 1e-13 * d * norm:
            return None
        diagonal[np.abs(diagonal) < 4e-16 * d * norm] = 0.0
        diagonals.append(diagonal)
    return root @ rotation, diagonals


def shift_polynomial(force: Powers, start: float) -> Powers:
    """A polynomial in t, rewritten in powers of t - start; rounded once at the end."""
    if start == 0:
        return force
    if not all(e >= 0 and e == round(e) for e in force.exponents):
        raise ExpressionError(
            f"{force!r} is neither a polynomial nor a sum of powers about {start:g}"
        )
    sums: dict[int, Fraction] = {}
    for degree, coefficient in zip(map(int, force.exponents), force.coefficients, strict=True):
        for j in range(degree + 1):
            term = Fraction(coefficient) * math.comb(degree, j) * Fraction(start) ** (degree - j)
            sums[j] = sums.get(j, Fraction(0)) + term
    return Powers(
        exponents=np.array(list(sums), dtype=float),
        coefficients=np.array([float(value) for value in sums.values()]),
    )


def transform(force: Powers) -> dict[float, float]:
    r"""Laplace transform: :math:`t^\beta` becomes :math:`\Gamma(\beta+1) s^{-\beta-1}`."""
    if not all(-1 < exponent < 100 for exponent in force.exponents):
        raise ExpressionError(f"{force!r} has no Laplace transform in range")
    terms = zip(force.exponents.tolist(), force.coefficients.tolist(), strict=True)
    return {-exponent - 1.0: c * math.gamma(exponent + 1.0) for exponent, c in terms}


def _finite_sums(forcing: Forcing | None) -> list[tuple[float, tuple[Powers, ...]]]:
    """Pairs (begin, components) for the pieces of a force."""
    if forcing is None:
        return []
    if not all(isinstance(one, Expression) for one in forcing.components):
        raise ExpressionError("samples and functions are no formulas")
    variables = {"t": Powers.variable()}
    starts = (0.0, *forcing.break_points)
    return [
        (start, tuple(one.evaluate(variables) + ZERO for one in piece.components))
        for start, piece in zip(starts, forcing.pieces, strict=True)
    ]


def _combined(shape: Array, components: tuple[Powers, ...]) -> Powers:
    weighted = zip(shape, components, strict=True)
    return sum((component * float(weight) for weight, component in weighted), start=ZERO)
