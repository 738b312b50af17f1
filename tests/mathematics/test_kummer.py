"""Kummer's function against extended precision, in every way that it is computed."""

import mpmath
import numpy as np
import pytest

from fvi_cli.mathematics import kummer
from fvi_cli.mathematics.kummer import kummer_functions

ARGUMENTS = np.concatenate(([0.0, 1e-9, 1e-3], np.geomspace(0.1, 3000.0, 15)))


def exact(a: float, b: float, z: float) -> float:
    with mpmath.workdps(50):
        return float(mpmath.hyp1f1(mpmath.mpf(a), mpmath.mpf(b), -mpmath.mpf(z)))


@pytest.mark.parametrize("order", [0.01, 0.3, 0.95, 1.05, 1.5, 1.99])
@pytest.mark.parametrize("largest", [6.0, 43.0])
def test_the_functions_of_fractional_derivatives(order, largest):
    first = np.array([0.4, 1.0, 2.5, largest])
    second = first - order
    found = kummer_functions(first, second, ARGUMENTS)
    reference = [[exact(a, b, z) for z in ARGUMENTS] for a, b in zip(first, second, strict=True)]
    assert found == pytest.approx(np.array(reference), rel=1e-12)


def test_the_functions_of_what_caputo_subtracts():
    first, second = np.array([1.0, 1.0, 2.0]), np.array([1.7, 2.5, 1.5])
    reference = [[exact(a, b, z) for z in ARGUMENTS] for a, b in zip(first, second, strict=True)]
    assert kummer_functions(first, second, ARGUMENTS) == pytest.approx(
        np.array(reference), rel=1e-12
    )


def test_an_integer_difference_leaves_no_tail():
    # 1F1(a; a; -z) is the exponential, and 1F1(2; 1; -z) = (1 - z) e^-z
    z = np.array([0.5, 3.0, 20.0])
    found = kummer_functions(np.array([1.5, 2.0]), np.array([1.5, 1.0]), z)
    assert found == pytest.approx(np.array([np.exp(-z), (1 - z) * np.exp(-z)]), rel=1e-12)


def test_both_series_are_used_and_agree_where_they_meet(monkeypatch):
    first, second = np.array([0.5, 3.5]), np.array([0.2, 2.0])
    border = kummer._border(first, second)
    z = np.array([0.9 * border, 1.1 * border])
    mixed = kummer_functions(first, second, z)
    monkeypatch.setattr(kummer, "_border", lambda first, second: kummer.MOST_SUMMED)
    assert kummer_functions(first, second, z) == pytest.approx(mixed, rel=1e-12)
    monkeypatch.setattr(kummer, "_asymptotic", lambda *arguments: np.nan)
    assert np.isfinite(kummer_functions(first, second, z)).all()
    monkeypatch.setattr(kummer, "_border", lambda first, second: border)
    assert np.isnan(kummer_functions(first, second, z)[:, 1]).all()


def test_parameters_too_large_for_both_are_left_to_scipy():
    first = np.array([300.0])
    found = kummer_functions(first, first - 0.5, np.array([260.0]))
    assert found[0, 0] == pytest.approx(exact(300.0, 299.5, 260.0), rel=1e-6)


def test_nothing_gives_nothing():
    assert kummer_functions(np.empty(0), np.empty(0), ARGUMENTS).shape == (0, ARGUMENTS.size)
    assert kummer_functions(np.ones(2), np.ones(2), np.empty(0)).shape == (2, 0)
