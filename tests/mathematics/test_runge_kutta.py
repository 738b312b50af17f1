"""Runge-Kutta tableaux, their symbol, convolution quadrature weights and discrete operators.

References are computed with mpmath from tableaux made there in 50 digits: small n by Cauchy's
integral over a circle, large n by the double exponential rule, which shares neither nodes nor
tails with the code under test.
"""

from __future__ import annotations

from functools import cache

import mpmath as mp
import numpy as np
import pytest

from fvi_cli.mathematics.runge_kutta import (
    ButcherTableau,
    gauss_tableau,
    lobatto_iiic_tableau,
    radau_iia_tableau,
    tableau,
)
from fvi_cli.mathematics.runge_kutta_symbol import log_stability, symbol, symbol_power
from fvi_cli.mathematics.runge_kutta_weights import (
    exponential_sum,
    left_operator_rk,
    right_operator_rk,
    runge_kutta_weights,
)

FAMILIES = ("gauss", "radau-iia", "lobatto-iiic")
METHODS = [
    *[("gauss", m) for m in (1, 2, 3, 4)],
    *[("radau-iia", m) for m in (1, 2, 3)],
    *[("lobatto-iiic", m) for m in (2, 3, 4)],
]
THETAS = (-0.99, -0.9, -0.4, 0.01, 0.6, 0.9)


# --- reference arithmetic ----------------------------------------------------------------------


@cache
def reference_tableau(name: str, m: int) -> tuple[mp.matrix, mp.matrix, mp.matrix]:
    """A, b (column), c (column) in 50 digits, from the definitions."""
    with mp.workdps(60):

        def node_polynomial(c):
            t = 2 * c - 1
            if name == "gauss":
                return mp.legendre(m, t)
            if name == "radau-iia":
                return mp.legendre(m, t) - mp.legendre(m - 1, t)
            # (1 - t^2) P'_{m-1} up to a factor
            return mp.legendre(m, t) - mp.legendre(m - 2, t)

        guesses = tableau(name, m).c
        # The end points are roots; a search that starts on them has nothing to do.
        c = mp.matrix(
            [
                mp.mpf(float(g))
                if g in (0.0, 1.0)
                else mp.findroot(node_polynomial, (float(g), float(g) * (1 + 1e-6)))
                for g in guesses
            ]
        )
        powers = mp.matrix(m, m)
        integrals = mp.matrix(m, m)
        moments = mp.matrix(1, m)
        for k in range(m):
            moments[k] = mp.mpf(1) / (k + 1)
            for i in range(m):
                powers[i, k] = c[i] ** k
                integrals[i, k] = c[i] ** (k + 1) / (k + 1)
        b = moments * powers**-1
        if name == "lobatto-iiic":
            for i in range(m):
                powers[i, m - 1] = mp.mpf(i == 0)
                integrals[i, m - 1] = b[0]
        return integrals * powers**-1, b.T, c


def to_array(matrix: mp.matrix) -> np.ndarray:
    return np.array(
        [[float(mp.re(matrix[i, j])) for j in range(matrix.cols)] for i in range(matrix.rows)]
    )


@cache
def cauchy_weights(
    name: str, m: int, exponents: tuple[float, ...], n_weights: int = 12
) -> dict[float, np.ndarray]:
    """Taylor coefficients of ``Delta(z)^exponent``: 48 points on a circle; 1e-30 of aliasing."""
    points = 48
    with mp.workdps(50):
        A, b, _ = reference_tableau(name, m)
        update = mp.ones(m, 1) * b.T
        radius = mp.mpf(10) ** (-mp.mpf(30) / points)
        sums = {e: [mp.zeros(m) for _ in range(n_weights)] for e in exponents}
        for k in range(points // 2 + 1):
            z = radius * mp.expjpi(mp.mpf(2) * k / points)
            values, vectors = mp.eig((A + z / (1 - z) * update) ** -1)
            inverse = vectors**-1
            share = mp.mpf(1 if k in (0, points // 2) else 2) / points
            for e in exponents:
                power = vectors * mp.diag([v ** mp.mpf(e) for v in values]) * inverse
                for n in range(n_weights):
                    sums[e][n] += share * z**-n * power
        return {e: np.array([to_array(w) for w in sums[e]]) for e in exponents}


def integral_weights(
    name: str, m: int, theta: float, wanted: tuple[int, ...], step: float = 1 / 48
) -> dict[int, np.ndarray]:
    """``w_n`` for n >= 1 by the double exponential rule ``x = exp(pi/2 sinh s)`` in 34 digits."""
    with mp.workdps(34):
        A, b, _ = reference_tableau(name, m)
        values, vectors = mp.eig(A)
        inverse = vectors**-1
        left, right = inverse * mp.ones(m, 1), b.T * vectors
        exponent = mp.mpf(theta)
        lower = mp.asinh(mp.mpf(150) / mp.pi / min(1 + exponent, 1))
        upper = mp.asinh(mp.mpf(150) / mp.pi / min(1 - exponent, 1))
        sums = {n: mp.zeros(m) for n in wanted}
        for k in range(int((lower + upper) / step) + 1):
            s = k * mp.mpf(step) - lower
            x = mp.exp(mp.pi / 2 * mp.sinh(s))
            factors = [1 / (1 + x * v) for v in values]
            column = [
                mp.re(mp.fsum(vectors[i, j] * factors[j] * left[j] for j in range(m)))
                for i in range(m)
            ]
            row = [
                mp.re(mp.fsum(right[j] * factors[j] * inverse[j, i] for j in range(m)))
                for i in range(m)
            ]
            stability = 1 - x * mp.fsum(b[i] * column[i] for i in range(m))
            scale = x ** (exponent + 1) * mp.pi / 2 * mp.cosh(s) * step
            product = mp.matrix(column) * mp.matrix([row])
            for n in wanted:
                sums[n] += scale * stability ** (n - 1) * product
        return {n: to_array(-mp.sin(mp.pi * exponent) / mp.pi * sums[n]) for n in wanted}


def relative_error(weight: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(weight - reference).max() / np.abs(reference).max())


# --- tableaux ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "m"), [*METHODS, *[(n, m) for n in FAMILIES for m in (5, 7, 10)]])
def test_tableaux_agree_with_fifty_digits(name, m):
    A, b, c = reference_tableau(name, m)
    made = tableau(name, m)
    assert np.abs(made.A - to_array(A)).max() < 1e-15
    assert np.abs(made.b - to_array(b)[:, 0]).max() < 1e-15
    assert np.abs(made.c - to_array(c)[:, 0]).max() < 1e-15


def test_tableaux_printed_in_hairer_and_wanner():
    """Tables 5.2, 5.5, 5.13 of Solving Ordinary Differential Equations II, section IV.5."""
    r = np.sqrt(3) / 6
    gauss = gauss_tableau(2)
    np.testing.assert_allclose(gauss.A, [[1 / 4, 1 / 4 - r], [1 / 4 + r, 1 / 4]], atol=2e-16)
    radau = radau_iia_tableau(2)
    np.testing.assert_allclose(radau.A, [[5 / 12, -1 / 12], [3 / 4, 1 / 4]], atol=2e-16)
    lobatto = lobatto_iiic_tableau(3)
    np.testing.assert_allclose(
        lobatto.A,
        [[1 / 6, -1 / 3, 1 / 6], [1 / 6, 5 / 12, -1 / 12], [1 / 6, 2 / 3, 1 / 6]],
        atol=2e-16,
    )
    np.testing.assert_allclose(lobatto_iiic_tableau(2).A, [[0.5, -0.5], [0.5, 0.5]], atol=1e-16)


@pytest.mark.parametrize("m", [2, 3, 4, 7])
def test_orders_stage_orders_and_values_at_infinity(m):
    gauss, radau, lobatto = gauss_tableau(m), radau_iia_tableau(m), lobatto_iiic_tableau(m)
    assert [t.order for t in (gauss, radau, lobatto)] == [2 * m, 2 * m - 1, 2 * m - 2]
    assert [t.stage_order for t in (gauss, radau, lobatto)] == [m, m, m - 1]
    assert [t.R_infinity for t in (gauss, radau, lobatto)] == [(-1) ** m, 0, 0]
    # symplectic: b_i a_ij + b_j a_ji = b_i b_j; only Gauss is
    for method, expected in ((gauss, True), (radau, False), (lobatto, False)):
        weighted = method.b[:, None] * method.A
        defect = np.abs(weighted + weighted.T - np.outer(method.b, method.b)).max()
        assert bool(defect < 1e-15) is expected


@pytest.mark.parametrize("name", FAMILIES)
def test_a_tableau_that_claims_too_much_is_refused(name):
    good = tableau(name, 3)
    fields = {"name": name, "A": good.A, "b": good.b, "c": good.c}
    ButcherTableau(**fields, order=good.order, stage_order=good.stage_order)
    with pytest.raises(ValueError, match=rf"B\({good.order + 1}\)"):
        ButcherTableau(**fields, order=good.order + 1, stage_order=good.stage_order)
    with pytest.raises(ValueError, match=rf"C\({good.stage_order + 1}\)"):
        ButcherTableau(**fields, order=good.order, stage_order=good.stage_order + 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"A": np.eye(2) * 0.5 + 1e-12}, r"C\(1\)"),
        ({"b": np.array([0.5, 0.5 + 1e-12])}, r"B\(1\)"),
        ({"b": np.array([1.0, 0.0])}, "must not be zero"),
        ({"A": np.full((2, 2), 0.25)}, "singular"),
        ({"A": np.eye(3)}, "shapes"),
        ({"c": np.array([0.5, np.nan])}, "finite"),
        ({"order": 0}, "at least 1"),
    ],
)
def test_a_broken_tableau_is_refused(change, message):
    fields = {
        "name": "halves",
        "A": np.eye(2) * 0.5,
        "b": np.array([0.5, 0.5]),
        "c": np.array([0.5, 0.5]),
        "order": 1,
        "stage_order": 1,
    }
    ButcherTableau(**fields)
    with pytest.raises(ValueError, match=message):
        ButcherTableau(**(fields | change))


def test_tableaux_are_immutable_and_names_and_stages_are_checked():
    with pytest.raises(ValueError, match="read-only"):
        gauss_tableau(2).A[0, 0] = 1.0
    for build, m in ((gauss_tableau, 0), (radau_iia_tableau, 0), (lobatto_iiic_tableau, 1)):
        with pytest.raises(ValueError, match="stages; permitted are"):
            build(m)
    with pytest.raises(ValueError, match="22 stages"):
        gauss_tableau(22)
    with pytest.raises(ValueError, match="not one of gauss, radau-iia, lobatto-iiic"):
        tableau("lobatto-iiia", 2)


# --- stability function and symbol -------------------------------------------------------------


@pytest.mark.parametrize(("name", "m"), [*METHODS, ("gauss", 7), ("lobatto-iiic", 7)])
def test_log_stability_keeps_its_relative_accuracy_near_one(name, m):
    points = np.array([1e-20, 1e-8, 1e-3, 0.7, 1.0, 3.0, 30.0, 1e4, 1e12, 1e20])
    signs, logarithms = log_stability(tableau(name, m), points)
    A, b, _ = reference_tableau(name, m)
    with mp.workdps(60):
        for x, sign, logarithm in zip(points, signs, logarithms, strict=True):
            solution = mp.lu_solve(mp.eye(m) + mp.mpf(x) * A, mp.ones(m, 1))
            exact = 1 - mp.mpf(x) * (b.T * solution)[0]
            if abs(exact) > 0.5 or x > 10:
                assert sign == mp.sign(exact)
                error = mp.mpf(float(logarithm)) - mp.log(abs(exact))
                assert abs(error) < 2e-15 * abs(mp.log(abs(exact)))
            else:
                assert abs(float(sign * np.exp(logarithm)) - exact) < 5e-16


def test_log_stability_at_its_zero_at_infinity_and_for_strangers():
    signs, logarithms = log_stability(gauss_tableau(1), [0.0, 2.0, np.inf])
    assert signs.tolist() == [1.0, 1.0, -1.0]
    assert logarithms.tolist() == [0.0, -800.0, 0.0]
    for name in ("radau-iia", "lobatto-iiic"):
        assert log_stability(tableau(name, 3), np.inf)[1] == -800.0
    with pytest.raises(ValueError, match="at least 0"):
        log_stability(gauss_tableau(1), [-1.0])
    # a diagonally implicit method is none of the three families
    stranger = ButcherTableau(
        name="sdirk", A=[[0.25, 0], [0.5, 0.25]], b=[0.5, 0.5], c=[0.25, 0.75],
        order=2, stage_order=1,
    )  # fmt: skip
    with pytest.raises(ValueError, match="sdirk: the stability function"):
        runge_kutta_weights(stranger, 0.5, 4)


@pytest.mark.parametrize(("name", "m"), METHODS)
def test_symbol_is_the_inverse_of_its_definition(name, m):
    method = tableau(name, m)
    z = np.array([[0.3, -0.8, 0.5j], [0.9 + 0.1j, -0.95, 0.0]])
    product = symbol(method, z) @ (method.A + (z / (1 - z))[..., None, None] * method.b)
    assert np.abs(product - np.eye(m)).max() < 5e-13
    if method.R_infinity != 1:
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
    delta = symbol(gauss_tableau(2), z)
    root = symbol_power(gauss_tableau(2), 0.5, z)
    assert np.abs(root @ root - delta).max() < 1e-13
    values, vectors = np.linalg.eig(delta)
    naive = vectors @ np.diag(values**0.5) @ np.linalg.inv(vectors)
    assert np.abs(naive @ naive - delta).max() > 1e-11


def test_symbol_power_refuses_the_pole_and_bad_exponents():
    with pytest.raises(ValueError, match="z = 1"):
        symbol_power(gauss_tableau(3), -0.5, [0.5, 1.0])
    with pytest.raises(ValueError, match="finite"):
        symbol_power(gauss_tableau(2), np.nan, 0.5)
    # |R(infinity)| = 1 puts a pole on the unit circle: at 1 for even m, at -1 for odd m
    for m, pole in ((2, 1.0), (3, -1.0)):
        with pytest.raises(ValueError, match="is a pole of the symbol"):
            symbol(gauss_tableau(m), [0.5, pole])
        assert np.all(np.isfinite(symbol(gauss_tableau(m), -pole)))


# --- weights -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "m"), METHODS)
def test_first_weights_agree_with_fifty_digits(name, m):
    references = cauchy_weights(name, m, (*THETAS, 0.6 + 1e-12))
    for theta in THETAS:
        weights = runge_kutta_weights(tableau(name, m), theta, 12)
        errors = [relative_error(w, r) for w, r in zip(weights, references[theta], strict=True)]
        assert max(errors) < 1.5e-14, (theta, errors)
    # control: an exponent wrong in the twelfth digit is seen
    weights = runge_kutta_weights(tableau(name, m), 0.6, 12)
    assert relative_error(weights[11], references[0.6 + 1e-12][11]) > 1e-13


@pytest.mark.parametrize(
    ("name", "m", "thetas"),
    [
        *[("gauss", m, (-0.99, -0.9, 0.01, 0.9)) for m in (1, 2, 3)],
        ("gauss", 4, (-0.99, 0.9)),
        ("radau-iia", 2, (-0.99, 0.5)),
        ("radau-iia", 3, (-0.5, 0.9)),
        ("lobatto-iiic", 2, (-0.9, 0.5)),
        ("lobatto-iiic", 3, (0.01, 0.9)),
    ],
)
def test_late_weights_agree_with_another_quadrature(name, m, thetas):
    wanted = (1, 7, 300, 20_000)
    for theta in thetas:
        references = integral_weights(name, m, theta, wanted)
        weights = runge_kutta_weights(tableau(name, m), theta, max(wanted) + 1)
        errors = [relative_error(weights[n], references[n]) for n in wanted]
        assert max(errors) < 1e-14, (theta, errors)


def test_midpoint_weights_are_the_expansion_of_the_trapezoidal_symbol():
    """``(2 (1-z)/(1+z))^theta`` by its recurrence ``(n+1) f_(n+1) = (n-1) f_(n-1) - 2 theta f_n``,
    from ``(1 - z^2) f' = -2 theta f``, in 50 digits."""
    n_weights = 20_001
    for theta in (-0.99, 0.3, 0.9):
        weights = runge_kutta_weights(gauss_tableau(1), theta, n_weights)[:, 0, 0]
        with mp.workdps(50):
            exponent = mp.mpf(theta)
            before, value = mp.mpf(0), mp.mpf(2) ** exponent
            reference = [float(value)]
            for n in range(n_weights - 1):
                before, value = value, ((n - 1) * before - 2 * exponent * value) / (n + 1)
                reference.append(float(value))
        errors = np.abs(weights / np.array(reference) - 1)
        # between the smooth and the alternating part a few weights nearly cancel
        assert np.quantile(errors, 0.99) < 1e-14
        assert errors.max() < 1e-13


def test_weights_printed_for_lobatto_iiic():
    """Public data of the authors of arXiv 2510.11082 (github.com/khaledharizb/RKCQ): order 1/2,
    two stages, step 1, in position form."""
    printed = [
        [[1.09868, 0.45509], [-0.45509, 1.09868]],
        [[-0.160899, -0.843533], [-0.0666464, -0.160899]],
        [[-0.0520062, -0.101991], [-0.0313018, -0.0520062]],
    ]
    half_digits = [5e-6, 5e-7, 5e-7]
    weights = runge_kutta_weights(lobatto_iiic_tableau(2), 0.5, 3)
    for weight, table, digit in zip(weights, printed, half_digits, strict=True):
        assert np.abs(weight - table).max() <= 1.01 * digit
    other = runge_kutta_weights(radau_iia_tableau(2), 0.5, 3)
    assert np.abs(other[0] - printed[0]).max() > 0.1


@pytest.mark.parametrize(("name", "m"), [("gauss", 2), ("gauss", 3), ("lobatto-iiic", 3)])
def test_orders_above_one_follow_from_the_velocity_form(name, m):
    """``Delta^1.5 = Delta Delta^0.5`` with ``Delta = A^-1 - sum_n R_inf^(n-1) z^n u v^T``."""
    method, n_weights = tableau(name, m), 12
    inverse = np.linalg.inv(method.A)
    delta = np.zeros((n_weights, m, m))
    delta[0] = inverse
    for n in range(1, n_weights):
        update = np.outer(inverse.sum(axis=1), method.b @ inverse)
        delta[n] = -(method.R_infinity ** (n - 1)) * update
    velocity = runge_kutta_weights(method, 0.5, n_weights)
    reference = cauchy_weights(name, m, (1.5,))[1.5]
    scale = np.abs(reference).max()
    for n in range(n_weights):
        position = sum(delta[k] @ velocity[n - k] for k in range(n + 1))
        assert np.abs(position - reference[n]).max() < 1e-13 * scale


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("m", [2, 5, 10, 21])
def test_weights_add_up_to_the_symbol_power(name, m):
    method, z = tableau(name, m), np.array([0.5, 0.9, -0.9, 0.7j, 0.6 + 0.6j])
    for theta in (-0.9, 0.4, 0.9):
        weights = runge_kutta_weights(method, theta, 1500)
        total = np.tensordot(z[:, None] ** np.arange(1500), weights, axes=1)
        expected = symbol_power(method, theta, z)
        assert np.abs(total - expected).max() < 2e-12 * np.abs(expected).max()


@pytest.mark.parametrize("theta", [-0.9, -0.4, 0.3, 0.9])
def test_first_weight_by_schur_and_pade(theta):
    from scipy.linalg import fractional_matrix_power

    for name in FAMILIES:
        method = tableau(name, 6)
        expected = fractional_matrix_power(method.A, -theta)
        assert relative_error(runge_kutta_weights(method, theta, 1)[0], expected) < 1e-12


def test_the_order_one_has_no_memory_and_its_neighbours_hardly_any():
    for name in FAMILIES:
        weights = runge_kutta_weights(tableau(name, 3), 0.0, 5)
        assert np.array_equal(weights[0], np.eye(3))
        assert not weights[1:].any()
        assert exponential_sum(tableau(name, 3), 0.0, 100).n_states == 0
        for theta in (-1e-9, 1e-9, 1e-17, -1e-17, 5e-324):
            near = runge_kutta_weights(tableau(name, 3), theta, 5)
            assert np.abs(near - weights).max() <= 20 * abs(theta) + 1e-15


@pytest.mark.parametrize("theta", [-1.0, 1.0, 1.5, -2.0, np.nan, np.inf])
def test_exponents_outside_the_open_interval_are_refused(theta):
    with pytest.raises(ValueError, match=r"theta: .* must lie in \(-1, 1\)"):
        runge_kutta_weights(gauss_tableau(2), theta, 4)
    with pytest.raises(ValueError, match=r"\(-1, 1\)"):
        exponential_sum(gauss_tableau(2), theta, 4)


def test_numbers_of_weights_are_checked():
    with pytest.raises(ValueError, match="n_weights: 0"):
        runge_kutta_weights(gauss_tableau(2), 0.5, 0)
    with pytest.raises(ValueError, match="n_steps: 0"):
        exponential_sum(gauss_tableau(2), 0.5, 0)
    with pytest.raises(ValueError, match="permitted are 1 to 11"):
        exponential_sum(gauss_tableau(2), 0.5, 10).weights(12)


# --- sum of exponentials -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "m"), [("gauss", 2), ("gauss", 3), ("radau-iia", 2), ("lobatto-iiic", 3)]
)
@pytest.mark.parametrize("theta", [-0.95, 0.5, 0.95])
def test_states_remember_what_the_convolution_sums(name, m, theta):
    """The states advanced step by step against the direct sum with weights made for other N."""
    n_steps = 700
    history = exponential_sum(tableau(name, m), theta, n_steps)
    weights = runge_kutta_weights(tableau(name, m), theta, 5 * n_steps)
    values = np.random.default_rng(1).standard_normal((n_steps, m))
    states = np.zeros(history.n_states)
    ratios = history.ratios
    scale = np.abs(weights[1:n_steps]).sum(axis=0).max()
    seen = []
    for k in range(n_steps - 1):
        states = ratios * states + history.rows @ values[k]
        if k % 99 == 0:
            direct = np.einsum("nij,nj->i", weights[1 : k + 2], values[k::-1])
            remembered = states @ history.columns
            assert np.abs(remembered - direct).max() < 2e-14 * scale
            # control: weights that are late by one step
            late = np.einsum("nij,nj->i", weights[2 : k + 3], values[k::-1])
            seen.append(float(np.abs(remembered - late).max()))
    assert min(seen) > 1e-6 * scale


@pytest.mark.parametrize("name", FAMILIES)
def test_the_two_tails_are_needed_and_where(name):
    theta_by_tail = {0: -0.95, -1: 0.95}
    for tail, theta in theta_by_tail.items():
        total = exponential_sum(tableau(name, 3), theta, 400)
        powers = total.powers(np.arange(400))
        weights = runge_kutta_weights(tableau(name, 3), theta, 401)[1:]
        terms = powers[:, tail, None, None] * np.outer(total.columns[tail], total.rows[tail])
        share = np.abs(terms).max(axis=(1, 2)) / np.abs(weights).max(axis=(1, 2))
        if tail == -1 and name != "gauss":
            # R vanishes at infinity: the tail is in w_1 and nowhere else
            assert share[0] > 1e-3
            assert not share[1:].any()
        else:
            assert share.min() > 1e-5
        summed = np.einsum("nj,ja,jb->nab", powers, total.columns, total.rows)
        assert max(map(relative_error, summed, weights)) < 1e-14


def test_weights_do_not_depend_on_how_many_are_made():
    few = runge_kutta_weights(gauss_tableau(3), 0.4, 300)
    many = runge_kutta_weights(gauss_tableau(3), 0.4, 100_000)
    assert max(map(relative_error, many[:300], few)) < 1e-14


# --- operators ---------------------------------------------------------------------------------


def inner_product(method: ButcherTableau, h: float, x: np.ndarray, y: np.ndarray) -> float:
    return float(h * np.sum(method.b[:, None] * x * y))


@pytest.mark.parametrize("name", FAMILIES)
def test_operators_agree_with_the_direct_sum(name):
    method, h, n = tableau(name, 3), 0.1, 40
    values = np.random.default_rng(2).standard_normal((n, 3, 2))
    weights = runge_kutta_weights(method, 0.6, n) * h**-0.6
    left, right = np.zeros_like(values), np.zeros_like(values)
    adjoint = np.diag(1 / method.b) @ np.swapaxes(weights, 1, 2) @ np.diag(method.b)
    for k in range(n):
        for lag in range(n):
            if lag <= k:
                left[k] += weights[lag] @ values[k - lag]
            if k + lag < n:
                right[k] += adjoint[lag] @ values[k + lag]
    scale = np.abs(left).max()
    assert np.abs(left_operator_rk(method, 0.6, h, values) - left).max() < 1e-14 * scale
    assert np.abs(right_operator_rk(method, 0.6, h, values) - right).max() < 1e-14 * scale


@pytest.mark.parametrize(("name", "m"), METHODS)
def test_semigroup(name, m):
    method, h = tableau(name, m), 0.05
    values = np.random.default_rng(3).standard_normal((300, m))
    for operator in (left_operator_rk, right_operator_rk):
        for first, second in ((0.25, 0.25), (0.45, 0.45), (0.8, -0.3), (-0.5, -0.4), (0.7, -0.7)):
            twice = operator(method, first, h, operator(method, second, h, values))
            once = operator(method, first + second, h, values)
            scale = max(np.abs(operator(method, second, h, values)).max(), np.abs(once).max())
            scale *= h**-first * np.abs(runge_kutta_weights(method, first, 1)).max()
            assert np.abs(twice - once).max() < 1e-12 * scale
            # control: another order
            wrong = operator(method, first + second + 1e-9, h, values)
            assert np.abs(twice - wrong).max() > 1e-12 * scale


@pytest.mark.parametrize(("name", "m"), METHODS)
@pytest.mark.parametrize("exponent", [-0.6, 0.25, 0.75])
def test_integration_by_parts(name, m, exponent):
    method, h = tableau(name, m), 0.02
    random = np.random.default_rng(4)
    x, y = random.standard_normal((2, 500, m, 2))
    left = left_operator_rk(method, exponent, h, x)
    right = right_operator_rk(method, exponent, h, y)
    scale = np.sqrt(inner_product(method, h, left, left) * inner_product(method, h, y, y))
    defect = inner_product(method, h, left, y) - inner_product(method, h, x, right)
    assert abs(defect) < 1e-14 * scale
    # controls: the retarded operator is not its own adjoint, and the weights b_i matter
    wrong = inner_product(method, h, x, left_operator_rk(method, exponent, h, y))
    assert abs(inner_product(method, h, left, y) - wrong) > 1e-4 * scale
    if m > 2 or (name, m) == ("radau-iia", 2):
        plain = h * np.sum(left * y) - h * np.sum(x * right)
        assert abs(plain) > 1e-4 * scale


@pytest.mark.parametrize("m", [2, 3, 5])
def test_the_adjoint_is_the_method_in_reversed_time(m):
    """Steps and stages reversed: so for Gauss and Lobatto IIIC, not for Radau IIA."""
    values = np.random.default_rng(5).standard_normal((200, m))
    for name, expected in (("gauss", True), ("radau-iia", False), ("lobatto-iiic", True)):
        method = tableau(name, m)
        adjoint = right_operator_rk(method, 0.4, 0.1, values)
        reversed_time = left_operator_rk(method, 0.4, 0.1, values[::-1, ::-1])[::-1, ::-1]
        defect = np.abs(adjoint - reversed_time).max() / np.abs(adjoint).max()
        assert bool(defect < 1e-14) is expected


@pytest.mark.parametrize(("name", "m"), [*METHODS, ("gauss", 6)])
def test_the_symbol_differentiates_polynomials_of_the_stage_order(name, m):
    """``Delta/h`` of stage values is the derivative at the stages up to degree q, by C(q)."""
    method, h = tableau(name, m), 0.25
    times = h * (np.arange(16)[:, None] + method.c)

    def defect(degree: int) -> float:
        position, velocity = times**degree, degree * times ** (degree - 1)
        derivative = left_operator_rk(method, 0.6, h, position)
        from_velocity = left_operator_rk(method, -0.4, h, velocity)
        return float(np.abs(derivative - from_velocity).max() / np.abs(from_velocity).max())

    for degree in range(1, method.stage_order + 1):
        assert defect(degree) < 1e-13
    if m < 6:
        assert defect(method.stage_order + 1) > 1e-9


@pytest.mark.parametrize(("name", "m"), METHODS)
def test_the_work_of_the_damping_is_positive(name, m):
    """<V, Delta^theta V> > 0 for every V != 0, by the smallest eigenvalue of the form."""
    method, n = tableau(name, m), 24
    for exponent in (-0.9, -0.5, 0.5, 0.9):
        weights = runge_kutta_weights(method, exponent, n)
        operator = np.zeros((n, m, n, m))
        for k in range(n):
            for past in range(k + 1):
                operator[k, :, past, :] = weights[k - past]
        plain = operator.reshape(n * m, n * m)
        weighted = np.tile(method.b, n)[:, None] * plain
        values = np.linalg.eigvalsh(weighted + weighted.T)
        assert values[0] > 1e-6 * values[-1]
        if m >= 3 and abs(exponent) == 0.9:
            # control: without the weights b_i the form is indefinite
            assert np.linalg.eigvalsh(plain + plain.T)[0] < 0


@pytest.mark.parametrize("operator", [left_operator_rk, right_operator_rk])
def test_operators_refuse_what_makes_no_sense(operator):
    values = np.ones((4, 2))
    with pytest.raises(ValueError, match="theta"):
        operator(gauss_tableau(2), 1.0, 0.1, values)
    for step_size in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="step_size"):
            operator(gauss_tableau(2), 0.5, step_size, values)
    for shape in ((4,), (4, 3), (0, 2)):
        with pytest.raises(ValueError, match="shape"):
            operator(gauss_tableau(2), 0.5, 0.1, np.ones(shape))
