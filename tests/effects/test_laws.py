"""Relaxation laws: their transforms against their spectra, and what they refuse."""

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from letters import spring
from spread import spread

from fvi_cli.effects.laws import fractional_maxwell, fractional_zener, prony

ZENER = {"order": 0.675, "time": 0.3, "relaxed": 2.0, "unrelaxed": 7.0, "coefficient": 1.0}
LAWS = {
    "zener": fractional_zener(**ZENER),
    "narrow": fractional_zener(**{**ZENER, "order": 0.97}),
    "maxwell": fractional_maxwell(order=0.5, time=0.2, modulus=5.0, coefficient=1.0),
    "prony": prony(moduli=[1.0, 0.5], times=[0.1, 1.0], coefficient=1.0, relaxed=2.0),
}


@spread(name=LAWS, s=[0.02, 3.0, 0.3 + 4.0j, 50.0j])
def test_the_transform_is_the_integral_over_the_spectrum(name, s):
    kernel = LAWS[name].kernel
    total = sum(weight / (s + rate) for rate, weight in kernel.masses)
    if kernel.peak is not None:

        def integrand(u: mp.mpf) -> mp.mpc:
            y = mp.exp(u)
            return mp.exp(float(kernel.log_density(np.array(float(u))))) / (s + y)

        # far away the density is a power, whose integral is the last value over the exponent
        low, high = kernel.order, -kernel.order
        places = [-60, -20, -5, -1, 0, 1, 2, 5, 20, 60]
        total = mp.quad(integrand, places)
        total += integrand(mp.mpf(-60)) / low + integrand(mp.mpf(60)) / (1 - high)
    assert complex(total) == pytest.approx(kernel.transform(s), rel=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_laws_store_and_dissipate_at_every_frequency(name):
    for frequency in np.geomspace(1e-6, 1e6, 40):
        modulus = LAWS[name].symbol(1j * frequency)
        assert modulus.real > 0
        assert modulus.imag > 0


def test_the_zener_law_goes_from_the_relaxed_to_the_unrelaxed_modulus():
    law = LAWS["zener"]
    assert law.symbol(1e-12) == pytest.approx(2.0, abs=1e-7)
    assert law.symbol(1e14) == pytest.approx(7.0, abs=1e-7)
    half = 2.0 + 5.0 / 2.0
    assert law.symbol(1 / 0.3) == pytest.approx(half)


def test_relaxed_moduli_become_stiffnesses_of_the_scene_once():
    matrix = np.array([[2.0, -1.0], [-1.0, 1.0]])
    law = fractional_zener(**{**ZENER, "coefficient": matrix})
    scene = spring(T=1.0, m=np.eye(2), k=3.0 * np.eye(2), x=[0.0, 0.0], v=[1.0, 1.0], laws=(law,))
    again = replace(scene)
    for one in (scene, again):
        np.testing.assert_array_equal(one.potential.stiffness, 3.0 * np.eye(2) + 2.0 * matrix)
        assert one.laws[0].relaxed == 0.0
        assert one.laws[0].symbol(4.0) == pytest.approx(law.symbol(4.0) - 2.0)
