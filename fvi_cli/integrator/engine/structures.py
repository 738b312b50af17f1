r"""Large linear scenes: single steps by one factorisation for each step size.

Their matrices are dense or sparse, and the memory stores only what dampers act on. The matrix of a
step is a sum of Kronecker products of small matrices of the method and large ones of the scene. In
the eigenvectors in which all small ones are diagonal it decouples into complex equations of the
size of the scene. Of a conjugate pair one is solved.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from fvi_cli.effects.matrices import Form, Solve, as_csr, factors_of, form, times
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.step import Frame
from fvi_cli.integrator.memory.damping import Damping
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.arrays import Array, ComplexArray

LARGEST_DENSE = 256
"""A scene is large if a step has more unknowns."""
LARGEST_OFF_DIAGONAL = 1e-8  # of the largest entry; round-off, which the refinement corrects

Product = tuple[Array, Form]
"""A small matrix ``(s, s)`` of the method and a large one ``(d, d)`` of the scene."""


def is_structure(scenes: Sequence[Scene], method: Method) -> bool:
    """Whether this is one scene of large or sparse linear equations."""
    first, is_single = scenes[0], len(scenes) == 1
    is_large = first.is_sparse or first.dimension * method.degree > LARGEST_DENSE
    return is_single and first.is_linear and is_large


class Structure:
    """Constant mass and stiffness of one scene, ``(d, d)``."""

    is_linear, has_rates = True, False

    def __init__(self, scene: Scene) -> None:
        self.mass, self.stiffness = form(scene.inertia.form), None
        if isinstance(scene.potential, QuadraticPotential):
            self.stiffness = form(scene.potential.form)


class StructureStep:
    """A step of a structure; as :class:`fvi_cli.integrator.engine.step.DenseStep`."""

    def __init__(self, law: Structure, frame: Frame, damping: Damping | None) -> None:
        self._stiffness, self._h, unit = law.stiffness, frame.h, frame.unit
        s, h = unit.tables.degree, frame.h
        mass, stiff = (pairs.sum(axis=0).reshape(s, s) for pairs in (unit.pairs[0], unit.pairs[3]))
        products: list[Product] = [(mass, law.mass)]
        # from U to the change of the momentum by forces
        self._impulses: list[Product] = []
        if law.stiffness is not None:
            products.append((-h * h * stiff, law.stiffness))
            self._impulses.append((-h * h * unit.sums[1].sum(axis=0), law.stiffness))
        matrices = [] if damping is None else [damping.matrix_of(k) for k in damping.directions]
        for table, matrix in zip(frame.damp, matrices, strict=True):
            products.append((table[0, 0, :-1], matrix))
            self._impulses.append((table[0, 0].sum(axis=0), matrix))
        self._by_position = -h * unit.tables.test_weights.sum(axis=1)
        self.singular = np.zeros(1, dtype=bool)
        try:
            self._solve = solver_of(products)
        except np.linalg.LinAlgError:
            self.singular[:] = True
            self._solve = np.zeros_like

    def solve(self, x: Array | None, p: Array, loads: Array) -> tuple[Array, Array, Array]:
        """As :meth:`fvi_cli.integrator.engine.step.Step.solve`, for one case."""
        if x is not None and self._stiffness is not None:
            loads = loads + self._by_position[:, None] * times(x[0], self._stiffness)
        right = -loads[0, 0, :-1]
        right[0] -= p[0, 0]
        u = self._solve(right)
        dp = loads[0, 0].sum(axis=0)
        for small, large in self._impulses:
            dp += times(small @ u, large)
        return u[None, None], self._h * u[None, None, -1], dp[None, None]


def solver_of(products: Sequence[Product]) -> Solve:
    """A function that solves equations with a sum of Kronecker products, ``(s, d)`` to the same.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is singular.
    """
    inverse, large = np.linalg.inv(products[0][0]), [one for _, one in products]
    quotients = [inverse @ small for small, _ in products]
    values, vectors = np.linalg.eig(quotients[-1])
    to_modes = np.linalg.inv(vectors)
    in_modes = [to_modes @ one @ vectors for one in quotients]
    diagonals = [np.diagonal(one) for one in in_modes]
    if any(_is_coupled(one) for one in in_modes):
        return _solver_of_all_stages(products)
    kept = np.flatnonzero(values.imag >= 0)  # twice the real part stands for a conjugate pair
    to_kept = (to_modes @ inverse)[kept]
    from_kept = vectors[:, kept] * np.where(values[kept].imag > 0, 2.0, 1.0)
    solvers = [_factorised([one[k] for one in diagonals], large) for k in kept]

    def solve_once(right: Array) -> Array:
        solution = [one(row) for one, row in zip(solvers, to_kept @ right, strict=True)]
        return np.asarray((from_kept @ np.stack(solution)).real)

    def solve(right: Array) -> Array:
        solution = solve_once(right)
        residual = right - sum(small @ times(solution, one) for small, one in products)
        # eigenvectors of many stages lose digits, which one refinement recovers
        return np.asarray(solution + solve_once(residual))

    return solve


def _is_coupled(matrix: ComplexArray) -> bool:
    """Whether a matrix has more than round-off beside its diagonal."""
    beside = np.abs(matrix - np.diag(np.diagonal(matrix))).max()
    return bool(beside > LARGEST_OFF_DIAGONAL * np.abs(matrix).max())


def _solver_of_all_stages(products: Sequence[Product]) -> Solve:
    """As :func:`solver_of`, where stages do not decouple: samples at nodes, and from Gauss8 on."""
    from scipy.sparse import kron

    # the unknowns of one component are neighbours: the band of the large matrices stays narrow
    whole = [cast(Form, kron(as_csr(large), small, format="csr")) for small, large in products]
    solver = _factorised([1.0] * len(whole), whole)
    return lambda right: solver(right.T.ravel()).real.reshape(right.T.shape).T


def _factorised(factors: Sequence[complex], matrices: Sequence[Form]) -> Solve:
    """Solve equations with a complex combination of matrices."""
    whole: Any = sum(complex(k) * cast(Any, one) for k, one in zip(factors, matrices, strict=True))
    if isinstance(whole, np.ndarray):
        from scipy.linalg import lu_factor, lu_solve

        lu: Any = lu_factor(whole)
        if not np.abs(np.diagonal(lu[0])).min() > 0:
            raise np.linalg.LinAlgError("Singular matrix")
        return lambda right: np.asarray(lu_solve(lu, right))
    from scipy.sparse import csc_array

    factorised = factors_of(csc_array(whole))
    return lambda right: np.asarray(factorised.solve(right))
