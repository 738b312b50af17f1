"""One x(t): order 2m at the points of the mesh, m + 1 between them, whoever evaluates it."""

import mpmath
import numpy as np
import pytest
from letters import spring
from numpy.typing import NDArray
from oracles.contour import talbot_inverse

import fvi_cli as fvi
from fvi_cli.scenes.data import duffing
from fvi_cli.scenes.lagrangian import double_pendulum
from fvi_cli.scenes.registry import build_problem
from fvi_cli.scenes.structures import frame

Array = NDArray[np.float64]

FINAL_TIME, STEPS = 4.0, (24, 48, 96)
SHEAR = "ax1 + ax2 + ax3 + 3*sin(3*t)"
FRAME = frame(
    storeys=3,
    stiffness=10.0,
    dampers=[fvi.FractionalDamping(order=0.5, coefficient=0.5)],
    ground_acceleration=fvi.Forcing.from_text("sin(3*t)"),
    final_time=FINAL_TIME,
)
TIMES = np.linspace(0.0, FINAL_TIME, 13)[1:]


@pytest.fixture(scope="module")
def control() -> tuple[Array, Array]:
    """Base shear and top displacement, mode by mode, by inversion of their Laplace transforms."""
    shape = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    values, modes = np.linalg.eigh(shape)
    shares = modes.sum(axis=0)

    def moved(s: mpmath.mpc, weights: Array) -> mpmath.mpc:
        stiffness = 10 + mpmath.sqrt(s) / 2
        per_mode = [w / (s**2 + stiffness * k) for w, k in zip(weights, values, strict=True)]
        return -3 / (s**2 + 9) * sum(per_mode)

    def shear(s: mpmath.mpc) -> mpmath.mpc:
        return s**2 * moved(s, shares**2) + 9 / (s**2 + 9)

    def top(s: mpmath.mpc) -> mpmath.mpc:
        return moved(s, modes[2] * shares)

    found = [talbot_inverse(f, TIMES.tolist(), largest_frequency=6.0) for f in (shear, top)]
    return found[0], found[1]


def _run(scene: fvi.Scene, method: str, n_steps: int, **asked: object) -> fvi.Trajectory:
    return fvi.integrate(scene, method, n_steps, output=TIMES, **asked)


@pytest.mark.parametrize("degree", [2, 3])
def test_the_order_is_2m_at_points_and_m_plus_1_between(degree, control):
    at_points = [
        np.abs(_run(FRAME, f"gauss{degree}", n).position[:, 2] - control[1]).max() for n in STEPS
    ]
    times = np.linspace(0.0, FINAL_TIME, 2001)
    fine = fvi.integrate(FRAME, "gauss8", 400, output=times).position
    between = [
        np.abs(fvi.integrate(FRAME, f"gauss{degree}", n, output=times).position - fine).max()
        for n in STEPS
    ]
    for errors, order in ((at_points, 2 * degree), (between, degree + 1)):
        assert abs(-np.diff(np.log2(errors))[-1] - order) < 0.3
    # the control: the orders of both are told apart
    assert at_points[-1] < 0.3 * between[-1]


def test_forces_have_the_order_of_the_stages(control):
    errors = [
        np.abs(
            _run(FRAME, "gauss3", n, quantities={"shear": SHEAR}).observed.quantities["shear"]
            - control[0]
        ).max()
        for n in STEPS
    ]
    assert 2.7 < -np.diff(np.log2(errors))[-1] < 4.3


def test_momenta_at_points_of_the_mesh_are_those_of_the_method():
    whole = fvi.integrate(FRAME, "gauss2", 24)
    run = fvi.integrate(FRAME, "gauss2", 24, output=whole.time)
    assert np.array_equal(run.momentum, whole.momentum)
    assert run.energy == pytest.approx(whole.energy, abs=1e-14)


CHAOS = duffing(
    stiffness=-1.0,
    cubic_stiffness=1.0,
    damping=[fvi.FractionalDamping(order=0.8, coefficient=0.2)],
    forcing=fvi.Forcing.from_text("0.3*cos(1.1*t)"),
    initial_position=0.1,
    final_time=240.0,
)


def test_whoever_evaluates_a_chaotic_motion_finds_the_same():
    times = np.linspace(0.3, 239.7, 401)
    run = fvi.integrate(
        CHAOS, "gauss4", 1680, output=times, quantities={"x": "x", "v": "vx"}, with_steps=True
    )
    found = run.observed.quantities
    assert np.abs(run(times) - run.position).max() < 1e-13
    assert np.abs(run(times)[:, 0] - found["x"]).max() < 1e-13
    assert np.abs(run.velocity(times)[:, 0] - found["v"]).max() < 1e-12
    for name, quantity in (
        ("x", fvi.position_at(float(times[301]))),
        ("v", fvi.quantity_at("vx", float(times[301]))),
    ):
        by_gradient = fvi.gradient(CHAOS, "gauss4", 1680, quantity, ["initial_position"])
        assert by_gradient.value == pytest.approx(found[name][301], abs=1e-12)
    # the control: another method has parted from this one
    other = fvi.integrate(CHAOS, "gauss5", 1680, output=times)
    assert np.abs(other.position - run.position).max() > 0.1


def test_damping_force_and_acceleration_of_a_known_motion():
    # x = t**2.5: the derivative of order 3/2 is Gamma(7/2) t
    known = build_problem(
        {
            "kind": "bagley-torvik",
            "mass": 1.0,
            "stiffness": 1.0,
            "damping": [{"order": 1.5, "coefficient": 1.0}],
            "forcing": "15/4*sqrt(t) + 15/8*sqrt(pi)*t + t**2.5",
            "final_time": 4.0,
        }
    )
    run = _run(known.scene, "gauss4", 40, quantities={"d": "dx", "a": "ax"})
    force = run.observed.quantities["d"] + 15 / 8 * np.sqrt(np.pi) * TIMES
    assert np.abs(force).max() < 1e-6
    assert np.abs(run.observed.quantities["a"] - 15 / 4 * np.sqrt(TIMES)).max() < 1e-6


def test_acceleration_with_a_mass_matrix_that_depends_on_the_position():
    joint = fvi.FractionalDamping(order=0.5, coefficient=0.3)
    scene = double_pendulum(joints=[joint], initial_position=[1.0, 0.5], final_time=4.0)
    asked = {"a": "atheta1", "v": "vtheta1"}
    step = 1e-3
    times = np.linspace(0.5, 3.5, 7)
    run = fvi.integrate(scene, "gauss6", 120, output=times, quantities=asked)
    beside = [
        fvi.integrate(scene, "gauss6", 120, output=times + shift, quantities=asked)
        for shift in (-2 * step, -step, step, 2 * step)
    ]
    v = [one.observed.quantities["v"] for one in beside if one.observed is not None]
    slope = (v[0] - 8 * v[1] + 8 * v[2] - v[3]) / (12 * step)
    assert np.abs(run.observed.quantities["a"] - slope).max() < 1e-7


@pytest.mark.few(2)
@pytest.mark.parametrize("order", [0.2, 0.5, 0.9])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_what_is_infinite_at_the_start_is_infinite(order, side):
    data = {"x": side, "v": 0.3, "derivative": "riemann-liouville"}
    scene = spring((order, 0.3), T=4.0, m=1.0, k=1.0, **data)
    asked = {"d": "dx", "a": "ax", "size": "ax**2", "v": "vx"}
    found = fvi.integrate(scene, "gauss4", 40, quantities=asked).observed
    for name in ("d", "a"):
        assert found.quantities[name][0] == -side * np.inf
        extent = found.extents[name]
        assert (extent.peak, extent.peak_time) == (np.inf, 0.0)
        assert (extent.least if side > 0 else extent.greatest) == -side * np.inf
        assert np.isfinite(extent.greatest if side > 0 else extent.least)
        # of orders of .5 and more infinite, of others a matter of the first step
        assert np.isnan(extent.rms)
    assert found.extents["size"].greatest == np.inf
    assert np.isfinite([found.extents["v"].peak, found.extents["v"].rms]).all()
