"""The expansion at the start and at jumps, and the rule that says when it is used."""

from __future__ import annotations

import math
import re

import mpmath
import numpy as np
import pytest

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import ExpressionPotential, Potential, QuadraticPotential
from fvi_cli.effects.scene import Derivative, Scene
from fvi_cli.integrator.expansion import (
    Expansion,
    jump_expansion,
    solution_expansion,
    solution_series,
)
from fvi_cli.integrator.start import (
    WindowRule,
    plan_jump,
    plan_start,
    residual_force,
    window_force,
)
from fvi_cli.mathematics.expressions import NUMPY_FUNCTIONS, Expression
from fvi_cli.mathematics.power_series import PowerSeries, SeriesError


def oscillator(
    order: float = 0.5,
    damping: float = 1.0,
    *,
    stiffness: float = 1.0,
    position: float = 1.0,
    velocity: float = 0.0,
    final_time: float = 8.0,
    forcing: Forcing | None = None,
    derivative: Derivative = "caputo",
    mass: float = 1.0,
) -> Scene:
    return Scene(
        inertia=Inertia(mass=mass),
        initial_position=np.array([position]),
        initial_velocity=np.array([velocity]),
        final_time=final_time,
        potential=QuadraticPotential(stiffness=stiffness),
        damping=(FractionalDamping(order=order, coefficient=damping),),
        forcing=forcing,
        derivative=derivative,
    )


def pieces(*entries: tuple[str, float]) -> Forcing:
    return Forcing(
        pieces=tuple(
            ForcingPiece(components=(Expression.parse(text, ("t",)),), until=until)
            for text, until in entries
        )
    )


def pendulum(position: float = 1.0, order: float = 0.5) -> Scene:
    def x(text: str) -> Expression:
        return Expression.parse(text, ("x",))

    return Scene(
        inertia=Inertia(mass=1.0),
        initial_position=np.array([position]),
        initial_velocity=np.array([0.0]),
        final_time=20.0,
        potential=ExpressionPotential(
            coordinates=("x",),
            energy_expression=x("1 - cos(x)"),
            gradient_expressions=(x("sin(x)"),),
            hessian_expressions=((x("cos(x)"),),),
        ),
        damping=(FractionalDamping(order=order, coefficient=0.3),),
    )


def coupled(derivative: Derivative, potential: Potential | None) -> Scene:
    return Scene(
        inertia=Inertia(mass=np.array([[2.0, 0.3], [0.3, 1.0]])),
        initial_position=np.array([0.0, 0.0] if derivative == "riemann-liouville" else [0.7, -0.4]),
        initial_velocity=np.array([0.5, 1.25]),
        final_time=5.0,
        potential=potential,
        damping=(
            FractionalDamping(order=0.5, coefficient=np.array([[0.4, 0.1], [0.1, 0.2]])),
            FractionalDamping(order=1.0, coefficient=np.diag([0.0, 0.3])),
            FractionalDamping(order=1.25, coefficient=np.array([[0.3, -0.2], [-0.2, 0.6]])),
        ),
        forcing=Forcing.from_text("sqrt(t) + exp(-t)", "t**-0.25*cos(t)"),
        derivative=derivative,
    )


QUARTIC = ExpressionPotential(
    coordinates=("x", "y"),
    energy_expression=Expression.parse("k*(x - y)**4/4 + cosh(x)*y", ("x", "y", "k")),
    gradient_expressions=(
        Expression.parse("k*(x - y)**3 + sinh(x)*y", ("x", "y", "k")),
        Expression.parse("k*(y - x)**3 + cosh(x)", ("x", "y", "k")),
    ),
    hessian_expressions=((Expression.parse(0), Expression.parse(0)),) * 2,
    parameters={"k": 0.7},
)


def laplace_coefficients(
    order: float, damping: float, stiffness: float, x0: float, v0: float, caputo: bool, top: float
) -> dict[float, float]:
    """Expand the Laplace transform in falling powers of s and invert term by term.

    The double series of the generalised Mittag-Leffler solution: Podlubny, *Fractional
    Differential Equations*, 1999, section 8.3.
    """
    numerators = [(x0, 1.0), (v0, 0.0)]
    if caputo:
        numerators.append((damping * x0, order - 1))
        if order > 1:
            numerators.append((damping * v0, order - 2))
    found: dict[float, float] = {}
    for n in range(60):
        for j in range(n + 1):
            weight = (-1) ** n * math.comb(n, j) * damping**j * stiffness ** (n - j)
            for number, power in numerators:
                exponent = 2 * n + 2 - order * j - power - 1
                if number and exponent < top - 1e-9:
                    key = round(exponent, 9)
                    found[key] = found.get(key, 0) + weight * number / math.gamma(exponent + 1)
    return {key: value for key, value in found.items() if abs(value) > 1e-13}


@pytest.mark.parametrize("order", [0.3, 0.5, 1.0, 1.25, 1.5, 1.9])
@pytest.mark.parametrize("derivative", ["caputo", "riemann-liouville"])
def test_linear_oscillator_has_the_mittag_leffler_coefficients(
    order: float, derivative: Derivative
) -> None:
    caputo = derivative == "caputo"
    x0 = 1.0 if caputo or order < 1 else 0.0
    scene = oscillator(order, 0.7, stiffness=2.0, position=x0, velocity=0.5, derivative=derivative)
    found = solution_series(scene, 6.0)[0]
    # d/dt of order 1 is the same in both conventions.
    expected = laplace_coefficients(order, 0.7, 2.0, x0, 0.5, caputo or order == 1, 6.0)
    np.testing.assert_allclose(found.exponents, sorted(expected), atol=1e-9)
    np.testing.assert_allclose(
        found.coefficients, [expected[key] for key in sorted(expected)], rtol=1e-12
    )


@pytest.mark.parametrize(
    ("scene", "value"),
    [
        # x(1) of x'' + D^{1/2} x + x = 0 by Laplace inversion (Talbot, degree 120, mpmath)
        (oscillator(), 0.612261785758467),
        (oscillator(derivative="riemann-liouville"), 0.0768387490366691),
        # 1 - x(1) of the unit step from rest, the same route
        (oscillator(1.5), 1 - 0.289440727849072),
        # a polynomial solution: x'' + D^{3/2} x + x = 1 + t has x = 1 + t
        (oscillator(1.5, velocity=1.0, forcing=Forcing.from_text("1 + t")), 2.0),
    ],
)
def test_the_whole_series_has_known_values(scene: Scene, value: float) -> None:
    assert solution_series(scene, 20.0)[0](1.0) == pytest.approx(value, rel=3e-15)


def residual(scene: Scene, expansion: Expansion, time: float) -> np.ndarray:
    """What is left of the equation at a time, with the expansion as an exact finite sum."""
    with mpmath.workdps(40):
        t, d = mpmath.mpf(time), scene.dimension

        def power_sum(order: float, first: float) -> list[mpmath.mpf]:
            total = [mpmath.mpf(0)] * d
            for sigma, row in zip(expansion.exponents, expansion.coefficients, strict=True):
                if sigma < first and sigma == int(sigma):
                    continue
                factor = mpmath.gammaprod([sigma + 1], [sigma + 1 - mpmath.mpf(order)])
                for i in range(d):
                    total[i] += float(row[i]) * factor * t ** (mpmath.mpf(sigma) - order)
            return total

        left = mpmath.matrix(scene.inertia.mass) * mpmath.matrix(power_sum(2, 0))
        for term in scene.active_damping:
            first = term.order if scene.derivative == "caputo" else 0.0
            left += mpmath.matrix(term.coefficient) * mpmath.matrix(power_sum(term.order, first))
        position = power_sum(0, 0)
        if isinstance(scene.potential, ExpressionPotential):
            functions = {"sin": mpmath.sin, "sinh": mpmath.sinh, "cosh": mpmath.cosh}
            left += mpmath.matrix(scene.potential.gradient_components(position, functions))
        elif scene.potential is not None:
            left += mpmath.matrix(scene.potential.stiffness) * mpmath.matrix(position)
        if scene.forcing is not None:
            functions = {"sqrt": mpmath.sqrt, "exp": mpmath.exp, "cos": mpmath.cos}
            left -= mpmath.matrix(
                [c.evaluate({"t": t}, functions) for c in scene.forcing.pieces[0].components]
            )
        return np.array([float(value) for value in left])


@pytest.mark.parametrize(
    "scene",
    [
        pendulum(),
        pendulum(order=1.75),
        coupled("caputo", QUARTIC),
        coupled("riemann-liouville", QUARTIC),
        coupled("caputo", QuadraticPotential(stiffness=np.array([[3.0, -1.0], [-1.0, 2.0]]))),
        coupled("caputo", None),
    ],
    ids=["pendulum", "pendulum-1.75", "caputo", "riemann-liouville", "linear", "free"],
)
def test_the_equation_holds_up_to_the_truncation(scene: Scene) -> None:
    """The residual of an expansion below t^Q falls at least like t^(Q-2)."""
    cutoff = 5.0
    expansion = solution_expansion(scene, cutoff)
    assert not expansion.is_smooth
    times = [2e-3, 1e-3]
    first, second = (np.abs(residual(scene, expansion, t)).max() for t in times)
    slope = math.log2(first / second)
    assert cutoff - 2.25 <= slope <= cutoff
    # Control: one wrong coefficient shows.
    wrong = expansion.coefficients.copy()
    wrong[np.flatnonzero(expansion.exponents % 1)[0]] *= 1.01
    broken = Expansion(exponents=expansion.exponents, coefficients=wrong, cutoff=cutoff)
    first, second = (np.abs(residual(scene, broken, t)).max() for t in times)
    assert math.log2(first / second) < 2.0


def test_a_manufactured_solution_is_found_exactly() -> None:
    """The paper's Bagley-Torvik problem, x = t^{5/2}: a finite sum, good for the whole run."""
    scene = oscillator(
        1.5,
        position=0.0,
        forcing=Forcing.from_text("15/4*sqrt(t) + 15/8*sqrt(pi)*t + t**2.5"),
        final_time=1.0,
    )
    found = solution_series(scene, 9.0)[0]
    np.testing.assert_array_equal(found.exponents, [2.5])
    assert found.coefficients[0] == pytest.approx(1.0, rel=1e-15)
    decision = plan_start(scene, 9.0, 1 / 16)
    assert decision.use
    assert decision.tau == 1.0


# -- the rule ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("order", "damping", "used"),
    [(1.5, 0.7, True), (0.5, 0.7, True), (1.5, 5.0, False), (1.5, 20.0, False), (1.9, 2.0, False)],
)
def test_strong_damping_falls_back(order: float, damping: float, used: bool) -> None:
    scene = oscillator(order, damping, stiffness=2.0, velocity=0.5)
    decision = plan_start(scene, 8.0, 8.0 / 32)
    assert decision.use is used
    assert (decision.window is not None) is used
    if used:
        assert "2.5" in decision.reason
    else:
        assert decision.tau < 4 * 8.0 / 32
        assert "less than 4 steps" in decision.reason
        # With steps that resolve tau it is used.
        fine = plan_start(scene, 8.0, decision.tau / 4.001)
        assert fine.use
        assert fine.tau == decision.tau


@pytest.mark.parametrize(
    ("scene", "reason"),
    [
        (oscillator(1.0), "starts smoothly"),
        (oscillator(0.5, 0.0), "starts smoothly"),
        (oscillator(1.0, forcing=Forcing.from_text("sin(t)")), "no fractional power"),
        (oscillator(0.5, forcing=Forcing.from_text("log(t)")), "log"),
        (oscillator(0.5, forcing=Forcing.from_text("t**-1.5")), "not integrable"),
        (oscillator(1.97), "more than 128 exponents"),
        (oscillator(1.9999999999), "cannot be continued|more than"),
        (oscillator(1.5, position=0.0), "no fractional power"),
    ],
)
def test_what_has_no_use_for_a_series(scene: Scene, reason: str) -> None:
    decision = plan_start(scene, 8.0, 1e-3)
    assert not decision.use
    assert decision.window is None
    assert re.search(reason, decision.reason)
    with pytest.raises(ValueError, match="residual_force"):
        residual_force(scene, decision)


def test_a_potential_without_expansion_is_a_reason() -> None:
    def x(text: str) -> Expression:
        return Expression.parse(text, ("x",))

    for gradient, position, reason in [("sqrt(x)", 0.0, "continued"), ("log(x)", 0.0, "log")]:
        scene = pendulum(position)
        potential = ExpressionPotential(
            coordinates=("x",),
            energy_expression=x("0"),
            gradient_expressions=(x(gradient),),
            hessian_expressions=((x("0"),),),
        )
        scene = Scene(
            inertia=scene.inertia,
            initial_position=scene.initial_position,
            initial_velocity=scene.initial_velocity,
            final_time=1.0,
            potential=potential,
            damping=scene.damping,
        )
        decision = plan_start(scene, 8.0, 1e-3)
        assert not decision.use
        assert reason in decision.reason


@pytest.mark.parametrize("unit", [1e-6, 3.0, 1e5])
def test_nothing_depends_on_the_units(unit: float) -> None:
    """Time in other units, length in other units: the same decision and the same window."""
    length, order = 7.0 * unit, 1.25
    plain = oscillator(order, 0.7, stiffness=2.0, velocity=0.5)
    rescaled = oscillator(
        order,
        0.7 * unit ** (order - 2),
        stiffness=2.0 / unit**2,
        position=length,
        velocity=0.5 * length / unit,
        final_time=8.0 * unit,
    )
    one, other = plan_start(plain, 8.0, 0.25), plan_start(rescaled, 8.0, 0.25 * unit)
    assert other.use
    assert other.tau == pytest.approx(one.tau * unit, rel=1e-12)
    times = np.array([1e-5, 0.1, 1.0, 7.0])
    assert one.window is not None
    assert other.window is not None
    for a, b, scale in [
        (one.window.position(times), other.window.position(times * unit), length),
        (
            one.window.fractional_derivative(times, order, "caputo"),
            other.window.fractional_derivative(times * unit, order, "caputo"),
            length * unit**-order,
        ),
    ]:
        np.testing.assert_allclose(b / scale, a, rtol=1e-11)


def test_tau_does_not_depend_on_the_coordinates() -> None:
    """Rotated coordinates with a mass matrix that follows."""
    c, s = math.cos(0.4), math.sin(0.4)
    change = np.array([[2 * c, -s], [2 * s, c]])
    scene = coupled("caputo", QuadraticPotential(stiffness=np.eye(2)))
    inverse = np.linalg.inv(change)

    def moved(matrix: np.ndarray) -> np.ndarray:
        result = change.T @ matrix @ change
        return np.asarray((result + result.T) / 2)

    other = Scene(
        inertia=Inertia(mass=moved(scene.inertia.mass)),
        initial_position=inverse @ scene.initial_position,
        initial_velocity=inverse @ scene.initial_velocity,
        final_time=5.0,
        potential=QuadraticPotential(stiffness=moved(np.eye(2))),
        damping=tuple(
            FractionalDamping(order=t.order, coefficient=moved(t.coefficient))
            for t in scene.damping
        ),
    )
    plain = Scene(
        inertia=scene.inertia,
        initial_position=scene.initial_position,
        initial_velocity=scene.initial_velocity,
        final_time=5.0,
        potential=scene.potential,
        damping=scene.damping,
    )
    assert plan_start(other, 6.0, 1e-3).tau == pytest.approx(plan_start(plain, 6.0, 1e-3).tau)


# -- what remains to be integrated ---------------------------------------------------------------


@pytest.mark.parametrize(
    "scene",
    [
        oscillator(1.5, 0.7, stiffness=2.0, velocity=0.5),
        oscillator(0.5, 0.7, derivative="riemann-liouville"),
        pendulum(),
        coupled("caputo", QUARTIC),
    ],
    ids=["caputo", "riemann-liouville", "pendulum", "coupled"],
)
def test_the_remaining_force_starts_smoothly(scene: Scene) -> None:
    """r - grad V(S) falls like t^(Q-2), and is nothing but round-off next to 0."""
    cutoff = 6.0
    decision = plan_start(scene, cutoff, 1e-4)
    assert decision.use
    window, potential = decision.window, scene.potential
    assert window is not None
    assert potential is not None
    force = residual_force(scene, decision)
    times = decision.tau * np.array([0.0, 1e-12, 1e-6, 1e-4, 2.0**-9, 2.0**-8])
    rest = force(times, 1e-300, np.zeros(1))[:, 0] - potential.gradient(window.position(times))
    sizes = np.abs(rest).max(axis=1)
    scale = np.abs(potential.gradient(window.position(decision.tau * np.ones(1)))).max()
    np.testing.assert_allclose(sizes[:4] / scale, 0.0, atol=1e-9)
    assert cutoff - 2.25 < math.log2(sizes[5] / sizes[4]) < cutoff


def test_the_force_of_a_window_is_zero_before_it_starts() -> None:
    scene = oscillator(1.5, 0.7, stiffness=2.0, forcing=pieces(("1", 2.0), ("0", math.inf)))
    decision = plan_jump(scene, 2.0, 8.0, 0.25)
    assert decision.window is not None
    steps, offsets = 0.25 * np.arange(12), np.array([0.0, 0.5, 1.0])
    force = window_force(scene, decision.window, start=2.0)(steps, 0.25, offsets)
    np.testing.assert_array_equal(force[:8], 0.0)
    # From the inside of the step after the break the whole jump is there, and D R is 0.
    assert force[8, 0, 0] == pytest.approx(-1.0, rel=1e-12)
    with_stiffness = window_force(scene, decision.window, start=2.0, stiffness=2 * np.eye(1))
    local = np.maximum(steps[:, None] + 0.25 * offsets - 2.0, 0.0)
    np.testing.assert_allclose(
        with_stiffness(steps, 0.25, offsets)[8:] - force[8:],
        2 * decision.window.position(local)[8:],
        atol=1e-13,
    )


# -- jumps ---------------------------------------------------------------------------------------


def test_response_to_a_jump_is_the_step_response() -> None:
    """From 8 to 0: -8 times the unit step response, whose value at 1 is known from outside."""
    scene = oscillator(1.5, position=0.0, forcing=pieces(("8", 1.0), ("0", math.inf)))
    response = jump_expansion(scene, 1.0, 20.0).components[0]
    assert response(1.0) == pytest.approx(-8 * 0.289440727849072, rel=3e-15)
    assert response.leading_exponent == 2.0
    decision = plan_jump(scene, 1.0, 8.0, 0.05)
    assert decision.use
    again = jump_expansion(
        oscillator(1.5, position=3.0, velocity=-1.0, forcing=scene.forcing), 1.0, 20.0
    )
    np.testing.assert_array_equal(again.components[0].coefficients, response.coefficients)


def test_kinks_and_roots_at_a_break_point_belong_to_the_jump() -> None:
    scene = oscillator(
        0.5, 0.3, position=0.0, forcing=pieces(("t", 1.0), ("2 - t + sqrt(t - 1)", math.inf))
    )
    response = jump_expansion(scene, 1.0, 4.0).components[0]
    assert response.coefficient(2.5) == pytest.approx(1 / (2.5 * 1.5))
    assert response.coefficient(3.0) == pytest.approx(-2 / 6)
    assert response.leading_exponent == 2.5


def test_the_jump_of_a_nonlinear_scene_is_known_only_so_far() -> None:
    plain = pendulum()
    scene = Scene(
        inertia=plain.inertia,
        initial_position=plain.initial_position,
        initial_velocity=plain.initial_velocity,
        final_time=2.0,
        potential=plain.potential,
        damping=plain.damping,
        forcing=pieces(("1", 1.0), ("3", math.inf)),
    )
    without = jump_expansion(scene, 1.0, 8.0)
    assert without.cutoff == 4.0
    # on its way through x = 1/3 with the velocity 2, and at rest there
    passing, resting = (
        jump_expansion(
            scene,
            1.0,
            8.0,
            (
                PowerSeries(
                    exponents=np.array([0.0, 1.0]),
                    coefficients=np.array([1 / 3, velocity]),
                    cutoff=8.0,
                ),
            ),
        )
        for velocity in (2.0, 0.0)
    )
    assert passing.cutoff == resting.cutoff == 8.0
    response, other = passing.components[0], resting.components[0]
    # x'' = 2 - cos(1/3) x + 2 sin(1/3) t x + ..
    assert response.coefficient(4.0) == pytest.approx(-math.cos(1 / 3) * 2 / 24, rel=1e-12)
    gained = response.coefficient(5.0) - other.coefficient(5.0)
    assert gained == pytest.approx(2 * math.sin(1 / 3) / 20, rel=1e-12)


def test_jumps_that_leave_no_trace_or_have_no_series() -> None:
    forcing = pieces(("1", 1.0), ("0", 2.0), ("log(t - 2)", math.inf))
    assert "without memory" in plan_jump(oscillator(1.0, forcing=forcing), 1.0, 8.0, 0.1).reason
    assert "log" in plan_jump(oscillator(0.5, forcing=forcing), 2.0, 8.0, 0.1).reason
    with pytest.raises(SeriesError):
        jump_expansion(oscillator(0.5, forcing=forcing), 2.0, 8.0)
    for scene in (oscillator(), oscillator(forcing=forcing)):
        with pytest.raises(ValueError, match="break_point"):
            jump_expansion(scene, 1.5, 8.0)


def test_expansion_against_the_formula_of_the_forcing() -> None:
    """Without damping and potential the expansion is the double integral of the force."""
    scene = Scene(
        inertia=Inertia(mass=4.0),
        initial_position=np.array([1.0]),
        initial_velocity=np.array([2.0]),
        final_time=1.0,
        forcing=Forcing.from_text("exp(sqrt(t))"),
    )
    found = solution_series(scene, 12.0)[0]
    force = Expression.parse("exp(sqrt(t))", ("t",))
    second = found.derivative().derivative()
    times = np.array([0.01, 0.3])
    np.testing.assert_allclose(
        4 * second(times), force.evaluate({"t": times}, NUMPY_FUNCTIONS), rtol=1e-12
    )
    assert found(0.0) == 1.0


def test_a_window_that_costs_more_than_it_saves_is_not_used() -> None:
    """Order 2 loses nothing on t^2.5; order 4 does, and the finer the step the clearer."""
    scene = oscillator(1.5, 0.7, stiffness=2.0, velocity=0.5)
    step = 8.0 / 64
    assert plan_start(scene, 4.0, step / 16, WindowRule()).use
    refused = plan_start(scene, 4.0, step / 16, WindowRule(largest_cost=1e9))
    assert not refused.use
    assert "costs more" in refused.reason
    for steps, used in [(step, False), (step / 64, True)]:
        assert plan_start(scene, 6.0, steps, WindowRule(largest_cost=0.03)).use is used
    # A method that loses one power on a singular term has more to gain.
    assert plan_start(scene, 6.0, step, WindowRule(largest_cost=0.03, powers_lost=1.0)).use


@pytest.mark.parametrize("order", [0.5, 1.5])
@pytest.mark.parametrize(("size", "time_unit"), [(1e-150, 1e7), (1e150, 1e-11)])
def test_the_decision_does_not_depend_on_the_units(
    order: float, size: float, time_unit: float
) -> None:
    """Coefficients between 1e-206 and 1e238 have no squares among the numbers."""
    scaled = oscillator(
        order,
        time_unit ** (order - 2),
        stiffness=time_unit**-2,
        position=size,
        velocity=0.5 * size / time_unit,
        final_time=8 * time_unit,
    )
    found = plan_start(scaled, 8.0, time_unit / 16)
    plain = plan_start(oscillator(order, velocity=0.5), 8.0, 1 / 16)
    assert found.use
    assert found.tau / time_unit == pytest.approx(plain.tau, rel=1e-12)
    assert not plan_start(scaled, 8.0, 0.3 * plain.tau * time_unit).use


def test_coefficients_beyond_all_numbers_are_a_reason_against_a_series() -> None:
    scene = oscillator(1.99, 1e4)
    with pytest.raises(SeriesError, match="not finite"):
        solution_expansion(scene, 8.0)
    decision = plan_start(scene, 8.0, 0.1)
    assert not decision.use
    assert decision.wanted
    assert "not finite" in decision.reason
