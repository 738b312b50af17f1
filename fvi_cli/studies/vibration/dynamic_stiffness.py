r"""The matrix of a linear scene at a complex frequency.

On :math:`q = v e^{st}` the equations of motion are :math:`T(s) v = \hat f` with

.. math:: T(s) = s^2 M + \sum_j g_j(s) D_j + K,

where :math:`g_j(s)` is :math:`s^{\gamma_j}` for a derivative, and the complex modulus for a
relaxation law. It is analytic except on the negative real axis, the branch cut of the memory.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import Form, SparseMatrix, as_csr, dense, negative_pivots
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.stability.determinants import log_determinants
from fvi_cli.mathematics.arrays import Array, ComplexArray

if TYPE_CHECKING:
    from scipy.sparse import csc_array

Symbol = Callable[[complex], complex]

SLOPE_STEP = 1e-5
"""Relative step of the central difference for the slopes of symbols."""

LARGEST_DENSE = 40
"""Degrees of freedom up to which sparse matrices are converted to dense ones."""

_MOST_ENTRIES = 2_000_000
"""Most entries of matrices that are in memory at a time."""


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
        self._symbols: list[Symbol] = [lambda s: s * s]
        self.forms = [scene.inertia.form]
        if isinstance(scene.potential, QuadraticPotential):
            self._symbols.append(lambda s: 1.0)
            self.forms.append(scene.potential.form)
        self._symbols += [one.symbol for one in scene.active_forces]
        self.forms += [one.form for one in scene.active_forces]
        self.is_sparse = scene.is_sparse and scene.dimension > LARGEST_DENSE
        # maximum row sums, which dense and sparse matrices both have
        sums = [abs(cast(Array, form)).sum(axis=1) for form in self.forms]
        self.norms = np.array([np.asarray(one).max() for one in sums])
        if self.is_sparse:
            self._indices, self._indptr, self._entries = _on_one_pattern(self.forms)
        else:
            self._entries = np.stack(list(map(dense, self.forms)))

    @property
    def mass(self) -> Form:
        """M."""
        return self.forms[0]

    @property
    def is_small(self) -> bool:
        """Whether the whole plane of complex frequencies is looked at."""
        return self.dimension <= LARGEST_DENSE

    def symbols(self, s: complex) -> ComplexArray:
        """The factors s^2, g_j(s) and 1 of the matrices, shape ``(number of matrices,)``."""
        return np.array([symbol(s) for symbol in self._symbols], dtype=complex)

    def symbols_over(self, s: ComplexArray) -> ComplexArray:
        """The factors at n values of s, shape ``(n, number of matrices)``."""
        found = [np.broadcast_to(symbol(cast(complex, s)), s.shape) for symbol in self._symbols]
        return np.stack(found, axis=-1).astype(complex)

    def slopes(self, s: complex) -> ComplexArray:
        """Derivatives of the factors by s."""
        step = SLOPE_STEP * abs(s)
        return (self.symbols(s + step) - self.symbols(s - step)) / (2.0 * step)

    def combined(self, factors: ComplexArray) -> ComplexArray | SparseMatrix:
        """The sum of the matrices times these factors; sparse where the scene is."""
        entries = self._entries.reshape(len(self.forms), -1)
        total = (factors.real @ entries + 1j * (factors.imag @ entries)).reshape(
            self._entries.shape[1:]
        )
        if not self.is_sparse:
            return total
        from scipy.sparse import csc_array

        shape = (self.dimension, self.dimension)
        whole = csc_array((total, self._indices, self._indptr), shape=shape)
        return cast(SparseMatrix, whole)

    def at(self, s: complex) -> ComplexArray | SparseMatrix:
        """T(s)."""
        return self.combined(self.symbols(s))

    def log_determinants(self, s: ComplexArray) -> ComplexArray:
        """Logarithms of det T(s) up to a constant, any branch, at values of s of shape ``(n,)``.

        Minus infinity where it is 0.
        """
        if self.is_sparse:
            return np.array([self._log_determinant(complex(one)) for one in s])
        # scale rows and columns by each coordinate's own mass: graded matrices would lose digits
        d = self.dimension
        unit = 1.0 / np.sqrt(np.diagonal(self._entries[0]))
        entries = (unit[:, None] * self._entries * unit).reshape(len(self.forms), -1)
        parts = max(1, s.size * entries.shape[1] // _MOST_ENTRIES)
        found = []
        for some in np.array_split(s, parts):
            symbols = self.symbols_over(some)
            largest = np.abs(symbols).max(axis=1, keepdims=True)
            matrices = ((symbols / largest) @ entries).reshape(-1, d, d)
            found.append(log_determinants(matrices) + d * np.log(largest[:, 0]))
        return np.concatenate(found)

    def _log_determinant(self, s: complex) -> complex:
        try:
            return self.factors(s).log_determinant
        except np.linalg.LinAlgError:
            return complex(-np.inf)

    def number_below(self, rate: float) -> int:
        """Number of modes without damping that are slower than s = i `rate`.

        Returns the number of all modes if the elimination breaks down.
        """
        real = self.symbols(1j * rate).real.astype(complex)
        matrix = self.combined(real)
        if isinstance(matrix, np.ndarray):
            return int((np.linalg.eigvalsh(matrix.real) < 0).sum())
        # sparse arrays have a real part, but the type in the stubs does not
        real_part: SparseMatrix = matrix.real  # type: ignore[attr-defined]
        return negative_pivots(cast(SparseMatrix, as_csr(real_part)))

    def size(self, s: complex) -> float:
        """Sum of the sizes of the terms of T(s)."""
        return float(np.abs(self.symbols(s)) @ self.norms)

    def residual(self, s: complex, vector: ComplexArray) -> float:
        """Size of T(s) v relative to that of its terms: the backward error of an eigenpair."""
        left = np.asarray(self.at(s) @ vector)  # type: ignore[operator]
        return float(np.linalg.norm(left) / (self.size(s) * np.linalg.norm(vector)))

    def factors(self, s: complex) -> Factors:
        """T(s), factorised."""
        return Factors(self.at(s))


class Factors:
    """The LU factors of a complex matrix, dense or sparse; `solve` takes right-hand sides.

    Raises
    ------
    numpy.linalg.LinAlgError
        If it is singular to the last digit.
    """

    def __init__(self, matrix: ComplexArray | SparseMatrix) -> None:
        if isinstance(matrix, np.ndarray):
            from scipy.linalg import lu_factor, lu_solve

            with warnings.catch_warnings():
                # a singular matrix is reported below
                warnings.simplefilter("ignore")
                pair = lu_factor(matrix, check_finite=False)
            self._pivots = np.diagonal(pair[0])
            if not np.abs(self._pivots).min() > 0:
                raise np.linalg.LinAlgError("Singular matrix")
            rows = np.arange(pair[1].size)
            self._exchanges: Callable[[], int] = lambda: int((pair[1] != rows).sum())
            self.solve: Callable[[ComplexArray], ComplexArray] = lambda right: np.asarray(
                lu_solve(pair, right, check_finite=False)
            )
        else:
            from scipy.sparse.linalg import splu

            try:
                found = splu(cast("csc_array[np.complex128]", matrix))
            except RuntimeError as error:
                raise np.linalg.LinAlgError(str(error)) from error
            self._pivots = np.asarray(found.U.diagonal())
            self._exchanges = lambda: _exchanges(found.perm_r) + _exchanges(found.perm_c)
            self.solve = lambda right: np.asarray(found.solve(np.ascontiguousarray(right)))

    @property
    def log_determinant(self) -> complex:
        """Logarithm of the determinant, any branch."""
        return complex(np.log(self._pivots).sum()) + 1j * math.pi * (self._exchanges() % 2)


def _exchanges(permutation: NDArray[np.signedinteger[Any]]) -> int:
    """Number of exchanges that make a permutation: its size less its cycles."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    size = permutation.size
    graph = csr_array((np.ones(size), (np.arange(size), permutation)), shape=(size, size))
    cycles, _ = connected_components(graph)
    return int(size - cycles)


def _on_one_pattern(forms: Sequence[Form]) -> tuple[NDArray[np.int32], NDArray[np.int32], Array]:
    """Matrices on one common pattern by columns: row indices, ends of columns, entries of each."""
    from scipy.sparse import csc_array

    patterns = [abs(as_csr(form)).sign() for form in forms if form.nonzero()[0].size]
    whole = csc_array(sum(patterns[1:], patterns[0]))
    whole.sum_duplicates()
    rows = whole.indices
    columns = np.repeat(np.arange(whole.shape[1]), np.diff(whole.indptr))
    entries = [np.asarray(as_csr(form)[rows, columns]).ravel() for form in forms]
    return np.asarray(rows), np.asarray(whole.indptr), np.stack(entries)
