"""Exact solutions with relaxation laws, against inversions in many digits."""

import mpmath as mp
import numpy as np
import pytest
from letters import spring
from oracles.contour import talbot_inverse

from fvi_cli.effects.laws.cole_cole import ColeCole, fractional_maxwell, fractional_zener
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.laws.prony import prony
from fvi_cli.effects.laws.tempered import TemperedPower, tempered
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.linear_response import match_scene

ZENER = fractional_zener(order=0.675, time=0.3, relaxed=2.0, unrelaxed=7.0, coefficient=1.0)
NARROW = fractional_zener(order=0.97, time=0.3, relaxed=2.0, unrelaxed=7.0, coefficient=1.0)
SLOW = fractional_zener(order=0.6, time=5.0, relaxed=1.0, unrelaxed=40.0, coefficient=1.0)
MAXWELL = fractional_maxwell(order=0.5, time=0.2, modulus=5.0, coefficient=1.0)
PRONY = prony(moduli=[1.0, 0.5], times=[0.1, 1.0], coefficient=1.0, relaxed=2.0)
TEMPERED = tempered(order=0.5, rate=3.0, coefficient=0.7)
STRONG = tempered(order=0.5, rate=40.0, coefficient=20.0)
TIMES = np.array([1e-3, 0.7, 3.0])


def scene(*laws: Law, damping: tuple[tuple[float, float], ...] = (), push: str = "") -> Scene:
    return spring(*damping, T=12.0, m=1.5, x=1.0, v=0.5, laws=laws, forcing=push or None)


def modulus(law: Law, s: mp.mpc) -> mp.mpc:
    kernel, size = law.kernel, mp.mpf(law.size) * mp.mpf(law.coefficient[0, 0])
    if isinstance(kernel, ColeCole):
        power = (s * mp.mpf(kernel.time)) ** mp.mpf(kernel.order)
        return size * power / (1 + power)
    if isinstance(kernel, TemperedPower):
        return size * s * (s + mp.mpf(kernel.rate)) ** (mp.mpf(kernel.order) - 1)
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
        ([TEMPERED], []),
        ([TEMPERED, PRONY], [(1.0, 0.2)]),
        ([ZENER, MAXWELL], [(1.5, 0.2)]),
    ],
    ids=["zener", "narrow", "slow", "maxwell", "prony", "tempered", "shifted", "sum"],
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


def test_laws_without_common_powers_have_no_exact_solution():
    assert match_scene(scene(ZENER, TEMPERED)) is None
    assert match_scene(scene(TEMPERED, push="sqrt(t)")) is None


@pytest.mark.parametrize("rate", [0.3, 10.0, 30.0, 100.0, 1000.0])
def test_a_tempered_law_of_any_rate_has_its_exact_solution_or_none(rate):
    one = scene(tempered(order=0.5, rate=rate, coefficient=1.0))
    exact = match_scene(one)
    run = integrate(one, Method(cq="gauss", degree=6, start="graded"), 64)
    if rate > 50:
        # its residues would cancel
        assert exact is None
    if exact is not None:
        np.testing.assert_allclose(exact.position(run.time), run.position, atol=1e-11)


def test_residues_that_would_cancel_are_refused():
    assert match_scene(scene(STRONG)) is None


def test_modes_of_proportional_laws_are_found():
    matrix = np.array([[2.0, -1.0], [-1.0, 1.0]])
    law = fractional_zener(order=0.5, time=0.3, relaxed=2.0, unrelaxed=7.0, coefficient=matrix)
    one = spring(T=3.0, m=np.eye(2), k=np.zeros((2, 2)), x=[1.0, 0.0], v=[0.0, 0.5], laws=(law,))
    run = integrate(one, Method(cq="gauss", degree=5, start="graded"), 40)
    np.testing.assert_allclose(match_scene(one).position(run.time), run.position, atol=1e-12)
