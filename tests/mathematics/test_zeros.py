"""Zeros in a disc, counted."""

import numpy as np
import pytest

from fvi_cli.mathematics.zeros import (
    UNDECIDED,
    OneFunction,
    count_zeros,
)


def polynomial_with(zeros):
    def logarithm(z):
        with np.errstate(divide="ignore"):
            factors = np.subtract.outer(z, np.asarray(zeros, dtype=complex))
            return np.log(np.abs(factors)).sum(axis=-1) + 1j * np.angle(factors).sum(axis=-1)

    return logarithm


def number_of_zeros(logarithm, radius, degree=8):
    return count_zeros(OneFunction(logarithm, degree), radius)[0]


@pytest.mark.parametrize(
    ("zeros", "radius", "inside"),
    [
        ([0.5, -0.3, 2.0], 0.9, 2),
        ([0.9999999, 0.9999999, 1.0000001], 1 - 5e-8, 2),
        ([0.4 + 0.3j, 0.4 - 0.3j, 0.4 + 0.3j, 0.4 - 0.3j], 0.8, 4),
        ([0.4 + 0.3j, 0.4 - 0.3j], 0.4, 0),
        ([-0.99999, 0.2], 0.99, 1),
        ([1j * 0.99995, -1j * 0.99995, 1j * 1.00001, -1j * 1.00001], 0.9999, 0),
        ([1j * 0.99985, -1j * 0.99985, 1j * 1.00001, -1j * 1.00001], 0.9999, 2),
        ([0.0], 0.5, 1),
    ],
)
def test_zeros_are_counted(zeros, radius, inside):
    assert number_of_zeros(polynomial_with(zeros), radius) == inside


def test_a_zero_on_the_circle_is_not_counted():
    assert number_of_zeros(polynomial_with([0.5]), 0.5) == UNDECIDED


class Polynomials:
    """(z - a)(z - b) for pairs a, b."""

    degree = 8

    def __init__(self, pairs):
        self.pairs = np.array(pairs, dtype=complex)
        self.number = len(pairs)

    def tabulate(self, z):
        return z

    def logarithms(self, table, rows, numbers):
        with np.errstate(divide="ignore"):
            return np.log(table[rows][..., None] - self.pairs[numbers]).sum(axis=-1)


def test_zeros_of_many_functions_are_counted_together():
    # also pairs close to the circle, inside and outside, and one upon it
    near = 0.9 * np.exp(0.7j)
    pairs = [
        (0.1, 0.2),
        (0.95, -0.99),
        (0.5, 2.0),
        (near * 0.999, np.conj(near) * 0.999),
        (near * 1.001, np.conj(near) * 1.001),
        (0.89999, 0.90001),
        (0.9, 0.1),
    ]
    counts = count_zeros(Polynomials(pairs), 0.9)
    assert counts.tolist() == [2, 0, 1, 2, 0, 1, UNDECIDED]
