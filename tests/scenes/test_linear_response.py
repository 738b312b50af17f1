"""Exact solutions of scenes against published and independently computed numbers."""

import math

import mpmath
import numpy as np
import pytest
from letters import in_pieces, spring, swing
from oracles.closed_forms import half_order_response
from spread import spread

from fvi_cli.effects.forcing import Forcing
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.powers import Powers
from fvi_cli.scenes.linear_response import (
    ZERO,
    linear_response,
    match_scene,
    shift_polynomial,
    transform,
)

T = Powers.variable()


@pytest.mark.parametrize(
    ("order", "expected", "relative"),
    [
        (0.5, [0.0561329416629, 0.0178323072601], 1e-11),
        (1.5, [-2.81851277911e-4, -8.92055356e-6], 1e-9),
    ],
)
def test_tail_is_algebraic(order, expected, relative):
    free = linear_response(mass=1.0, stiffness=1.0, damping=((order, 1.0),), position=1.0)
    assert free(np.array([100.0, 1000.0])) == pytest.approx(expected, rel=relative)
    leading = 1e6**-order / math.gamma(1 - order)
    assert free(np.array([1e6]))[0] == pytest.approx(leading, rel=1e-2)


def test_polynomial_solution_detects_wrong_initial_terms():
    times = np.linspace(0.0, 30.0, 61)
    common = {"mass": 1.0, "stiffness": 1.0, "damping": ((1.5, 1.0),), "velocity": 1.0}
    right = linear_response(**common, position=1.0, forcing=((0.0, 1.0 + T),))
    assert np.abs(right(times) - 1.0 - times).max() < 1e-13
    # The velocity's own term belongs to Caputo's derivative only.
    caputo = linear_response(**common, forcing=((0.0, T),))
    riemann = linear_response(**common, forcing=((0.0, T),), derivative="riemann-liouville")
    assert np.abs(caputo(times) - times).max() < 1e-13
    assert np.abs(riemann(times) - times).max() > 0.1


def test_jump_as_the_order_passes_one():
    def at_two(order):
        response = linear_response(mass=1.0, stiffness=1.0, damping=((order, 1.0),), velocity=1.0)
        return float(response(np.array([2.0]))[0])

    classical = math.exp(-1) * math.sin(math.sqrt(3)) / math.sqrt(0.75)
    assert at_two(1.0) == pytest.approx(classical, rel=1e-15)
    assert at_two(1.0 - 1e-9) == pytest.approx(classical, abs=1e-8)
    assert at_two(1.0) == pytest.approx(0.41928, abs=5e-6)
    assert at_two(1.0 + 1e-9) == pytest.approx(1.26871, abs=5e-6)
    # v0 = 1 in the damping term is a step force of the same size.
    step = linear_response(
        mass=1.0, stiffness=1.0, damping=((1.0, 1.0),), velocity=1.0, forcing=((0.0, ZERO + 1.0),)
    )
    assert at_two(1.0 + 1e-9) == pytest.approx(float(step(np.array([2.0]))[0]), abs=1e-8)


def test_caputo_and_riemann_liouville():
    values = [
        float(
            linear_response(
                mass=1.0, stiffness=1.0, damping=((0.5, 1.0),), position=1.0, derivative=derivative
            )(np.ones(1))[0]
        )
        for derivative in ("caputo", "riemann-liouville")
    ]
    assert values == pytest.approx([0.612261785758467, 0.0768387490366691], abs=2e-15)
    # The difference is the known force -mu x0 t^(-1/2) / Gamma(1/2).
    forced = linear_response(
        mass=1.0,
        stiffness=1.0,
        damping=((0.5, 1.0),),
        position=1.0,
        forcing=((0.0, T**-0.5 * (-1 / math.sqrt(math.pi))),),
    )
    assert forced(np.ones(1))[0] == pytest.approx(values[1], abs=2e-15)


def test_classical_damping_of_the_follow_up():
    # Hariz Belgacem, Jimenez, Ober-Bloebaum, arXiv 2510.11082: two uncoupled components.
    exact = match_scene(
        spring(
            (1.0, 0.25 * np.eye(2)),
            T=10.0,
            m=np.eye(2),
            k=0.5 * np.eye(2),
            x=[0.8, -0.5],
            v=[0.4, 0.0],
        )
    )
    t = np.linspace(0.0, 30.0, 97)
    w = math.sqrt(31) / 8
    root = math.sqrt(31)
    q1 = 4 / 155 * np.exp(-t / 8) * (31 * np.cos(w * t) + 5 * root * np.sin(w * t))
    q2 = -1 / 62 * np.exp(-t / 8) * (31 * np.cos(w * t) + root * np.sin(w * t))
    assert exact.position(t) == pytest.approx(np.stack([q1, q2], axis=-1), abs=2e-15)


@pytest.mark.parametrize(("order", "gamma_factor"), [(1.5, 15 / 8), (0.5, 15 / 16)])
def test_bagley_torvik_with_fractional_powers_in_the_force(order, gamma_factor):
    # x = t^(5/2): D^(3/2) x = 15/8 sqrt(pi) t, D^(1/2) x = 15/16 sqrt(pi) t^2.
    power = "t" if order == 1.5 else "t**2"
    text = f"15/4*sqrt(t) + {gamma_factor}*sqrt(pi)*{power} + t**2.5"
    exact = match_scene(spring((order, 1.0), T=10.0, forcing=text))
    t = np.linspace(0.0, 1.0, 65)
    assert exact.position(t)[:, 0] == pytest.approx(t**2.5, abs=1e-14)


def test_general_order_with_a_manufactured_solution():
    # x = t^(2.3) + t^4, order 0.7, mu = 0.4, k = 3.
    g = math.gamma
    first = 0.4 * g(3.3) / g(2.6)
    second = 0.4 * g(5) / g(4.3)
    text = f"2.99*t**0.3 + 12*t**2 + {first!r}*t**1.6 + {second!r}*t**3.3 + 3*(t**2.3 + t**4)"
    exact = match_scene(spring((0.7, 0.4), T=10.0, k=3.0, forcing=text))
    assert exact.source == "characteristic roots and branch-cut integral"
    t = np.linspace(0.0, 6.0, 61)
    expected = t**2.3 + t**4
    assert exact.position(t)[:, 0] == pytest.approx(expected, abs=3e-14 * expected.max())


def test_pieces_are_superposed():
    # A ramp that stops: the same force as t - (t - 2)_+ with its response shifted.
    common = {"mass": 1.0, "stiffness": 2.0, "damping": ((0.5, 0.3),)}
    stopped = linear_response(**common, forcing=((0.0, T), (2.0, ZERO + 2.0)))
    ramp = linear_response(**common, forcing=((0.0, T),))
    times = np.linspace(0.0, 9.0, 40)
    late = np.maximum(times - 2.0, 0.0)
    assert stopped(times) == pytest.approx(ramp(times) - ramp(late), abs=1e-13)
    with pytest.raises(ExpressionError):
        linear_response(**common, forcing=((0.0, T**0.5), (2.0, ZERO)))


def test_modes_of_a_chain():
    # Two masses, Rayleigh damping of fractional order: in phase and out of phase.
    stiffness = np.array([[2.0, -1.0], [-1.0, 2.0]])
    damping = 0.1 * np.eye(2) + 0.05 * stiffness
    exact = match_scene(
        spring(
            (0.7, damping),
            (1.4, 0.02 * np.eye(2)),
            T=10.0,
            m=np.eye(2),
            k=stiffness,
            x=[1.0, 0.0],
            v=[0.0, 0.5],
            forcing=Forcing.from_text("1", "t"),
        )
    )
    times = np.linspace(0.0, 10.0, 33)
    modes = [
        linear_response(
            mass=1.0,
            stiffness=k,
            damping=((0.7, 0.1 + 0.05 * k), (1.4, 0.02)),
            position=0.5,
            velocity=0.25 * sign,
            forcing=((0.0, 0.5 + 0.5 * sign * T),),
        )(times)
        for k, sign in ((1.0, 1.0), (3.0, -1.0))
    ]
    expected = np.stack([modes[0] + modes[1], modes[0] - modes[1]], axis=-1)
    assert exact.position(times) == pytest.approx(expected, abs=1e-13)


def test_unequal_masses_and_a_rigid_motion():
    mass = np.diag([1.0, 3.0])
    stiffness = np.array([[1.0, -1.0], [-1.0, 1.0]])
    exact = match_scene(spring(T=10.0, m=mass, k=stiffness, x=[1.0, 0.0], v=[0.0, 1.0]))
    times = np.linspace(0.0, 10.0, 21)
    position = exact.position(times)
    assert position @ [0.25, 0.75] == pytest.approx(0.25 + 0.75 * times, abs=1e-14)
    w = math.sqrt(4 / 3)
    assert position[:, 0] - position[:, 1] == pytest.approx(
        np.cos(w * times) - np.sin(w * times) / w, abs=1e-14
    )


@pytest.mark.parametrize(
    "unknown",
    [
        swing(T=10.0),
        spring((0.5, 1.0), T=10.0, forcing="sin(t)"),
        spring((0.5, 1.0), T=10.0, forcing="1/(1 + t)"),
        spring(T=10.0, forcing=in_pieces("sqrt(t)", 1.0, "0")),
        spring(
            (0.5, np.array([[1.0, 0.3], [0.3, 1.0]])), T=10.0, m=np.eye(2), k=np.diag([1.0, 2.0])
        ),
    ],
)
def test_unknown_scenes(unknown):
    assert match_scene(unknown) is None


CRITICAL = 2 * math.sqrt(6.0)


def test_growth_and_falling_written_out():
    # x'' - 3 x' + x = 0 and a braked fall, as elementary functions
    times = np.linspace(0.0, 20.0, 200)
    fast, slow = (3 + math.sqrt(5)) / 2, (3 - math.sqrt(5)) / 2
    growing = linear_response(mass=1.0, stiffness=1.0, damping=((1.0, -3.0),), position=0.7)
    expected = 0.7 * (fast * np.exp(slow * times) - slow * np.exp(fast * times)) / (fast - slow)
    assert np.abs(growing(times) / expected - 1.0).max() < 1e-13
    braked = linear_response(
        mass=2.0, stiffness=0.0, damping=((1.0, 0.5),), forcing=((0.0, ZERO + 3.0),)
    )
    assert braked(times) == pytest.approx(6 * times - 24 * (1 - np.exp(-times / 4)), abs=1e-12)


@pytest.mark.parametrize("coefficient", [0.0, 0.3, CRITICAL, CRITICAL * (1 + 1e-9), 9.0, 1e3, -0.2])
def test_classical_damping_written_out(coefficient):
    times = np.linspace(0.0, 12.0, 50)
    a, d = coefficient / 4, 1.5 - (coefficient / 4) ** 2
    # one formula for all signs of d, in extended precision: it cancels where damping is strong
    with mpmath.workdps(400):
        root = mpmath.sqrt(mpmath.mpc(d) if coefficient != CRITICAL else mpmath.mpf(10) ** -30)
        expected = [
            float(
                mpmath.re(
                    mpmath.exp(-a * t)
                    * (0.7 * mpmath.cos(root * t) + (-1.1 + a * 0.7) * mpmath.sin(root * t) / root)
                )
            )
            for t in map(mpmath.mpf, times)
        ]
    found = linear_response(
        mass=2.0, stiffness=3.0, damping=((1.0, coefficient),), position=0.7, velocity=-1.1
    )
    assert found(times) == pytest.approx(expected, abs=3e-14 * np.abs(expected).max())


@spread(order=[0.5, 1.5], coefficient=[0.01, 0.5, 1.0, 2.5, -0.3])
def test_half_orders_by_faddeeva_functions(coefficient, order):
    times = np.linspace(0.0, 20.0, 101)
    data = {"mass": 1.3, "stiffness": 25.0}
    expected, _ = half_order_response(
        order, times, **data, coefficient=coefficient, x0=0.9, v0=-0.4, step=2.0
    )
    found = linear_response(
        **data,
        damping=((order, coefficient),),
        position=0.9,
        velocity=-0.4,
        forcing=((0.0, ZERO + 2.0),),
    )
    assert found(times) == pytest.approx(expected, abs=2e-12 * np.abs(expected).max())


def test_critical_damping_under_a_fractional_power():
    # mpmath, invertlaplace (Talbot, 60 terms, 40 digits) of (s + 3 + F)/(s + 1)^2
    forcing = ((0.0, T**2.5 + 0.5 * T),)
    found = linear_response(
        mass=1.0, stiffness=1.0, damping=((1.0, 2.0),), position=1.0, velocity=1.0, forcing=forcing
    )
    values = found(np.linspace(0.0, 200.0, 301))
    assert values[[30, 150, 229, 300]] == pytest.approx(
        [1399.2172626079566, 95160.74522556031, 278760.93287130253, 551800.8563487692], rel=1e-14
    )


def test_refusals():
    with pytest.raises(ValueError, match="position 0"):
        linear_response(
            mass=1.0,
            stiffness=1.0,
            damping=((1.5, 1.0),),
            position=1.0,
            derivative="riemann-liouville",
        )
    response = linear_response(mass=1.0, stiffness=1.0)
    with pytest.raises(ValueError, match="negative"):
        response(np.array([-1.0]))


@pytest.mark.parametrize("order", [0.5, 0.7, 1.0, 1.5])
def test_what_grows_beyond_all_numbers_does_so_quietly(order):
    growing = linear_response(mass=1.0, stiffness=2.0, damping=((order, -3.0),), position=1.0)
    values = growing(np.array([0.0, 1e-300, 1.0, 1e5]))
    assert np.isfinite(values).tolist() == [True, True, True, False]
    assert values[:2] == pytest.approx([1.0, 1.0], rel=1e-14)


def read(text):
    value = Expression.parse(text, variables=("t",)).evaluate({"t": T})
    return ZERO + value


@pytest.mark.parametrize(
    ("text", "terms"),
    [
        ("8", {0.0: 8.0}),
        ("1 - t", {0.0: 1.0, 1.0: -1.0}),
        ("(1 + t)**2 / 4", {0.0: 0.25, 1.0: 0.5, 2.0: 0.25}),
        ("15/4*sqrt(t) + 15/8*sqrt(pi)*t", {0.5: 3.75, 1.0: 1.875 * math.sqrt(math.pi)}),
        ("t**(1/3) * t**(2/3)", {1.0: 1.0}),
        ("t**2.5 / (4*t)", {1.5: 0.25}),
        ("(4*t)**0.5", {0.5: 2.0}),
        ("2**3 * t - sin(1)", {1.0: 8.0, 0.0: -math.sin(1)}),
        ("cbrt(8*t**3)", {1.0: 2.0}),
        ("3 - t - (3 - t)", {}),
    ],
)
def test_sums_of_powers_are_read_off(text, terms):
    found = read(text)
    by_power = dict(zip(found.exponents.tolist(), found.coefficients.tolist(), strict=True))
    assert by_power == pytest.approx(terms, rel=1e-15)


@pytest.mark.parametrize("text", ["1/(1 + t)", "sqrt(1 + t)", "2**t", "(1+t)**-1"])
def test_what_leaves_the_sums_is_refused(text):
    with pytest.raises(ExpressionError):
        read(text)


def test_other_functions_are_not_there():
    with pytest.raises(ExpressionError, match="sin"):
        read("sin(t)")
    for text in ("abs(t - 1)", "sign(t)", "min(t, 2)"):
        with pytest.raises(ExpressionError, match="not available here"):
            read(text)


def test_shift_is_exact_for_polynomials_only():
    found = shift_polynomial(read("t**3 - 2*t"), 3.0)
    assert found.exponents.tolist() == [0, 1, 2, 3]
    assert found.coefficients.tolist() == [21, 25, 9, 1]
    # (t - 1)^24 about 1 is t^24 alone, although its coefficients are large.
    found = shift_polynomial(read("(t - 1)**24"), 1.0)
    assert (found.exponents.tolist(), found.coefficients.tolist()) == ([24.0], [1.0])
    with pytest.raises(ExpressionError):
        shift_polynomial(read("sqrt(t)"), 1.0)


def test_transform():
    assert transform(read("t**3 + 2")) == {-4.0: 6.0, -1.0: 2.0}
    with pytest.raises(ExpressionError):
        transform(read("1/t"))
