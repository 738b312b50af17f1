"""Zeros in a disc, the determinant of a step, and facts that are known of the methods."""

import dataclasses
import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from letters import oscillator, swing
from oracles.eigenvalues import unpolished_modes
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.stability.determinants import step_determinants
from fvi_cli.integrator.stability.limits import (
    LARGEST_N_STEPS,
    largest_stable_step,
    least_stable_n_steps,
    stable_method,
)
from fvi_cli.integrator.stability.linearisation import linearised_at_start
from fvi_cli.integrator.stability.modes import growing_frequencies, growing_modes
from fvi_cli.integrator.stability.patterns import step_patterns
from fvi_cli.integrator.stability.prediction import predict_stability
from fvi_cli.integrator.stability.systems import MatrixPencil, matrix_pencil
from fvi_cli.mathematics.transforms import zeros
from fvi_cli.mathematics.transforms.characteristic import (
    characteristic_terms,
    characteristic_zeros,
)
from fvi_cli.mathematics.transforms.zeros import (
    count_zeros,
)
from fvi_cli.scenes.lagrangian import lagrangian_scene


def nodes(p, degree=1):
    return Method(cq=f"bdf{p}", degree=degree, sampling="nodes")


def points(p, degree=1):
    return Method(cq=f"bdf{p}", degree=degree, sampling="points")


def coupled(seed):
    """A system of 2 to 6 components with viscous damping, and a number of steps of a length."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(2, 7))

    def form(least, most):
        rotation = np.linalg.qr(rng.normal(size=(d, d)))[0]
        sizes = np.exp(rng.uniform(math.log(least), math.log(most), d))
        return rotation @ np.diag(sizes) @ rotation.T

    system = MatrixPencil(
        mass=form(0.5, 2.0), stiffness=form(0.2, 30.0), damping=((1.0, form(0.01, 1.0)),)
    )
    n_steps = int(np.exp(rng.uniform(math.log(30), math.log(3000))))
    return system, n_steps, float(rng.uniform(1.0, 20.0)) / n_steps


def wrongly_counted(seeds):
    """Those whose growing modes by explicit Euler are not so many as its eigenvalues."""
    found = []
    for seed in seeds:
        system, n_steps, h = coupled(seed)
        unit, inverse = np.eye(len(system.mass)), np.linalg.inv(system.mass)
        step = np.block(
            [
                [unit, h * unit],
                [-h * inverse @ system.stiffness, unit - h * inverse @ system.damping[0][1]],
            ]
        )
        moduli, radius = 1 / np.abs(np.linalg.eigvals(step)), 1 - 0.1 / n_steps
        if np.abs(moduli - radius).min() > 1e-6 / n_steps:
            modes = growing_modes([system], Baseline(name="explicit-euler"), h, n_steps)
            if modes.count != np.count_nonzero(moduli < radius):
                found.append(seed)
    return found


# of these, modes close to each other were overlooked or made up with fewer points
CLOSE = (12, 130, 179, 203, 269, 281, 361, 399, 403)


def test_growing_modes_of_coupled_systems_are_the_eigenvalues():
    assert wrongly_counted([*CLOSE, *range(1000, 1040)]) == []


def test_fewer_points_overlook_modes_that_are_close(monkeypatch):
    """The control: one point for each factor of 2 for all zeros together."""
    monkeypatch.setattr(zeros, "PER_FACTOR", math.inf)
    zeros._first_angles.cache_clear()
    assert wrongly_counted(CLOSE)
    zeros._first_angles.cache_clear()


@spread(
    **{"p, bound": [(1, 2.0), (2, 4.0), (3, 20 / 3), (4, 32 / 3), (5, 256 / 15), (6, 416 / 15)]},
    order=[0.4, 1.0, 1.5, 1.8],
)
def test_sawtooth_bound_of_explicit_sampling(p, bound, order):
    # mu h^(2 - gamma) gamma_p(-1)^gamma = 4 puts a mode at z = -1: the bound is a formula
    critical = (4 / bound**order) ** (1 / (2 - order))
    n = 4000
    for factor, verdict in ((0.95, "stable"), (1.05, "unstable")):
        scene = oscillator(n * critical * factor, stiffness=0.0, damping=((order, 1.0),))
        assert predict_stability(scene, nodes(p), n).verdict == verdict


def test_the_largest_stable_step_is_one_that_is_predicted_stable():
    """Also where forces of the finest steps are beside inertia what round-off is."""
    draw, p = np.random.default_rng(1).uniform, 5
    for _ in range(5):
        scene = oscillator(
            10 ** draw(0, 2),
            mass=10 ** draw(-2, 2),
            stiffness=10 ** draw(-1, 3),
            damping=((draw(1.6, 1.9), 10 ** draw(-2, 0)),),
        )
        least = least_stable_n_steps(scene, points(p))
        finest = predict_stability(scene, points(p), LARGEST_N_STEPS).verdict
        assert (least is None) == (finest == "unstable")
        for n in () if least is None else (least, 2 * least):
            assert predict_stability(scene, points(p), n).verdict == "stable"


def test_largest_stable_step_where_there_is_no_limit():
    assert largest_stable_step(oscillator(64.0), points(2)) == 64.0
    assert largest_stable_step(oscillator(64.0), Method(cq="gauss", degree=3)) == 64.0


@spread(p=[1, 2], order=[0.05, 0.5, 1.0, 1.3, 1.95])
def test_degree_one_at_the_points_is_stable_for_a_stable_formula(p, order):
    for stiffness in (1e-2, 1.0, 1e4, 1e8):
        for mu in (1e-2, 1.0, 1e4):
            scene = oscillator(500.0, stiffness=stiffness, damping=((order, mu),))
            prediction = predict_stability(scene, points(p), 500)
            assert prediction.verdict == "stable"
            assert prediction.growing_modes == 0
    # the control: a formula that is not A-stable
    scene = oscillator(500.0, stiffness=100.0, damping=((1.5, 10.0),))
    assert predict_stability(scene, points(6), 500).verdict == "unstable"


@spread(
    **{
        "stiffness, damping": [
            (1.0, ((0.5, -0.3),)),
            (1.0, ((1.5, -0.4),)),
            (1.0, ((1.0, -0.2),)),
            (-1.0, ((0.5, 0.5),)),
            (2.0, ((0.5, 0.4), (1.5, -0.7))),
        ]
    },
    method=[Method(cq="gauss", degree=3), points(2, 2), nodes(2)],
)
def test_true_growth_is_not_called_unstable(stiffness, damping, method):
    scene = oscillator(30.0, stiffness=stiffness, damping=damping)
    prediction = predict_stability(scene, method, 3000)
    assert prediction.verdict == "stable"
    assert prediction.growing_modes >= 1
    characteristic = characteristic_terms(mass=1.0, stiffness=stiffness, damping=damping)
    largest = max(float(zero.center.real) for zero in characteristic_zeros(characteristic))
    assert prediction.exact_growth == pytest.approx(largest * 0.01, rel=1e-9)
    assert prediction.growth_per_step == pytest.approx(largest * 0.01, rel=0.05)
    # the growth is that of the equation, so an equation of the opposite sign has none
    system = matrix_pencil(oscillator(30.0, stiffness=1.0, damping=((0.5, 0.3),)))
    assert growing_frequencies(system, 30.0, 0.01).size == 0


def test_classical_growth_by_a_formula():
    # x'' - 2 a x' + x = 0 grows like exp(a t); the midpoint rule does it by its stability function
    scene = oscillator(100.0, damping=((1.0, -0.2),))
    prediction = predict_stability(scene, Method(cq="gauss", degree=1), 100)
    s = complex(0.1, math.sqrt(1 - 0.01))
    expected = math.log(abs((1 + s / 2) / (1 - s / 2)))
    assert prediction.growth_per_step == pytest.approx(expected, rel=1e-9)
    assert prediction.exact_growth == pytest.approx(0.1, rel=1e-9)
    assert prediction.growing_modes == 2


@pytest.mark.parametrize(
    ("name", "growth"), [("explicit-euler", 0.5 * math.log(1 + 0.01)), ("implicit-euler", 0.0)]
)
def test_baselines_by_a_formula(name, growth):
    scene = oscillator(1000.0, damping=())
    prediction = predict_stability(scene, Baseline(name=name), 10000)
    assert prediction.growth_per_step == pytest.approx(growth, rel=1e-6, abs=1e-12)
    assert prediction.verdict == ("unstable" if growth else "stable")


def test_undamped_modes_do_not_grow():
    for method in (Method(cq="gauss", degree=2), points(3, 2), nodes(1)):
        prediction = predict_stability(oscillator(100.0, damping=()), method, 1000)
        assert (prediction.verdict, prediction.growing_modes) == ("stable", 0)


def test_units_do_not_matter():
    one = predict_stability(oscillator(10.0), nodes(6), 100)
    time, mass = 1e-9, 1e7
    other = oscillator(
        10.0 * time,
        mass=mass,
        stiffness=mass / time**2,
        damping=((1.5, mass / time**2 * time**1.5),),
    )
    two = predict_stability(other, nodes(6), 100)
    assert (one.verdict, one.growing_modes) == (two.verdict, two.growing_modes)
    assert two.growth_per_step == pytest.approx(one.growth_per_step, rel=1e-9)


def swinging(position):
    return swing((1.5, np.eye(1)), T=100.0, x=position)


def test_nonlinear_scenes_are_only_warned_about():
    prediction = predict_stability(swinging(0.0), nodes(6), 1000)
    linear = predict_stability(oscillator(100.0), nodes(6), 1000)
    assert prediction.verdict == "unknown"
    assert "linearised" in prediction.reason
    assert prediction.growth_per_step == pytest.approx(linear.growth_per_step, rel=1e-9)
    assert predict_stability(swinging(math.pi), Method(cq="gauss", degree=1), 1000).exact_growth > 0
    assert linearised_at_start(oscillator()).is_linear


def test_a_method_that_is_stable_at_this_step():
    proposed = stable_method(oscillator(100.0), nodes(6, 2), 1000)
    assert proposed is not None
    assert predict_stability(oscillator(100.0), proposed, 1000).verdict == "stable"


def test_the_number_of_steps_is_checked():
    with pytest.raises(ValueError, match="n_steps: 0"):
        predict_stability(oscillator(), nodes(1), 0)


def test_a_lagrangian_is_linearised_with_its_own_mass_and_stiffness():
    # 2 v^2 (1 + x^2) - 18 cosh(x): at rest in 0 an oscillator of mass 4 and stiffness 18
    damping = (FractionalDamping(order=1.5, coefficient=4 * np.eye(1)),)
    scene = lagrangian_scene(
        final_time=100.0,
        coordinates=["x"],
        lagrangian="2*vx**2*(1 + x**2) - 18*cosh(x)",
        damping=damping,
    )
    assert scene.lagrangian is not None
    near = oscillator(100.0, mass=4.0, stiffness=18.0, damping=((1.5, 4.0),))
    prediction = predict_stability(scene, nodes(6), 1000)
    expected = predict_stability(near, nodes(6), 1000)
    assert prediction.verdict == "unknown"
    assert prediction.linearised_verdict == expected.verdict == "unstable"
    assert prediction.growth_per_step == pytest.approx(expected.growth_per_step, rel=1e-9)
    assert largest_stable_step(scene, nodes(6)) == largest_stable_step(near, nodes(6))


def test_a_mass_that_is_none_is_not_linearised():
    scene = lagrangian_scene(
        final_time=1.0, coordinates=["x"], lagrangian="vx**2*x/2 - x**2", initial_position=1.0
    )
    turned = dataclasses.replace(scene, initial_position=np.array([-1.0]))
    prediction = predict_stability(turned, Method(cq="gauss", degree=1), 10)
    assert prediction.verdict == "unknown"
    assert "cannot be linearised" in prediction.reason


@spread(order=[0.001, 0.05, 1 - 1e-9, 1 + 1e-9, 1.95, 1.999], n_steps=[1, 30, 10**6])
def test_resolved_growth_as_fast_as_it_may_be(order, n_steps):
    for degree in (1, 2, 3, 4):
        scene = oscillator(1e-9 * n_steps, stiffness=0.0, damping=((order, -2.0),))
        prediction = predict_stability(scene, Method(cq="gauss", degree=degree), n_steps)
        assert prediction.verdict == "stable"


def test_symbols_near_one_are_exact():
    # Gauss with two stages has a pole at z = 1: the power of the symbol against 60 digits
    z = 1.0 - 1e-7
    method, order = Method(cq="gauss", degree=2), 0.3
    place = np.array([z], dtype=complex)
    damped_system = matrix_pencil(oscillator(damping=((order, 0.7),)))
    logarithm = step_determinants([damped_system], method, 0.5).of(0)(place)[0]
    with mpmath.workdps(60):
        root = mpmath.sqrt(3)
        a = mpmath.matrix([[0.25, 0.25 - root / 6], [0.25 + root / 6, 0.25]])
        ones, half = mpmath.matrix([1, 1]), mpmath.matrix([[0.5, 0.5]])
        exact_z, h = mpmath.mpf(z), mpmath.mpf(0.5)
        symbol = (a + exact_z / (1 - exact_z) * (ones * half)) ** -1
        values, vectors = mpmath.eig(symbol)
        power = vectors * mpmath.diag([v ** (order - 1) for v in values]) * vectors**-1
        # the scheme is [Delta^2 + mu Delta^gamma + k] X = 0 with the step size in Delta, and the
        # determinant of the step is that times det(A) factors that do not depend on the scene
        force = mpmath.mpf(0.7) * h ** (-order) * power * symbol + mpmath.eye(2)
        damped = mpmath.det(symbol * symbol / h**2 + force)
        free = mpmath.det(symbol * symbol / h**2 + mpmath.eye(2))
    free_system = matrix_pencil(oscillator(damping=()))
    reference = step_determinants([free_system], method, 0.5).of(0)(place)[0]
    ratio = complex(damped / free)
    assert np.exp(logarithm - reference) == pytest.approx(ratio, rel=1e-7)


def test_many_coupled_modes_are_counted_as_one_by_one():
    # eight oscillators in turned coordinates, counted by one determinant without their modes
    random = np.random.default_rng(4)
    stiffness, mu = random.uniform(0.5, 4.0, 8), random.uniform(0.1, 3.0, 8)
    turn, _ = np.linalg.qr(random.standard_normal((8, 8)))
    whole = matrix_pencil(
        oscillator(
            1.0,
            mass=np.eye(8),
            stiffness=turn.T @ np.diag(stiffness) @ turn,
            damping=((1.5, turn.T @ np.diag(mu) @ turn),),
        )
    )
    for method in (nodes(4, 2), points(6, 3)):
        parts = [
            predict_stability(oscillator(100.0, stiffness=k, damping=((1.5, m),)), method, 1000)
            for k, m in zip(stiffness, mu, strict=True)
        ]
        together = step_determinants([whole], method, 0.1)
        expected = sum(part.growing_modes for part in parts)
        assert count_zeros(together, 1 - 1e-4) == expected >= 8
        worst = max(part.growth_per_step for part in parts)
        found = growing_modes([whole], method, 0.1, 1000)
        assert found.count == expected
        assert found.growth == pytest.approx(worst, rel=1e-6)


def test_the_growth_of_modes_that_coincide():
    # a double zero is not located, but closed in: the same oscillator twice, coupled by a turn
    random = np.random.default_rng(4)
    turn, _ = np.linalg.qr(random.standard_normal((2, 2)))
    stiffness, damping = turn.T @ np.diag([1.0, 1.0]) @ turn, turn.T @ np.diag([0.5, 0.5]) @ turn
    twice = MatrixPencil(mass=np.eye(2), stiffness=stiffness, damping=((1.5, damping),))
    once = MatrixPencil(mass=np.eye(1), stiffness=np.eye(1), damping=((1.5, 0.5 * np.eye(1)),))
    two, one = (growing_modes([system], nodes(6), 0.1, 1000) for system in (twice, once))
    assert (two.count, one.count) == (2 * one.count, one.count)
    assert one.count > 0
    assert two.growth == pytest.approx(one.growth, rel=1e-6)


def test_too_many_coupled_components_are_left_alone():
    random = np.random.default_rng(4)
    root = random.standard_normal((30, 30))
    scene = oscillator(
        1.0,
        mass=np.eye(30),
        stiffness=np.diag(np.arange(1.0, 31.0)),
        damping=((1.5, root @ root.T),),
    )
    prediction = predict_stability(scene, nodes(1), 10)
    assert prediction.verdict == "unknown"
    assert "at most" in prediction.reason


def test_growing_frequencies_are_eigenvalues():
    """Of a polynomial in the square root of s, where all orders are multiples of 1/2."""
    counted = 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        d, unit = int(random.integers(1, 4)), 10.0 ** random.uniform(-6, 6)
        terms = []
        for order in (Fraction(0), Fraction(1, 2), Fraction(1), Fraction(3, 2)):
            root = random.standard_normal((d, d))
            # of any sign and size
            size = 10.0 ** random.uniform(-1, 1) * random.choice([-1, 1])
            terms.append((order, size * (root @ root.T) * unit ** (2 - float(order))))
        (_, stiffness), *damping = terms
        system = MatrixPencil(
            mass=np.eye(d),
            stiffness=stiffness,
            damping=tuple((float(order), matrix) for order, matrix in damping),
        )
        exact = np.array(unpolished_modes(np.eye(d), terms))
        growth = exact.real / unit / 0.05
        if np.any((growth > 0.3) & (growth < 4)):
            # at the border of what counts as growth
            continue
        expected = exact[growth > 1]
        found = growing_frequencies(system, 1.0 / unit, 1e-3 / np.abs(exact).max())
        assert found is not None, seed
        assert found.size == expected.size, seed
        counted += found.size
        distances = np.abs(found[:, None] - expected).min(axis=1, initial=math.inf)
        assert np.all(distances <= 1e-7 * np.abs(found)), seed
    assert counted > 40


@pytest.mark.parametrize("distance", [0.0, 1e-14, 0.5])
def test_step_equations_keep_their_digits_where_eigenvalues_of_the_symbol_meet(distance):
    """Those of Gauss2 meet at z = 7 - 4 sqrt(3); the mean over a circle is the value within."""
    patterns = step_patterns(Method(cq="gauss", degree=2), (0.5, 1.3))
    meeting, circle = 7.0 - 4.0 * math.sqrt(3.0), 1e-2 * np.exp(2j * np.pi * np.arange(64) / 64)
    centre = meeting + distance * np.exp(0.3j)
    mean = patterns(centre + circle).mean(axis=0)
    assert np.abs(patterns(np.array([centre]))[0] - mean).max() < 1e-11
