"""The oracle of linear scenes, residues and branch cuts, against inversions and other forms."""

import dataclasses
import math

import mpmath as mp
import numpy as np
import pytest
from letters import in_pieces, spring, swing
from oracles.characteristic import characteristic_terms, characteristic_zeros
from oracles.closed_forms import half_order_response
from oracles.contour import talbot_inverse
from oracles.fractional_oscillator import contour_response
from oracles.linear_response import linear_response, match_scene
from oracles.powers import Powers
from spread import spread

import fvi_cli as fvi
from fvi_cli.effects.laws.cole_cole import ColeCole

T = Powers.variable()
TIMES = np.array([1e-3, 0.7, 3.0, 15.0])
LAWS = {
    "none": [],
    "zener": [fvi.fractional_zener(order=0.675, time=0.3, relaxed=2, unrelaxed=7, coefficient=1)],
    "narrow": [fvi.fractional_zener(order=0.97, time=0.3, relaxed=2, unrelaxed=7, coefficient=1)],
    "maxwell": [fvi.fractional_maxwell(order=0.5, time=0.2, modulus=5.0, coefficient=1.0)],
    "prony": [fvi.prony(moduli=[1.0, 0.5], times=[0.1, 1.0], coefficient=1.0, relaxed=2.0)],
}


def modulus(law, s):
    kernel, size = law.kernel, mp.mpf(law.size)
    if isinstance(kernel, ColeCole):
        power = (s * mp.mpf(kernel.time)) ** mp.mpf(kernel.order)
        return size * power / (1 + power)
    return size * mp.fsum(mp.mpf(g) * s / (s + mp.mpf(rate)) for rate, g in kernel.masses)


def by_inversion(scene, push):
    """Under the force `push`."""
    stiffness = mp.mpf(scene.stiffness[0, 0])

    def transform(s):
        total = mp.fsum(modulus(law, s) for law in scene.laws)
        start = 1.5 * (s + mp.mpf(0.5)) + total / s
        for term in scene.damping:
            own = mp.mpf(term.matrix[0, 0]) * s ** mp.mpf(term.order)
            total += own
            start += own / s + (own / s**2 * mp.mpf(0.5) if term.order > 1 else 0)
        return (start + mp.mpf(push) / s) / (1.5 * s * s + total + stiffness)

    return talbot_inverse(transform, list(TIMES), largest_frequency=8.0)


@pytest.mark.few(4)
@spread(name=LAWS, order=[0.05, 0.5, 0.97, 1.03, 1.5, 1.95], coefficient=[0.0, 0.05, 3.0])
def test_it_agrees_with_laplace_inversion(name, order, coefficient):
    damping = [(order, coefficient)] * (coefficient > 0)
    keys = {"T": 20.0, "m": 1.5, "k": 2.0, "x": 1.0, "v": 0.5, "laws": LAWS[name]}
    scene = spring(*damping, **keys, forcing="2")
    found = match_scene(scene).position(TIMES)[:, 0]
    np.testing.assert_allclose(found, by_inversion(scene, 2.0), rtol=0, atol=5e-14)


def test_a_wrong_pole_shows():
    terms = characteristic_terms(mass=1.0, stiffness=2.0, damping=((0.5, 0.7),))
    zeros, times = characteristic_zeros(terms), np.linspace(0.2, 20.0, 100)
    right = contour_response(terms, zeros, {1.0: 1.0, -0.5: 0.7}, times)
    wrong = tuple(dataclasses.replace(z, center=z.center * (1 + 1e-10)) for z in zeros)
    other = contour_response(terms, wrong, {1.0: 1.0, -0.5: 0.7}, times)
    assert np.abs(other - right).max() > 1e-11


@spread(order=[0.5, 1.5], coefficient=[0.01, 0.5, 1.0, 2.5, -0.3])
def test_half_orders_by_faddeeva_functions(coefficient, order):
    times = np.linspace(0.0, 20.0, 101)
    data = {"mass": 1.3, "stiffness": 25.0}
    expected, _ = half_order_response(
        order, times, **data, coefficient=coefficient, x0=0.9, v0=-0.4, step=2.0
    )
    damping, forcing = ((order, coefficient),), ((0.0, 0.0 * T + 2.0),)
    found = linear_response(**data, damping=damping, position=0.9, velocity=-0.4, forcing=forcing)
    assert found(times) == pytest.approx(expected, abs=2e-12 * np.abs(expected).max())


def test_modes_of_a_chain_and_pieces_are_superposed():
    stiffness = np.array([[2.0, -1.0], [-1.0, 2.0]])
    damping = 0.1 * np.eye(2) + 0.05 * stiffness
    start = {"x": [1.0, 0.0], "v": [0.0, 0.5]}
    chain = spring((0.7, damping), T=10.0, m=np.eye(2), k=stiffness, **start)
    times = np.linspace(0.0, 10.0, 33)
    modes = [
        linear_response(
            mass=1.0,
            stiffness=k,
            damping=((0.7, 0.1 + 0.05 * k),),
            position=0.5,
            velocity=0.25 * sign,
        )(times)
        for k, sign in ((1.0, 1.0), (3.0, -1.0))
    ]
    expected = np.stack([modes[0] + modes[1], modes[0] - modes[1]], axis=-1)
    assert match_scene(chain).position(times) == pytest.approx(expected, abs=1e-13)
    common = {"mass": 1.0, "stiffness": 2.0, "damping": ((0.5, 0.3),)}
    stopped = linear_response(**common, forcing=((0.0, T), (2.0, 0.0 * T + 2.0)))
    ramp = linear_response(**common, forcing=((0.0, T),))
    late = np.maximum(times - 2.0, 0.0)
    assert stopped(times) == pytest.approx(ramp(times) - ramp(late), abs=1e-13)


def test_caputo_and_riemann_liouville():
    common = {"mass": 1.0, "stiffness": 1.0, "damping": ((0.5, 1.0),), "position": 1.0}
    caputo, riemann = (
        linear_response(**common, derivative=one) for one in ("caputo", "riemann-liouville")
    )
    assert float(caputo(np.ones(1))[0]) == pytest.approx(0.612261785758467, abs=2e-15)
    # the difference is the known force -mu x0 t^(-1/2) / Gamma(1/2)
    forced = linear_response(**common, forcing=((0.0, T**-0.5 * (-1 / math.sqrt(math.pi))),))
    assert forced(TIMES) == pytest.approx(riemann(TIMES), abs=2e-14)
    assert np.abs(caputo(TIMES) - riemann(TIMES)).max() > 0.1


@pytest.mark.parametrize(
    "unknown",
    [
        swing(T=10.0),
        spring((0.5, 1.0), T=10.0, forcing="sin(t)"),
        spring(T=10.0, forcing=in_pieces("sqrt(t)", 1.0, "0")),
        spring((0.5, np.array([[1.0, 0.3], [0.3, 1.0]])), T=1, m=np.eye(2), k=np.diag([1.0, 2.0])),
    ],
)
def test_scenes_that_it_does_not_know(unknown):
    assert match_scene(unknown) is None
