"""Runge-Kutta tableaux, their symbol, and the weights that other tests sum up with."""

import numpy as np
import pytest
from runge_kutta_symbol import tableau
from written_out import power_weights

FAMILIES = ("gauss", "lobatto-iiic")


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
