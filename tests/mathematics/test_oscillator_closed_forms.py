import numpy as np
import pytest

from fvi_cli.mathematics.transforms.characteristic import (
    CharacteristicFunction,
    characteristic_zeros,
)
from fvi_cli.mathematics.transforms.fractional_oscillator import contour_response
from fvi_cli.mathematics.transforms.oscillator_closed_forms import (
    classical_response,
    faddeeva_response,
)

NUMERATOR = {1.0: 0.9, 0.0: -0.5, -1.0: 1.0, -3.0: 2.0}


@pytest.mark.parametrize("order", [0.5, 1.0, 1.5])
@pytest.mark.parametrize("coefficient", [0.01, 0.5, 2.5, 30.0, -0.3, -3.0])
@pytest.mark.parametrize("stiffness", [1.0, 0.0, 25.0, -0.5])
def test_closed_forms_agree_with_the_contour(order, coefficient, stiffness):
    characteristic = CharacteristicFunction(
        mass=1.3, stiffness=stiffness, damping=((order, coefficient),)
    )
    closed = classical_response if order == 1.0 else faddeeva_response
    numerator = {**NUMERATOR, order - 1.0: NUMERATOR.get(order - 1.0, 0.0) + 0.7 * coefficient}
    times = np.linspace(0.0, 20.0, 101)
    found = closed(characteristic, numerator, times)
    assert found is not None
    values, size = found
    contour = contour_response(
        characteristic, characteristic_zeros(characteristic), numerator, times
    )
    # SciPy promises 1e-13 for the Faddeeva function; the contour is good to round-off of itself.
    assert np.all(np.abs(values - contour) <= 1e-13 * size + 3e-14 * np.abs(contour).max())
    assert np.all(np.abs(values) <= size * (1 + 1e-15))


def test_classical_regimes_written_out():
    times = np.linspace(0.0, 12.0, 50)
    m, k, x0, v0 = 2.0, 3.0, 0.7, -1.1
    critical = 2 * np.sqrt(m * k)
    for c in (0.0, 0.3, critical, critical * (1 + 1e-9), critical * 0.99, 9.0, -0.2):
        a, d = c / (2 * m), k / m - (c / (2 * m)) ** 2
        root = np.sqrt(complex(d))
        cosine, sine = np.cos(root * times), times * np.sinc(root * times / np.pi)
        expected = (np.exp(-a * times) * (x0 * cosine + (v0 + a * x0) * sine)).real
        characteristic = CharacteristicFunction(mass=m, stiffness=k, damping=((1.0, c),))
        found = classical_response(characteristic, {1.0: m * x0, 0.0: m * v0 + c * x0}, times)
        assert found is not None
        assert found[0] == pytest.approx(expected, abs=1e-14 * np.abs(expected).max())


def test_falling_body_and_free_particle():
    times = np.linspace(0.0, 5.0, 11)
    free = CharacteristicFunction(mass=2.0)
    found = classical_response(free, {1.0: 2.0, 0.0: 4.0, -1.0: 6.0}, times)
    assert found is not None
    assert found[0] == pytest.approx(1.0 + 2.0 * times + 1.5 * times**2, rel=1e-15)
    braked = CharacteristicFunction(mass=2.0, damping=((1.0, 0.5),))
    found = classical_response(braked, {-1.0: 3.0}, times)
    assert found is not None
    assert found[0] == pytest.approx(6 * times - 24 * (1 - np.exp(-times / 4)), abs=1e-14)


def test_strong_damping_does_not_overflow():
    times = np.array([0.0, 1.0, 1e4])
    characteristic = CharacteristicFunction(mass=1.0, stiffness=1.0, damping=((1.0, 1e3),))
    found = classical_response(characteristic, {1.0: 1.0, 0.0: 1e3}, times)
    assert found is not None
    slow = 2 / (1e3 + np.sqrt(1e6 - 4))
    assert found[0][2] == pytest.approx(np.exp(-slow * 1e4) / (1 - slow**2), rel=1e-12)


def test_size_tells_of_cancellation():
    # Q(z) = z^4 - 4/3 z^3 + 1/3 has a double root at 1.
    near = CharacteristicFunction(mass=1.0, stiffness=1 / 3 + 1e-10, damping=((1.5, -4 / 3),))
    found = faddeeva_response(near, {0.0: 1.0}, np.array([1.0]))
    assert found is not None
    assert found[1][0] > 1e4 * abs(found[0][0])


def test_powers_that_do_not_fit():
    times = np.ones(1)
    classical = CharacteristicFunction(mass=1.0, stiffness=1.0, damping=((1.0, 1.0),))
    third = CharacteristicFunction(mass=1.0, stiffness=1.0, damping=((1 / 3, 1.0),))
    assert classical_response(third, {0.0: 1.0}, times) is None
    assert classical_response(classical, {-1.5: 1.0}, times) is None
    assert faddeeva_response(third, {0.0: 1.0}, times) is None
    assert faddeeva_response(classical, {-1.25: 1.0}, times) is None


def test_order_one_by_the_faddeeva_function():
    # P(z^2) is even: two routes for one classical oscillator.
    characteristic = CharacteristicFunction(mass=1.0, stiffness=3.0, damping=((1.0, 0.5),))
    times = np.linspace(0.0, 10.0, 21)
    first = classical_response(characteristic, NUMERATOR, times)
    second = faddeeva_response(characteristic, NUMERATOR, times)
    assert first is not None
    assert second is not None
    assert first[0] == pytest.approx(second[0], abs=1e-12 * np.abs(first[0]).max())
