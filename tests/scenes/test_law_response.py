"""Exact solutions with relaxation laws, against inversions in many digits."""

import mpmath as mp
import numpy as np
import pytest
from letters import spring
from oracles.contour import talbot_inverse

from fvi_cli.effects.laws.cole_cole import ColeCole, fractional_maxwell, fractional_zener
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.laws.prony import prony
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.linear_response import match_scene

ZENER = fractional_zener(order=0.675, time=0.3, relaxed=2.0, unrelaxed=7.0, coefficient=1.0)
NARROW = fractional_zener(order=0.97, time=0.3, relaxed=2.0, unrelaxed=7.0, coefficient=1.0)
SLOW = fractional_zener(order=0.6, time=5.0, relaxed=1.0, unrelaxed=40.0, coefficient=1.0)
MAXWELL = fractional_maxwell(order=0.5, time=0.2, modulus=5.0, coefficient=1.0)
PRONY = prony(moduli=[1.0, 0.5], times=[0.1, 1.0], coefficient=1.0, relaxed=2.0)
TIMES = np.array([1e-3, 0.7, 3.0])


def scene(*laws: Law, damping: tuple[tuple[float, float], ...] = (), push: str = "") -> Scene:
    return spring(*damping, T=12.0, m=1.5, x=1.0, v=0.5, laws=laws, forcing=push or None)


def modulus(law: Law, s: mp.mpc) -> mp.mpc:
    kernel, size = law.kernel, mp.mpf(law.size) * mp.mpf(law.coefficient[0, 0])
    if isinstance(kernel, ColeCole):
        power = (s * mp.mpf(kernel.time)) ** mp.mpf(kernel.order)
        return size * power / (1 + power)
    return size * mp.fsum(mp.mpf(g) * s / (s + mp.mpf(rate)) for rate, g in kernel.masses)


def by_inversion(one: Scene, push: mp.mpf | None = None) -> np.ndarray:
    """With a constant force where one is given."""
    mass, stiffness = 1.5, mp.mpf(one.potential.stiffness[0, 0])

    def transform(s: mp.mpc) -> mp.mpc:
        total = mp.fsum(modulus(law, s) for law in one.laws)
        start = mass * (s + mp.mpf(0.5)) + total / s
        for term in one.damping:
            own = mp.mpf(term.coefficient[0, 0]) * s ** mp.mpf(term.order)
            total += own
            start += own / s + (own / s**2 * mp.mpf(0.5) if term.order > 1 else 0)
        return (start + (push or 0) / s) / (mass * s * s + total + stiffness)

    return talbot_inverse(transform, list(TIMES), largest_frequency=8.0)


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("laws", "damping"),
    [
        ([ZENER], []),
        ([NARROW], []),
        ([SLOW], []),
        ([MAXWELL], []),
        ([PRONY], []),
        ([ZENER, MAXWELL], [(1.5, 0.2)]),
    ],
    ids=["zener", "narrow", "slow", "maxwell", "prony", "sum"],
)
def test_exact_solutions_are_those_of_the_inversion(laws, damping):
    one = scene(*laws, damping=tuple(damping))
    exact = match_scene(one)
    assert exact.source == "characteristic roots and branch-cut integral"
    np.testing.assert_allclose(exact.position(TIMES)[:, 0], by_inversion(one), rtol=0, atol=3e-14)


def test_a_force_acts_on_laws_too():
    one = scene(ZENER, push="2")
    expected = by_inversion(one, mp.mpf(2))
    np.testing.assert_allclose(match_scene(one).position(TIMES)[:, 0], expected, atol=3e-14)


def test_modes_of_proportional_laws_are_found():
    matrix = np.array([[2.0, -1.0], [-1.0, 1.0]])
    law = fractional_zener(order=0.5, time=0.3, relaxed=2.0, unrelaxed=7.0, coefficient=matrix)
    one = spring(T=3.0, m=np.eye(2), k=np.zeros((2, 2)), x=[1.0, 0.0], v=[0.0, 0.5], laws=(law,))
    run = integrate(one, Method(cq="gauss", degree=5, start="graded"), 40)
    np.testing.assert_allclose(match_scene(one).position(run.time), run.position, atol=1e-12)
