"""Quadrature rules on [0, 1]."""

import mpmath as mp
import numpy as np
import pytest

from fvi_cli.mathematics.quadrature import gauss_rule, jacobi_rule, lobatto_rule

RULES = {"gauss": gauss_rule, "lobatto": lobatto_rule}
LEAST = {"gauss": 1, "lobatto": 2}
EVERY_RULE = [(name, n) for name in RULES for n in range(LEAST[name], 65)]


@pytest.mark.parametrize("name", RULES)
def test_moments_are_right_to_round_off_and_symmetry_is_exact(name):
    for n in range(LEAST[name], 65):
        rule = RULES[name](n)
        k = np.arange(rule.order)
        defects = rule.weights @ rule.nodes[:, None] ** k - 1 / (k + 1.0)
        assert np.abs(defects).max() < 1e-15, n
        assert np.all(np.diff(rule.nodes) > 0)
        assert rule.nodes[0] >= 0
        assert rule.nodes[-1] <= 1
        assert np.all(rule.weights > 0)
        assert rule.n_points == n
        symmetric = np.array_equal(1.0 - rule.nodes, rule.nodes[::-1])
        symmetric &= np.array_equal(rule.weights, rule.weights[::-1])
        assert symmetric
        if name == "lobatto":
            assert (rule.nodes[0], rule.nodes[-1]) == (0.0, 1.0)
        assert np.all(rule.nodes + rule.nodes[::-1] == 1.0)


@pytest.mark.parametrize(("name", "n"), [(name, n) for name, n in EVERY_RULE if n <= 6])
def test_order_is_sharp(name, n):
    rule = RULES[name](n)
    defect = rule.weights @ rule.nodes**rule.order - 1 / (rule.order + 1)
    assert abs(defect) > 1e-8
    assert rule.order == {"gauss": 2 * n, "lobatto": 2 * n - 2}[name]


@pytest.mark.parametrize("exponent", [-0.9, -0.5, 0.0, 0.7])
def test_weights_at_an_end(exponent):
    nodes, weights = jacobi_rule(20, exponent)
    for power in range(40):
        exact = float(mp.beta(power + 1, exponent + 1))
        assert weights @ nodes**power == pytest.approx(exact, rel=1e-13)
