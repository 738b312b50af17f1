"""The reference values of `oracles` against each other and against published ones."""

import math
from pathlib import Path

import mpmath as mp
import numpy as np
import oracles
import pytest
from letters import in_pieces, spring
from oracles.contour import talbot_inverse
from oracles.linear_response import LinearResponse, match_scene
from oracles.ordinary import solve_ordinary
from oracles.volterra import solve_volterra
from scipy.special import gamma, wofz
from spread import spread

import fvi_cli as fvi

TIMES = np.array([1e-3, 0.7, 3.0, 15.0])
LAWS = {
    "none": [],
    "zener": [fvi.fractional_zener(order=0.675, time=0.3, relaxed=2, unrelaxed=7, coefficient=1)],
    "narrow": [fvi.fractional_zener(order=0.97, time=0.3, relaxed=2, unrelaxed=7, coefficient=1)],
    "prony": [fvi.prony(moduli=[1.0, 0.5], times=[0.1, 1.0], coefficient=1.0, relaxed=2.0)],
}
MODULI = {
    "none": lambda s: 0,
    "zener": lambda s: 5 * (0.3 * s) ** mp.mpf("0.675") / (1 + (0.3 * s) ** mp.mpf("0.675")),
    "narrow": lambda s: 5 * (0.3 * s) ** mp.mpf("0.97") / (1 + (0.3 * s) ** mp.mpf("0.97")),
    "prony": lambda s: s / (s + 10) + 0.5 * s / (s + 1),
}
"""What the laws have beside their relaxed moduli."""
FORCES = {"2": lambda s: 2 / s, "sin(1.3*t)": lambda s: 1.3 / (s**2 + 1.69)}


def test_what_integrates_uses_nothing_of_the_package():
    folder = Path(oracles.__file__).parent
    names = ("volterra", "elements", "ordinary", "contour", "impacts", "eigenvalues")
    texts = [(folder / f"{name}.py").read_text(encoding="utf-8") for name in names]
    assert not any("fvi_cli" in text for text in texts)


@pytest.mark.few(4)
@spread(name=LAWS, force=FORCES, order=[0.05, 0.5, 0.97, 1.03, 1.5, 1.95], size=[0.0, 0.05, 3.0])
def test_linear_motions_are_those_of_laplace_inversion(name, force, order, size):
    scene = spring(
        *[(order, size)] * (size > 0), T=20.0, m=1.5, k=2.0, x=1.0, v=0.5,
        laws=LAWS[name], forcing=force,
    )  # fmt: skip
    stiffness, law = float(scene.stiffness[0, 0]), MODULI[name]

    def transform(s):
        damping = size * s ** mp.mpf(order)
        start = 1.5 * (s + 0.5) + (law(s) + damping) / s + damping / s**2 * 0.5 * (order > 1)
        return (start + FORCES[force](s)) / (1.5 * s**2 + damping + law(s) + stiffness)

    expected = talbot_inverse(transform, TIMES.tolist(), largest_frequency=8.0)
    found = match_scene(scene).position(TIMES)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=5e-14)


def half_order_response(order, t, c, k, x0, v0):
    r"""x of :math:`x'' + c D^\gamma x + k x = 0`, Caputo, order 1/2 or 3/2.

    With :math:`z = \sqrt{s}`, :math:`z X(z) = \sum_i A_i / (z - r_i)` over the roots of
    :math:`z^4 + c z^{2\gamma} + k`, and :math:`x(t) = \sum_i A_i w(-i r_i \sqrt{t})`, w the
    function of Faddeeva (J.L. Gonzalez-Santander, A. Apelblat, arXiv 2501.05972).
    """
    below = np.array([1.0, 0.0, 0.0, 0.0, k])
    below[4 - round(2 * order)] += c
    above = [x0, 0.0, v0, c * x0] if order == 0.5 else [x0, c * x0, v0, c * v0]
    roots = np.roots(below)
    weights = np.polyval(above, roots) / np.polyval(np.polyder(below), roots)
    return (wofz(-1j * np.multiply.outer(np.sqrt(t), roots)) @ weights).real


@spread(order=[0.5, 1.5], coefficient=[0.01, 0.5, 1.0, 2.5, -0.3])
def test_half_orders_by_faddeeva_functions(coefficient, order):
    times = np.linspace(0.0, 20.0, 101)
    expected = half_order_response(order, times, coefficient, 25.0, 0.9, -0.4)
    found = match_scene(spring((order, coefficient), T=20.0, k=25.0, x=0.9, v=-0.4))
    scale = 2e-12 * np.abs(expected).max()
    assert found.position(times)[:, 0] == pytest.approx(expected, abs=scale)


def test_published_values_and_a_wrong_zero():
    """x'' + D^g x + x = 0 from 1 long after the start; the force 8 that stops at t = 1."""
    for order, times, known, accuracy in (
        (0.5, [1.0, 100.0, 1000.0], [0.612261785758467, 0.0561329416629, 0.0178323072601], 1e-11),
        (1.5, [100.0, 1000.0], [-2.81851277911e-4, -8.92055356e-6], 2e-8),
    ):
        free = match_scene(spring((order, 1.0), T=1000.0, x=1.0))
        np.testing.assert_allclose(free.position(np.array(times))[:, 0], known, rtol=accuracy)
    stopped = match_scene(spring((1.5, 1.0), T=30.0, forcing=in_pieces("8", 1.0, "0")))
    times = np.array([0.5, 1, 2, 5, 20])
    known = [0.684334753155031, 2.315525822792576, 4.425462195857781]
    known += [-0.4556413405384094, 0.187375156942063]
    np.testing.assert_allclose(stopped.position(times)[:, 0], known, atol=1e-13)
    # the control
    (response,) = stopped.responses
    wrong = LinearResponse(response.equation, response.inputs)
    wrong.equation.__dict__["zeros"] = response.equation.zeros * (1 + 1e-10)
    assert np.abs(wrong(times) - known).max() > 1e-11


def test_modes_of_a_chain_pieces_and_derivatives():
    stiffness, times = np.array([[2.0, -1.0], [-1.0, 2.0]]), np.linspace(0.0, 10.0, 33)
    damping = 0.1 * np.eye(2) + 0.05 * stiffness
    start = {"x": [1.0, 0.0], "v": [0.0, 0.5]}
    chain = spring((0.7, damping), T=10.0, m=np.eye(2), k=stiffness, **start)
    one, other = (
        match_scene(spring((0.7, 0.1 + 0.05 * k), T=10.0, k=k, x=0.5, v=v)).position(times)
        for k, v in ((1.0, 0.25), (3.0, -0.25))
    )
    expected = np.concatenate([one + other, one - other], axis=1)
    assert match_scene(chain).position(times) == pytest.approx(expected, abs=1e-13)
    stopped, ramp = (
        match_scene(spring((0.5, 0.3), T=10.0, k=2.0, forcing=force)).position
        for force in (in_pieces("t", 2.0, "2"), "t")
    )
    late = ramp(times) - ramp(np.maximum(times - 2.0, 0.0))
    assert stopped(times) == pytest.approx(late, abs=1e-13)
    # Riemann-Liouville: the known force -mu x0 t^(-1/2) / Gamma(1/2) more
    forced, riemann = (
        match_scene(spring((0.5, 1.0), T=10.0, x=1.0, **more)).position(TIMES)
        for more in (
            {"forcing": f"{-1 / math.sqrt(math.pi)!r}*t**(-0.5)"},
            {"derivative": "riemann-liouville"},
        )
    )
    assert forced == pytest.approx(riemann, abs=2e-14)


@pytest.mark.parametrize(
    "unknown",
    [
        spring((0.5, 1.0), T=10.0, forcing="exp(t)"),
        spring(T=10.0, forcing=in_pieces("sqrt(t)", 1.0, "0")),
        spring((0.5, np.array([[1.0, 0.3], [0.3, 1.0]])), T=1, m=np.eye(2), k=np.diag([1.0, 2.0])),
    ],
)
def test_scenes_without_a_closed_form_are_refused(unknown):
    with pytest.raises(ValueError, match=r"powers|polynomials|modes"):
        match_scene(unknown)


# --- collocation ----------------------------------------------------------------------------------


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


def farthest(solution, times, known):
    """Largest difference of positions, of each component in its own size."""
    values = np.asarray(known).reshape(len(times), -1)
    return float(np.max(np.abs(solution.position(times) - values) / np.abs(values).max(axis=0)))


@spread(few=1, seed=range(4))
def test_collocation_of_random_linear_scenes_is_laplace_inversion(seed):
    random = np.random.default_rng([25, seed])
    derivative = ["caputo", "riemann-liouville"][seed % 2]
    orders = random.uniform(0.05, 1.0, 1) if seed == 3 else random.uniform(0.05, 1.95, 2)
    root, other = random.standard_normal((2, 2, 2))
    stiffness, mass = root @ root.T + np.eye(2), other @ other.T + np.eye(2)
    # a unit of time and one of length that are not 1
    period, length = 10.0 ** random.uniform(-6, 6, 2)
    sizes = 10 ** random.uniform(-2, 0, orders.size)
    terms = [
        (float(g), c * period ** (g - 2) * np.diag(random.random(2)))
        for g, c in zip(orders, sizes, strict=True)
    ]
    stiffness /= period**2
    x0 = length * random.standard_normal(2) * (derivative == "caputo" or max(orders) < 1)
    v0 = length / period * random.standard_normal(2)
    times = [0.01 * period, 5.0 * period]

    def transform(s, component):
        total = mp.matrix(mass.tolist()) * s**2 + mp.matrix(stiffness.tolist())
        start = mp.matrix((mass @ x0).tolist()) * s + mp.matrix((mass @ v0).tolist())
        for g, c in terms:
            total += mp.matrix(c.tolist()) * s ** mp.mpf(g)
            if derivative == "caputo":
                start += mp.matrix((c @ x0).tolist()) * s ** mp.mpf(g - 1)
                start += mp.matrix((c @ v0).tolist()) * s ** mp.mpf(g - 2) * (g > 1)
        return mp.lu_solve(total, start)[component]

    known = [
        talbot_inverse(lambda s, n=n: transform(s, n), times, largest_frequency=3 / period)
        for n in range(2)
    ]
    arguments = linear(stiffness, x0=x0, v0=v0, final_time=times[-1], derivative=derivative)
    solution = solve_volterra(mass, terms, **arguments)
    assert farthest(solution, times, np.transpose(known)) < 1e-12
    assert np.all(solution.error < 1e-12 * solution.scale()[0])
    # a wrong order and a datum that is left out are seen
    wrong = [(terms[0][0] + 1e-6, terms[0][1]), *terms[1:]]
    assert farthest(solve_volterra(mass, wrong, **arguments), times, np.transpose(known)) > 1e-11
    slower = {**arguments, "v0": v0 * (1 - 1e-9)}
    assert farthest(solve_volterra(mass, terms, **slower), times, np.transpose(known)) > 1e-12


def test_a_chosen_motion_of_a_pendulum():
    # x = 1 + t/2 + t**2.2 at order 1.3, from the derivative of a power
    g, p = 1.3, 2.2
    motion = lambda t: 1 + t / 2 + t**p  # noqa: E731
    part = gamma(p + 1) / gamma(p + 1 - g)
    force = lambda t: (  # noqa: E731
        p * (p - 1) * t ** (p - 2) + 0.4 * part * t ** (p - g) + np.sin(motion(t))
    )[:, None]
    solution = solve_volterra(
        1, [(g, 0.4)], **pendulum(force=force, x0=1, v0=0.5, final_time=4), tolerance=1e-13
    )
    times = np.linspace(0.01, 4, 50)
    assert farthest(solution, times, motion(times)) < 1e-12
    np.testing.assert_allclose(
        solution.velocity(times)[:, 0], 0.5 + p * times ** (p - 1), rtol=1e-11
    )


def test_ordinary_motions_and_internal_variables():
    times = np.array([1.0, 5.0, 20.0])
    swinging = solve_volterra(1, [(1.0, 0.2)], **pendulum(x0=2.5, v0=1, final_time=20))
    ode = solve_ordinary(lambda t, x, v, z: -np.sin(x) - 0.2 * v, 2.5, 1, 20)
    assert farthest(swinging, times, ode.position(times)) < 1e-10
    scene = spring(T=20.0, k=1.0, x=1.0, v=0.5, laws=LAWS["prony"])
    found = solve_ordinary(
        lambda t, x, v, z: -3 * x - z[0] - 0.5 * z[1], 1, 0.5, 20, relaxation_times=[0.1, 1.0]
    )
    assert farthest(found, times, match_scene(scene).position(times)) < 1e-10
