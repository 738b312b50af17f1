import mpmath
import numpy as np
import pytest
from spread import spread

from fvi_cli.mathematics.transforms.characteristic import (
    characteristic_terms,
    characteristic_zeros,
)

# Zeros are polished in extended precision, where the platform has it.
ROUND_OFF = 1000 * float(np.finfo(np.longdouble).eps)


def function(stiffness, *damping, mass=1.0):
    return characteristic_terms(mass=mass, stiffness=stiffness, damping=damping)


def residual(characteristic, zero):
    terms = characteristic
    with mpmath.workdps(30):
        s = mpmath.mpc(str(zero.center.real), str(zero.center.imag))
        parts = [mpmath.mpf(c) * s ** mpmath.mpf(p) for p, c in terms]
        return float(abs(mpmath.fsum(parts)) / mpmath.fsum(abs(p) for p in parts))


@spread(order=[0.05, 0.5, 0.95, 1.25, 1.5, 1.8], coefficient=[0.01, 1.0, 30.0])
def test_positive_damping_has_one_conjugate_pair(order, coefficient):
    characteristic = function(2.0, (order, coefficient))
    zeros = characteristic_zeros(characteristic)
    # Overdamped and close to order 1 the pair lies near the cut, where it is not needed.
    assert len(zeros) <= 1
    for zero in zeros:
        assert not zero.is_real
        assert zero.multiplicity == 1
        assert zero.center.real < 0
        assert residual(characteristic, zero) < ROUND_OFF


def test_signs_decide_about_real_zeros():
    (zero,) = characteristic_zeros(function(-2.0, (0.5, 1.0)))[-1:]
    assert zero.is_real
    assert zero.center.real > 0
    growing = characteristic_zeros(function(0.0, (1.5, -2.0)))
    assert [float(z.center.real) for z in growing] == pytest.approx([4.0], rel=1e-15)


def test_quadratic_and_undamped():
    (zero,) = characteristic_zeros(function(4.0))
    assert complex(zero.center) == pytest.approx(2j, abs=1e-15)
    assert characteristic_zeros(function(0.0)) == ()
    roots = {float(zero.center.real) for zero in characteristic_zeros(function(2.0, (1.0, -3.0)))}
    assert sorted(roots) == pytest.approx([1.0, 2.0], rel=1e-15)


def test_nearly_double_zeros_on_the_positive_axis_are_one_cluster():
    # s^2 - 4/3 s^1.5 + 1/3 vanishes twice at 1.
    for change in (0.0, 1e-13, 1e-7, -1e-7, 1e-4):
        (cluster,) = characteristic_zeros(function(1 / 3 + change, (1.5, -4 / 3)))
        assert cluster.multiplicity == 2
        assert cluster.is_real
        assert float(cluster.center.real) == pytest.approx(1.0, abs=1e-3)
        assert cluster.radius < 0.05
    assert len(characteristic_zeros(function(1 / 3 - 0.05, (1.5, -4 / 3)))) == 2


def test_number_of_zeros_holds_over_many_functions():
    # The argument principle inside raises where a zero was missed.
    random = np.random.default_rng(7)
    for _ in range(60):
        damping = tuple(
            (random.uniform(0.001, 1.999), random.choice([-1, 1]) * 10 ** random.uniform(-4, 4))
            for _ in range(random.integers(1, 4))
        )
        stiffness = random.choice([-1.0, 0.0, 1.0]) * 10 ** random.uniform(-4, 6)
        for zero in characteristic_zeros(function(stiffness, *damping)):
            if zero.multiplicity == 1:
                assert residual(function(stiffness, *damping), zero) < ROUND_OFF


def test_terms_of_one_order_are_added():
    assert function(1.0, (0.5, 2.0), (0.5, -2.0)) == ((2.0, 1.0), (0.0, 1.0))
