"""All modes of a structure whose damping orders are fractions, from one polynomial in s**(1/q).

With s = z**q every term is a power of z, and the modes are eigenvalues of a companion matrix: no
starting values, no region, none lost. A relaxation modulus of order p/q is multiplied out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import mpmath
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

Matrix = NDArray[np.float64]
DIGITS = 40


@dataclass(frozen=True, kw_only=True)
class Zener:
    """The modulus (s tau)**a / (1 + (s tau)**a)."""

    order: Fraction
    time: float


Term = tuple[Fraction | Zener, Matrix]


def oscillating_modes(
    mass: Matrix, terms: Sequence[Term], *, largest_ratio: float = 0.995
) -> list[complex]:
    """The zeros s of the determinant, Im s > 0 and damping ratios below a largest, by modulus.

    Parameters
    ----------
    mass
        M, shape ``(d, d)``.
    terms
        Orders in [0, 2), 0 for the stiffness, or laws (one at most), with their matrices.
    """
    found: list[complex] = []
    whole, unit = _in_units_of_mass(mass, terms), np.eye(len(mass))
    for start in unpolished_modes(mass, terms):
        s = _polished(unit, whole, start)
        if s is None or s.imag <= 1e-6 * abs(s) or abs(s.real) > largest_ratio * abs(s):
            continue
        found.append(s)
    return sorted(found, key=abs)


def _in_units_of_mass(mass: Matrix, terms: Sequence[Term]) -> list[Term]:
    root = np.linalg.inv(np.linalg.cholesky(mass))
    return [(order, root @ matrix @ root.T) for order, matrix in terms if np.any(matrix)]


def unpolished_modes(mass: Matrix, terms: Sequence[Term]) -> list[complex]:
    """All zeros on the principal sheet to the accuracy of the companion matrix."""
    whole = _in_units_of_mass(mass, terms)
    mass = np.eye(len(mass))
    orders = [one.order if isinstance(one, Zener) else one for one, _ in whole]
    q = int(np.lcm.reduce([one.denominator for one in orders], initial=1))
    d = len(mass)
    rate = _usual_rate(mass, whole)
    coefficients = [np.zeros((d, d)) for _ in range(3 * q + 1)]
    law = next((one for one, _ in whole if isinstance(one, Zener)), None)

    def add(power: int, matrix: Matrix, is_law: bool = False) -> None:
        """A term in units of the usual rate, multiplied by 1 + (s tau)**a where there is a law."""
        if law is None:
            coefficients[power] += matrix
            return
        step, factor = int(law.order * q), (rate * law.time) ** float(law.order)
        if not is_law:
            coefficients[power] += matrix
        coefficients[power + step] += factor * matrix

    add(2 * q, mass)
    for order, matrix in whole:
        if isinstance(order, Zener):
            add(0, matrix / rate**2, is_law=True)
        else:
            add(int(order * q), matrix * rate ** (float(order) - 2))
    while not np.any(coefficients[-1]):
        coefficients.pop()
    n = len(coefficients) - 1
    left = np.zeros((n * d, n * d))
    right = np.eye(n * d)
    for k in range(n - 1):
        left[k * d : (k + 1) * d, (k + 1) * d : (k + 2) * d] = np.eye(d)
    for k in range(n):
        left[-d:, k * d : (k + 1) * d] = -coefficients[k]
    right[-d:, -d:] = coefficients[-1]
    values = eig(left, right, right=False)
    z = values[np.isfinite(values) & (np.abs(values) > 1e-12)]
    z = z[np.abs(np.angle(z)) < np.pi / q]
    return [complex(s) for s in rate * z**q]


def _usual_rate(mass: Matrix, terms: Sequence[Term]) -> float:
    """A frequency in whose unit the coefficients are of about one size."""
    powers = [(0.0 if isinstance(one, Zener) else float(one), matrix) for one, matrix in terms]
    logs = [
        np.log(np.linalg.norm(matrix) / np.linalg.norm(mass)) / (2 - power)
        for power, matrix in powers
        if power < 1.5
    ]
    return float(np.exp(np.mean(logs))) if logs else 1.0


def _polished(mass: Matrix, terms: Sequence[Term], start: complex) -> complex | None:
    """Newton's iteration for the determinant in many digits; None where it goes elsewhere."""
    with mpmath.workdps(DIGITS):
        forms = [(one, mpmath.matrix(matrix.tolist())) for one, matrix in terms]
        inertia = mpmath.matrix(mass.tolist())

        def determinant(s: mpmath.mpc) -> mpmath.mpc:
            total = s**2 * inertia
            for one, form in forms:
                if isinstance(one, Zener):
                    power = (s * one.time) ** (
                        mpmath.mpf(one.order.numerator) / one.order.denominator
                    )
                    total += power / (1 + power) * form
                else:
                    total += s ** (mpmath.mpf(one.numerator) / one.denominator) * form
            return mpmath.det(total)

        s = mpmath.mpc(start)
        for _ in range(30):
            shift = s * mpmath.mpf(10) ** (-DIGITS // 3)
            here = determinant(s)
            slope = (determinant(s + shift) - determinant(s - shift)) / (2 * shift)
            if slope == 0:
                break
            change = here / slope
            s -= change
            if abs(change) < 1e-20 * abs(s):
                break
        value = complex(s)
    return value if abs(value - start) < 0.05 * abs(start) else None
