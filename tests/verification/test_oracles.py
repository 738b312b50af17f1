"""The reference values of `oracles` against each other and against published ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles import talbot
from oracles.closed_forms import classical_response, free_flight, half_order_response
from oracles.ordinary import solve_ordinary
from oracles.volterra import VolterraSolution, solve_volterra
from scipy.special import gamma
from spread import spread

TIMES = np.array([1.0, 2.0, 5.0, 10.0, 20.0])
STEP_RESPONSES = {
    0.5: [
        0.387738214241533,
        0.887286182411692,
        0.668914627671081,
        0.815396858151600,
        0.877181068558190,
    ],
    1.5: [
        0.289440727849072,
        0.842623502331295,
        1.48771200400921,
        0.838616316256097,
        0.990454834432767,
    ],
}
"""Of x'' + D^gamma x + x = 1 from rest at the times."""


def test_nothing_of_the_package_is_used():
    names = ("talbot", "volterra", "ordinary", "contour", "closed_forms", "impacts", "eigenvalues")
    folder = Path(talbot.__file__).parent
    texts = [(folder / f"{name}.py").read_text(encoding="utf-8") for name in names]
    assert not any("fvi_cli" in text for text in texts)


def linear(stiffness, **others):
    """Arguments of a linear spring."""
    matrix = np.atleast_2d(np.asarray(stiffness, dtype=float))
    return {
        "gradient": lambda x: x @ matrix.T,
        "hessian": lambda x: np.broadcast_to(matrix, (len(x), *matrix.shape)),
        "force": None,
        **others,
    }


def pendulum(**others):
    return {"gradient": np.sin, "hessian": lambda x: np.cos(x)[:, :, None], "force": None, **others}


def assert_same(solution: VolterraSolution, times, known, relative=1e-12) -> None:
    for found, values in zip(
        (solution.position(times), solution.velocity(times)), known, strict=True
    ):
        values = np.asarray(values).reshape(found.shape)
        scale = np.max(np.abs(values), axis=0)
        assert np.max(np.abs(found - values) / scale) < relative


@pytest.mark.few(1)
@pytest.mark.parametrize("order", [0.5, 1.5])
def test_published_step_responses(order):
    known = STEP_RESPONSES[order]
    closed = half_order_response(order, TIMES, step=1.0)
    assert_allclose(closed[0], known, atol=2e-14)
    assert_allclose(1 - half_order_response(order, TIMES, x0=1.0)[0], known, atol=2e-14)
    solution = solve_volterra(
        1,
        [(order, 1)],
        **linear(1, force=lambda t: np.ones((t.size, 1))),
        x0=0,
        v0=0,
        final_time=20,
    )
    assert_same(solution, TIMES, closed)
    assert solution.error[0] < 1e-13
    inverted = talbot.linear_response(1, 1, [(order, 1)], 0, 0, TIMES[1::3], loads=[talbot.step()])
    assert_allclose(inverted[0][:, 0], np.array(known)[1::3], atol=2e-14)


def test_published_long_times():
    times = [100.0, 1000.0]
    assert_allclose(
        half_order_response(0.5, times, x0=1.0)[0], [0.0561329416629, 0.0178323072601], rtol=1e-11
    )
    assert_allclose(
        half_order_response(1.5, times, x0=1.0)[0], [-2.81851277911e-4, -8.92055356e-6], rtol=2e-8
    )


def test_published_response_to_a_force_that_stops():
    times = [0.5, 1, 2, 3, 5, 10, 20, 30]
    known = [
        0.6843347531500309,
        2.315525822792576,
        4.425462195857781,
        3.843966774139771,
        -0.4556413405384094,
        0.5316198658594876,
        0.187375156942063,
        0.03587938288263848,
    ]
    force = lambda t: 8.0 * (t < 1.0)[:, None]  # noqa: E731
    arguments = linear(1, force=force, x0=0, v0=0, final_time=30)
    solution = solve_volterra(1, [(1.5, 1)], **arguments, breaks=[1.0])
    assert_allclose(solution.position(times)[:, 0], known, atol=1e-13)


@spread(few=1, seed=range(4))
def test_routes_of_random_linear_scenes(seed):
    random = np.random.default_rng([25, seed])
    derivative = ["caputo", "riemann-liouville"][seed % 2]
    orders = random.uniform(0.05, 1.0, 1) if seed == 3 else random.uniform(0.05, 1.95, 2)
    root, other = random.standard_normal((2, 2, 2))
    stiffness, mass = root @ root.T + np.eye(2), other @ other.T + np.eye(2)
    terms = [(float(g), 10 ** random.uniform(-2, 0) * np.diag(random.random(2))) for g in orders]
    # a unit of time and one of length that are not 1
    period, length = 10.0 ** random.uniform(-6, 6, 2)
    terms = [(g, c * period ** (g - 2)) for g, c in terms]
    stiffness = stiffness / period**2
    x0 = length * random.standard_normal(2) * (derivative == "caputo" or max(orders) < 1)
    v0 = length / period * random.standard_normal(2)
    times = period * np.array([0.01, 5.0])
    known = talbot.linear_response(
        mass, stiffness, terms, x0, v0, times, derivative=derivative, degree=60
    )
    arguments = linear(stiffness, x0=x0, v0=v0, final_time=times[-1], derivative=derivative)
    solution = solve_volterra(mass, terms, **arguments)
    assert_same(solution, times, known)
    assert np.all(solution.error < 1e-12 * solution.scale()[0])
    # a wrong order and a datum that is left out are seen
    wrong = [(terms[0][0] + 1e-6, terms[0][1]), *terms[1:]]
    with pytest.raises(AssertionError):
        assert_same(solve_volterra(mass, wrong, **arguments), times, known)
    with pytest.raises(AssertionError):
        assert_same(
            solve_volterra(mass, terms, **{**arguments, "v0": v0 * (1 - 1e-9)}), times, known
        )
    if derivative == "riemann-liouville" and np.any(x0):
        caputo = solve_volterra(mass, terms, **{**arguments, "derivative": "caputo"})
        with pytest.raises(AssertionError):
            assert_same(caputo, times, known, 1e-6)


@spread(few=1, order=[0.3, 1.0, 1.75, 1.9, 1.99])
def test_riemann_liouville_motion_without_a_spring(order):
    times = np.array([1e-6, 0.3, 2.0, 7.0])
    known = free_flight(order, times, mass=2.0, coefficient=0.6, v0=1.5)
    arguments = {"x0": 0, "v0": 1.5, "final_time": 7.0, "derivative": "riemann-liouville"}
    assert_same(solve_volterra(2, [(order, 0.6)], None, None, None, **arguments), times, known)


def test_a_chosen_motion_of_a_pendulum():
    # x = 1 + t/2 + t**2.2 at order 1.3, from the derivative of a power
    g, p = 1.3, 2.2
    motion = lambda t: 1 + t / 2 + t**p  # noqa: E731
    part = gamma(p + 1) / gamma(p + 1 - g)
    force = lambda t: (  # noqa: E731
        p * (p - 1) * t ** (p - 2) + 0.4 * part * t ** (p - g) + np.sin(motion(t))
    )[:, None]
    arguments = pendulum(force=force, x0=1, v0=0.5, final_time=4)
    solution = solve_volterra(1, [(g, 0.4)], **arguments)
    times = np.linspace(0.01, 4, 50)
    assert_same(solution, times, (motion(times), 0.5 + p * times ** (p - 1)))


def test_convergence_of_the_volterra_equation():
    scene = pendulum(x0=2.5, v0=0, final_time=10)
    fine = solve_volterra(1, [(0.6, 0.3)], **scene)
    times = np.linspace(0.1, 10, 77)
    errors = []
    for tolerance in (1e-3, 1e-5, 1e-7):
        run = solve_volterra(1, [(0.6, 0.3)], **scene, tolerance=tolerance, n_nodes=6)
        errors.append(np.max(np.abs(run.position(times) - fine.position(times))))
        assert errors[-1] < 3 * run.error[0] + 1e-13
    assert errors[0] > 10 * errors[1] > 100 * errors[2] > 0


@pytest.mark.parametrize("coefficient", [2.55, 30.0])
def test_a_series_that_does_not_converge_is_refused(coefficient):
    # C s**1.983 is as large as s**2 until s = C**59
    scene = {"x0": 0, "v0": 1, "final_time": 5, "derivative": "riemann-liouville"}
    with pytest.raises(ArithmeticError, match="series"):
        solve_volterra(1, [(1.983, coefficient)], None, None, None, **scene)


def test_components_of_unlike_scales_do_not_meet():
    def gradient(x):
        return np.stack([x[:, 0], np.sin(x[:, 1])], axis=1)

    def hessian(x):
        found = np.zeros((len(x), 2, 2))
        found[:, 0, 0], found[:, 1, 1] = 1, np.cos(x[:, 1])
        return found

    both = solve_volterra(np.eye(2), [(0.5, 0.1)], gradient, hessian, None, [7e6, 2.5], [0, 0], 8)
    single = solve_volterra(1, [(0.5, 0.1)], **pendulum(x0=2.5, v0=0, final_time=8))
    times = np.linspace(0.1, 8, 40)
    assert_allclose(both.position(times)[:, 1], single.position(times)[:, 0], atol=1e-12)


def test_ordinary_motions():
    mass, damping = np.array([[2, 0.3], [0.3, 1]]), np.array([[0.2, 0.1], [0.1, 0.4]])
    stiffness = np.array([[5.0, -2], [-2, 3]])
    known = classical_response(mass, damping, stiffness, [1, 0], [0, 1], TIMES)
    found = solve_ordinary(
        lambda t, x, v, z: np.linalg.solve(mass, -stiffness @ x - damping @ v), [1, 0], [0, 1], 20
    )
    assert_allclose(found.position(TIMES), known[0], atol=2e-11)
    assert_allclose(found.velocity(TIMES), known[1], atol=2e-11)
    order_one = solve_volterra(
        mass, [(1.0, damping)], **linear(stiffness, x0=[1, 0], v0=[0, 1], final_time=20)
    )
    assert_same(order_one, TIMES, known)
    swing = solve_volterra(1, [(1.0, 0.2)], **pendulum(x0=2.5, v0=1, final_time=20))
    ode = solve_ordinary(lambda t, x, v, z: -np.sin(x) - 0.2 * v, 2.5, 1, 20)
    assert_same(swing, TIMES, (ode.position(TIMES), ode.velocity(TIMES)), 1e-10)


def test_relaxation_by_internal_variables():
    times = [0.5, 4.0]
    law = talbot.prony([2, 1], [0.1, 1.0], relaxed=3.0)
    known = talbot.linear_response(1, 0, [], 1, 0.5, times, laws=[law], degree=80)
    found = solve_ordinary(
        lambda t, x, v, z: -3 * x - 2 * z[0] - z[1], 1, 0.5, 4, relaxation_times=[0.1, 1.0]
    )
    assert_allclose(found.position(times), known[0], atol=1e-11)
    assert_allclose(found.velocity(times), known[1], atol=1e-11)
    # Zener's law of order 1 is one of Prony; one of order .99 is not
    for order, same in ((1.0, True), (0.99, False)):
        laws = [talbot.zener(order, 0.5, 2.0, 7.0)]
        one = talbot.linear_response(1, 0, [], 1, 0, [3.0], laws=laws, degree=60)[0]
        laws = [talbot.prony([5.0], [0.5], relaxed=2.0)]
        other = talbot.linear_response(1, 0, [], 1, 0, [3.0], laws=laws, degree=60)[0]
        assert bool(abs(one - other).max() < 1e-13) is same


def test_loads_that_begin_later_and_powers_of_time():
    terms, times = [(0.7, 0.4), (1.6, 0.2)], [0.5, 6.0]
    loads = [talbot.sine(2.0, 0.7, start=1.5), talbot.power(-0.5, 0.3)]
    known = talbot.linear_response(1, 2, terms, 0, 0.3, times, loads=loads, degree=60)
    arguments = linear(
        2,
        force=lambda t: np.where(t > 1.5, 0.7 * np.sin(2 * (t - 1.5)), 0.0)[:, None],
        x0=0,
        v0=0.3,
        final_time=6,
        breaks=[1.5],
    )
    assert_same(solve_volterra(1, terms, **arguments, powers=[(-0.5, 0.3)]), times, known)
    with pytest.raises(AssertionError):
        assert_same(solve_volterra(1, terms, **arguments), times, known, 1e-3)
