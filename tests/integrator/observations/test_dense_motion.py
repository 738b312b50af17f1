"""What lies between the points of a mesh has the order of the points; forces do too."""

import mpmath
import numpy as np
import pytest
from letters import spring, swing
from numpy.typing import NDArray
from oracles.contour import talbot_inverse

import fvi_cli as fvi
from fvi_cli.scenes.chains import frame
from fvi_cli.scenes.lagrangian import double_pendulum

Array = NDArray[np.float64]

FINAL_TIME, STEPS = 4.0, (24, 48, 96)
SHEAR = "ax1 + ax2 + ax3 + 3*sin(3*t)"
FRAME = frame(
    storeys=3,
    stiffness=10.0,
    dampers=[(0.5, 0.5)],
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


@pytest.mark.few(1)
@pytest.mark.parametrize("method", ["gauss3", "gauss4"])
def test_base_shear_from_accelerations_is_as_good_as_the_position(method, control):
    good = 0
    for n_steps in STEPS:
        run = _run(FRAME, method, n_steps, quantities={"shear": SHEAR})
        off = np.abs(run.position[:, 2] - control[1]).max() / np.abs(control[1]).max()
        force = np.abs(run.observed.quantities["shear"] - control[0]).max()
        assert force / np.abs(control[0]).max() < 10 * off + 1e-11
        good += off < 1e-8
    assert good  # some N has the accuracy that this is about


def test_dense_output_keeps_the_order_of_the_method(control):
    errors = [
        np.abs(_run(FRAME, "gauss3", n).position[:, 2] - control[1]).max() for n in (24, 48, 96)
    ]
    slopes = -np.diff(np.log2(errors))
    assert abs(slopes[-1] - 6.0) < 0.3
    # the polynomials of the steps themselves have order 4
    own = [
        np.abs(
            fvi.integrate(FRAME, "gauss3-graded", n, with_steps=True)(TIMES[:-1] + 0.01)[:, 2]
            - _run_at(TIMES[:-1] + 0.01)
        ).max()
        for n in (32, 64)
    ]
    assert -np.diff(np.log2(own))[0] < 4.7


def _run_at(times: Array) -> Array:
    return fvi.integrate(FRAME, "gauss6", 200, output=times).position[:, 2]


@pytest.mark.few(1)
@pytest.mark.parametrize("order", [0.3, 1.0, 1.6])
def test_velocity_acceleration_and_damping_force_of_a_pendulum(order):
    scene = swing((order, 0.4), T=4.0, x=1.5, v=0.3)
    asked = {"v": "vx", "a": "ax", "d": "dx", "balance": "ax + sin(x) - dx"}
    coarse = _run(scene, "gauss4", 64, quantities=asked)
    fine = _run(scene, "gauss6", 160, quantities=asked)
    for name in ("v", "a", "d"):
        off = coarse.observed.quantities[name] - fine.observed.quantities[name]
        assert np.abs(off).max() < 3e-8, name
    assert np.abs(coarse.observed.quantities["balance"]).max() < 1e-14


def test_damping_force_of_order_one_and_of_a_known_motion():
    linear = spring((1.0, 0.7), T=4.0, m=1.0, k=2.0, x=1.0, v=-0.5)
    run = fvi.integrate(linear, "gauss4", 40, quantities={"d": "dx", "v": "vx"})
    force, velocity = run.observed.quantities["d"], run.observed.quantities["v"]
    assert np.abs(force + 0.7 * velocity).max() < 1e-9
    # x = t**2.5: the derivative of order 3/2 is Gamma(7/2) t
    known = fvi.build_problem(
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
    scene = double_pendulum(joints=[(0.5, 0.3)], initial_position=[1.0, 0.5], final_time=4.0)
    asked = {"a": "atheta1", "v": "vtheta1"}
    step = 1e-3
    times = np.linspace(0.5, 3.5, 7)
    run = fvi.integrate(scene, "gauss4", 120, output=times, quantities=asked)
    beside = [
        fvi.integrate(scene, "gauss4", 120, output=times + shift, quantities=asked)
        for shift in (-2 * step, -step, step, 2 * step)
    ]
    v = [one.observed.quantities["v"] for one in beside if one.observed is not None]
    slope = (v[0] - 8 * v[1] + 8 * v[2] - v[3]) / (12 * step)
    assert np.abs(run.observed.quantities["a"] - slope).max() < 1e-7


@pytest.mark.few(4)
@pytest.mark.parametrize("order", [0.2, 0.5, 0.9, 1.3, 1.7])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_what_is_infinite_at_the_start_is_infinite(order, side):
    start = {"x": side, "v": 0.3} if order < 1 else {"x": 0.0, "v": side}
    scene = spring((order, 0.3), T=4.0, m=1.0, k=1.0, derivative="riemann-liouville", **start)
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


def test_a_caputo_force_is_finite_at_the_start():
    scene = spring((0.5, 0.3), T=4.0, m=1.0, k=1.0, x=1.0)
    found = fvi.integrate(scene, "gauss4", 40, quantities={"d": "dx", "a": "ax"}).observed
    assert np.isfinite([one.peak for one in found.extents.values()]).all()


def test_a_force_that_is_infinite_at_the_start_has_its_power_behind():
    scene = spring((0.5, 0.3), T=4.0, m=1.0, k=1.0, x=1.0, derivative="riemann-liouville")
    run = fvi.integrate(scene, "gauss4", 40, quantities={"d": "dx"})
    force = run.observed.quantities["d"]
    assert np.isfinite(force[1:]).all()
    # what the initial position adds is most of it at first
    assert force[1] == pytest.approx(-0.3 * (np.pi * run.time[1]) ** -0.5, rel=0.2)
