"""Runge-Kutta tableaux, their symbol, and the weights that other tests sum up with."""

import numpy as np
import pytest
from runge_kutta_symbol import at_infinity, symbol, symbol_power, tableau
from written_out import power_weights

FAMILIES = ("gauss", "lobatto-iiic")
METHODS = [
    *[("gauss", m) for m in (1, 2, 3, 4)],
    *[("lobatto-iiic", m) for m in (2, 3, 4)],
]


def test_tableaux_printed_in_hairer_and_wanner():
    """Tables 5.2, 5.5, 5.13 of Solving Ordinary Differential Equations II, section IV.5."""
    r = np.sqrt(3) / 6
    gauss = tableau("gauss", 2)
    np.testing.assert_allclose(gauss.A, [[1 / 4, 1 / 4 - r], [1 / 4 + r, 1 / 4]], atol=2e-16)
    lobatto = tableau("lobatto-iiic", 3)
    np.testing.assert_allclose(
        lobatto.A,
        [[1 / 6, -1 / 3, 1 / 6], [1 / 6, 5 / 12, -1 / 12], [1 / 6, 2 / 3, 1 / 6]],
        atol=2e-16,
    )
    np.testing.assert_allclose(tableau("lobatto-iiic", 2).A, [[0.5, -0.5], [0.5, 0.5]], atol=1e-16)


@pytest.mark.parametrize("m", [2, 3, 4, 7])
def test_orders_stage_orders_and_values_at_infinity(m):
    gauss, lobatto = tableau("gauss", m), tableau("lobatto-iiic", m)
    assert [t.order for t in (gauss, lobatto)] == [2 * m, 2 * m - 2]
    assert [t.stage_order for t in (gauss, lobatto)] == [m, m - 1]
    assert [at_infinity(t) for t in (gauss, lobatto)] == [(-1) ** m, 0]
    # symplectic: b_i a_ij + b_j a_ji = b_i b_j; only Gauss is
    for method, expected in ((gauss, True), (lobatto, False)):
        weighted = method.b[:, None] * method.A
        defect = np.abs(weighted + weighted.T - np.outer(method.b, method.b)).max()
        assert bool(defect < 1e-15) is expected


def defects(method, shift=0.0):
    """The largest defects of B(k) and of C(k), one more of each than the method claims."""
    c, b, A = method.c + shift, method.b, method.A
    rows = [A @ c ** (k - 1) - c**k / k for k in range(1, method.stage_order + 2)]
    sums = [b @ c ** (k - 1) - 1 / k for k in range(1, method.order + 2)]
    return np.abs(sums), np.abs(rows).max(axis=1)


@pytest.mark.parametrize("name", FAMILIES)
def test_all_tableaux_fulfil_what_they_claim(name):
    for m in range(1 + (name == "lobatto-iiic"), 22):
        method = tableau(name, m)
        sums, rows = defects(method)
        assert max(sums[:-1].max(), rows[:-1].max()) < 1e-13
        assert np.linalg.matrix_rank(method.A) == m
        assert np.all(method.b != 0)
        if m <= 4:
            # the control: no more than that, and not by other nodes
            assert min(sums[-1], rows[-1]) > 1e-7
            assert defects(method, 1e-12)[1][0] > 5e-13


@pytest.mark.parametrize(("name", "m"), METHODS)
def test_symbol_is_the_inverse_of_its_definition(name, m):
    method = tableau(name, m)
    z = np.array([[0.3, -0.8, 0.5j], [0.9 + 0.1j, -0.95, 0.0]])
    product = symbol(method, z) @ (method.A + (z / (1 - z))[..., None, None] * method.b)
    assert np.abs(product - np.eye(m)).max() < 5e-13
    if at_infinity(method) != 1:
        # the symbol at z = 1 is finite, and does not see constants
        assert np.abs(symbol(method, 1.0) @ np.ones(m)).max() < 1e-12
    for exponent in (0.5, 1.5, -0.7):
        power = symbol_power(method, exponent, z)
        other = symbol_power(method, 1 - exponent, z)
        scale = np.abs(power).max() * np.abs(other).max()
        assert np.abs(power @ other - symbol(method, z)).max() < 1e-13 * scale
        assert np.abs(power @ other @ other - symbol(method, z)).max() > 1e-6 * scale


def test_symbol_power_where_two_eigenvalues_meet():
    q = 1 / np.sqrt(3) - 0.5
    z = q / (1 + q)
    delta = symbol(tableau("gauss", 2), z)
    root = symbol_power(tableau("gauss", 2), 0.5, z)
    assert np.abs(root @ root - delta).max() < 1e-13
    values, vectors = np.linalg.eig(delta)
    naive = vectors @ np.diag(values**0.5) @ np.linalg.inv(vectors)
    assert np.abs(naive @ naive - delta).max() > 1e-11


def test_weights_printed_for_lobatto_iiic():
    """Public data of the authors of arXiv 2510.11082 (github.com/khaledharizb/RKCQ): order 1/2,
    two stages, step 1, in position form."""
    printed = [
        [[1.09868, 0.45509], [-0.45509, 1.09868]],
        [[-0.160899, -0.843533], [-0.0666464, -0.160899]],
        [[-0.0520062, -0.101991], [-0.0313018, -0.0520062]],
    ]
    half_digits = [5e-6, 5e-7, 5e-7]
    weights = power_weights(tableau("lobatto-iiic", 2), 0.5, 3)
    for weight, table, digit in zip(weights, printed, half_digits, strict=True):
        assert np.abs(weight - table).max() <= 1.01 * digit
    other = power_weights(tableau("gauss", 2), 0.5, 3)
    assert np.abs(other[0] - printed[0]).max() > 0.1
