"""Functions of the integration matrix of a mesh, in as many digits as they need."""

from collections.abc import Callable
from functools import cache

import mpmath as mp
import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.memory.stages import StageOperator, stage_operator

Array = NDArray[np.float64]

_DIGITS = 40
_APART = 24


def gauss_method(m: int) -> tuple[mp.matrix, list[mp.mpf], list[mp.mpf]]:
    """Matrix, weights and nodes of the Gauss method in the working precision."""
    starts = np.polynomial.legendre.leggauss(m)[0].tolist()
    nodes = [
        (1 + mp.findroot(lambda x: mp.legendre(m, x), (start, start + 1e-9))) / 2
        for start in starts
    ]
    # exact for all powers below m
    moments = mp.inverse(mp.matrix([[c**k for k in range(m)] for c in nodes]))
    matrix = mp.matrix([[c ** (k + 1) / (k + 1) for k in range(m)] for c in nodes]) * moments
    ones = mp.matrix([[mp.mpf(1) / (k + 1) for k in range(m)]]) * moments
    return matrix, list(ones), nodes


def _whole_hundreds(digits: int) -> int:
    """Few different precisions: eigenvectors are found once for each."""
    return -(-digits // 100) * 100


@cache
def _diagonalised(m: int, digits: int) -> tuple[list[mp.mpf], list[mp.mpc], mp.matrix, mp.matrix]:
    """Weights of the Gauss method; eigenvalues, eigenvectors and their inverse of its matrix."""
    with mp.workdps(digits):
        matrix, weights, _ = gauss_method(m)
        values, vectors = mp.eig(matrix)
        return weights, values, vectors, mp.inverse(vectors)


def mesh_power(steps: Array, m: int, theta: float) -> Array:
    """The matrix ``I^theta`` of the mesh with these steps, shape ``(N m, N m)``."""
    return mesh_function(steps, m, lambda value: value ** mp.mpf(theta))


def mesh_function(steps: Array, m: int, function: Callable[[mp.mpc], mp.mpc]) -> Array:
    """An analytic function of the matrix I of the mesh with these steps, shape ``(N m, N m)``.

    In the eigenvectors of A the matrix is lower triangular, and Parlett's recurrence (Higham,
    *Functions of Matrices*, section 4.6) has its functions. Steps that are equal are taken apart by
    parts in 10^24, and the digits that the recurrence loses to that are added.
    """
    n = len(steps)
    equal = max(int(np.sum(np.abs(steps - h) < 1e-6 * h)) for h in steps)
    digits = _whole_hundreds(_DIGITS + 4 * m + 2 * n + _APART * equal)
    with mp.workdps(digits):
        weights, values, vectors, inverse = _diagonalised(m, digits)
        h = [mp.mpf(float(s)) * (1 + k * mp.mpf(10) ** -_APART) for k, s in enumerate(steps)]
        ones = [mp.fsum(inverse[i, j] for j in range(m)) for i in range(m)]
        rows = [mp.fsum(weights[i] * vectors[i, j] for i in range(m)) for j in range(m)]
        diagonal = [h[k] * values[i] for k in range(n) for i in range(m)]
        size = n * m
        entry = [
            [ones[i % m] * h[j // m] * rows[j % m] if j // m < i // m else mp.mpf(0)
             for j in range(size)]
            for i in range(size)
        ]  # fmt: skip
        power = [[mp.mpf(0)] * size for _ in range(size)]
        for i in range(size):
            power[i][i] = function(diagonal[i])
        for gap in range(1, size):
            for j in range(size - gap):
                i = j + gap
                if i // m == j // m:
                    continue
                total = entry[i][j] * (power[i][i] - power[j][j])
                # blocks on the diagonal are diagonal
                inner = range((j // m + 1) * m, (i // m) * m)
                total += mp.fsum(
                    power[i][k] * entry[k][j] - entry[i][k] * power[k][j] for k in inner
                )
                power[i][j] = total / (diagonal[i] - diagonal[j])
        result = np.empty((size, size))
        for row in range(n):
            for column in range(n):
                block = mp.matrix(m)
                for i in range(m):
                    for j in range(m):
                        block[i, j] = power[row * m + i][column * m + j]
                result[row * m : row * m + m, column * m : column * m + m] = _rounded(
                    vectors * block * inverse
                )
        return result


def _rounded(matrix: mp.matrix) -> Array:
    return np.array(
        [[float(mp.re(matrix[i, j])) for j in range(matrix.cols)] for i in range(matrix.rows)]
    )


def meshes(n: int) -> dict[str, Array]:
    """Steps of one mesh of each kind, n of them."""
    random = np.random.default_rng(3)
    return {
        "uniform": np.full(n, 0.37),
        "random": 10.0 ** random.uniform(-3.2, 0.0, n),
        "alternating": np.tile([1.0, 0.01], -(-n // 2))[:n],
        "geometric": 10.0 ** np.linspace(-8.0, 0.0, n),
    }


def gauss_operator(n_stages: int) -> StageOperator:
    """The Gauss method with so many stages."""
    return stage_operator("gauss", n_stages)
