r"""The matrix of a linear scene at a complex frequency.

On :math:`q = v e^{st}` the equations of motion are :math:`T(s) v = \hat f` with

.. math:: T(s) = s^2 M + \sum_j g_j(s) D_j + K,

where :math:`g_j(s)` is :math:`s^{\gamma_j}` for a derivative, and the complex modulus for a
relaxation law. It is analytic except on the negative real axis, the branch cut of the memory.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import Form, as_csc, dense, factors_of
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.stability.determinants import log_determinants
from fvi_cli.mathematics.arrays import ComplexArray

Symbol = Callable[[Any], Any]
Solve = Callable[[ComplexArray], ComplexArray]
"""From right-hand sides, shape ``(d,)`` or ``(d, n)``, to solutions."""

SLOPE_STEP = 1e-5
"""Relative step of the central difference for the slopes of symbols."""

LARGEST_DENSE = 40
"""Degrees of freedom up to which sparse matrices are converted to dense ones."""


class DynamicStiffness:
    """T(s) of a linear scene.

    Raises
    ------
    ValueError
        If the scene is not linear.
    """

    def __init__(self, scene: Scene) -> None:
        if not scene.is_linear:
            raise ValueError("scene: it is not linear; it has neither modes nor harmonic responses")
        self.scene = scene
        self.dimension = scene.dimension
        self.is_small = scene.dimension <= LARGEST_DENSE
        self.is_sparse = scene.is_sparse and not self.is_small
        self._symbols: list[Symbol] = [lambda s: s * s]
        self.forms: list[Any] = [scene.inertia.form]
        if isinstance(scene.potential, QuadraticPotential):
            self._symbols.append(lambda s: 1.0)
            self.forms.append(scene.potential.form)
        self._symbols += [force.symbol for force in scene.active_forces]
        self.forms += [force.form for force in scene.active_forces]
        convert: Callable[[Form], Any] = as_csc if self.is_sparse else dense
        self.forms = list(map(convert, self.forms))
        # maximum row sums
        sums = [np.asarray(abs(form).sum(axis=1)) for form in self.forms]
        self.norms = np.array([rows.max() for rows in sums])

    def symbols(self, s: complex | ComplexArray) -> ComplexArray:
        """The factors s^2, 1 and g_j(s) of the n matrices, shape ``(*s.shape, n)``."""
        shape = np.shape(s)
        values = [np.broadcast_to(symbol(s), shape) for symbol in self._symbols]
        return np.stack(values, axis=-1).astype(complex)

    def slopes(self, s: complex) -> ComplexArray:
        """Derivatives of the factors by s."""
        step = SLOPE_STEP * abs(s)
        return (self.symbols(s + step) - self.symbols(s - step)) / (2.0 * step)

    def combined(self, factors: NDArray[Any]) -> Any:
        """The sum of the matrices times these factors; sparse where the scene is."""
        return sum(factor * form for factor, form in zip(factors, self.forms, strict=True))

    def solver(self, s: complex) -> Solve:
        """The inverse of T(s).

        Raises
        ------
        numpy.linalg.LinAlgError
            By it or by its function, if T(s) is singular to the last digit.
        """
        matrix = self.combined(self.symbols(s))
        if not self.is_sparse:
            return lambda right: np.asarray(np.linalg.solve(matrix, right))
        factors = factors_of(matrix)
        return lambda right: np.asarray(factors.solve(np.ascontiguousarray(right, complex)))

    def log_determinants(self, s: ComplexArray) -> ComplexArray:
        """Logarithms of det T(s), any branch, at values of s of shape ``(n,)``.

        Minus infinity where it is 0.
        """
        if self.is_small:
            return log_determinants(np.tensordot(self.symbols(s), np.stack(self.forms), axes=1))
        return np.array([self._log_determinant(complex(at)) for at in s])

    def _log_determinant(self, s: complex) -> complex:
        matrix = self.combined(self.symbols(s))
        if not self.is_sparse:
            return complex(log_determinants(matrix))
        try:
            # with pivots on the diagonal rows and columns are exchanged in the same way
            pivots = factors_of(matrix, least_pivot=0.0).U.diagonal()
        except np.linalg.LinAlgError:
            return complex(-np.inf)
        return complex(np.log(pivots).sum())

    def residual(self, s: complex, vector: ComplexArray) -> float:
        """Size of T(s) v relative to that of its terms: the backward error of an eigenpair."""
        symbols = self.symbols(s)
        left, size = self.combined(symbols) @ vector, np.abs(symbols) @ self.norms
        return float(np.linalg.norm(left) / (size * np.linalg.norm(vector)))
