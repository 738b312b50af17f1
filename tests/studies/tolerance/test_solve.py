"""A tolerance that is reported as met is met, at any time; where it is not, the run says why."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from letters import spring, swing
from oracles.contour import talbot_inverse
from oracles.linear_response import match_scene

import fvi_cli as fvi
from fvi_cli.effects.sampled import FunctionForce
from fvi_cli.scenes.data import kepler

Array = np.ndarray
CONFIGS = Path(__file__).parents[3] / "configs"


def damping(order: float, coefficient: float) -> list[fvi.FractionalDamping]:
    return [fvi.FractionalDamping(order=order, coefficient=np.array([[coefficient]]))]


def forced(text: str, **more) -> fvi.Scene:
    return spring(forcing=text, **more)


def one_coordinate(lagrangian: str, **more) -> fvi.Scene:
    return fvi.lagrangian_scene(
        coordinates=["x"], lagrangian=lagrangian, **({"initial_velocity": 0.0} | more)
    )


def exact(scene: fvi.Scene) -> Callable[[Array], Array]:
    found = match_scene(scene)
    return found.position


def error(run: fvi.Trajectory, position: Callable[[Array], Array]) -> float:
    """Largest error between the points of the mesh as well as at them."""
    times = np.linspace(0.0, run.time[-1], 1777)
    return float(np.abs(run(times) - position(times).reshape(times.size, -1)).max())


def check(run: fvi.Trajectory, position: Callable[[Array], Array], tolerance: float) -> None:
    assert run.met, run.assessment
    true = error(run, position)
    assert true <= tolerance
    assert true <= 3.0 * run.error_estimate
    assert run.error_estimate <= tolerance


SEPARATRIX = swing(T=12.0, v=2.0)


def separatrix(times: Array) -> Array:
    """2 asin(tanh t), without loss of digits near 1."""
    return 2.0 * np.arctan(np.sinh(times))


@pytest.mark.parametrize("tolerance", [1e-3, 1e-9])
def test_separatrix(tolerance):
    check(fvi.solve(SEPARATRIX, tolerance=tolerance), separatrix, tolerance)


def test_a_tolerance_below_what_round_off_leaves_says_where():
    run = fvi.solve(SEPARATRIX, tolerance=1e-12)
    assert run.outcome == "unreliable"
    assert run.met is False
    assert run.assessment.time is not None
    assert "grows" in run.assessment.reason
    assert error(run, separatrix) <= 5.0 * run.error_estimate


@pytest.mark.few(1)
@pytest.mark.parametrize("potential", ["abs(x)", "max(x, -x)", "x - 2*min(x, 0)"])
def test_kinks(potential):
    run = fvi.solve(
        one_coordinate(f"0.5*vx**2 - ({potential})", initial_position=1.0, final_time=10.0),
        tolerance=1e-6,
    )
    assert run.outcome == "met"
    late = 9.0 - 5.0 * np.sqrt(2.0)
    assert run(9.0)[0] == pytest.approx(0.5 * late**2 - np.sqrt(2.0) * late, abs=1e-6)


LINEAR = {
    "singular force": (forced("t**(-0.5)", damping=damping(0.5, 0.3), final_time=10.0), 1e-8),
    "strong damping": (spring(T=5.0, k=1.0, x=1.0, damping=damping(1.9, 50.0)), 1e-8),
}


@pytest.mark.parametrize("name", LINEAR)
def test_linear_scenes(name):
    scene, tolerance = LINEAR[name]
    check(fvi.solve(scene, tolerance=tolerance), exact(scene), tolerance)


@pytest.mark.parametrize(
    ("order", "coefficient", "frequency", "final_time", "tolerance"),
    [(0.5, 1e-3, 1.0, 100.0, 1e-3), (1.95, 5.0, 300.0, 1.0, 1e-8)],
)
def test_forced_from_rest(order, coefficient, frequency, final_time, tolerance):
    scene = forced(
        f"sin({frequency!r}*t)", damping=damping(order, coefficient), final_time=final_time
    )
    run = fvi.solve(scene, tolerance=tolerance)
    assert run.outcome == "met"
    times = final_time * np.array([0.013, 0.04, 0.2])
    exact_there = talbot_inverse(
        lambda s: frequency / ((s**2 + frequency**2) * (s**2 + coefficient * s**order + 1)),
        times,
        largest_frequency=frequency,
    )
    true = float(np.abs(run(times)[:, 0] - exact_there).max())
    assert true <= tolerance
    assert true <= 3.0 * run.error_estimate


def test_kepler():
    eccentricity = 0.99
    scene = kepler(
        final_time=3.0,
        initial_position=(1 - eccentricity, 0.0),
        initial_velocity=(0.0, float(np.sqrt((1 + eccentricity) / (1 - eccentricity)))),
    )

    def ellipse(times: Array) -> Array:
        low, high = np.zeros_like(times), np.full_like(times, np.pi)
        for _ in range(60):
            middle = 0.5 * (low + high)
            late = middle - eccentricity * np.sin(middle) > times
            low, high = np.where(late, low, middle), np.where(late, middle, high)
        return np.stack(
            [np.cos(low) - eccentricity, np.sqrt(1 - eccentricity**2) * np.sin(low)], axis=1
        )

    check(fvi.solve(scene, tolerance=1e-4), ellipse, 1e-4)


def test_units_do_not_matter():
    def heavy(unit: float) -> fvi.Scene:
        return spring(
            T=8.0,
            m=unit,
            k=2.0 * unit,
            damping=damping(0.5, 0.7 * unit),
            forcing=f"{unit!r}*sin(t)",
        )

    small, large = (fvi.solve(heavy(unit), tolerance=1e-8) for unit in (1.0, 1e9))
    assert small.time == pytest.approx(large.time, rel=1e-12)


def test_relative_tolerances():
    scene = swing(T=20.0, x=1e-3, damping=damping(0.5, 0.3))
    run, finer = fvi.solve(scene, relative=1e-5), fvi.solve(scene, relative=1e-11)
    assert run.assessment.tolerance == pytest.approx(1e-8, rel=1e-6)
    check(run, finer, 1e-8)


def test_what_never_moves():
    scene = spring(T=1.0)
    assert fvi.solve(scene, tolerance=1e-9).outcome == "met"
    refused = fvi.solve(scene, relative=1e-9)
    assert refused.outcome == "refused"
    assert "stays at zero" in refused.assessment.reason


@pytest.mark.parametrize("given", [{"tolerance": 1e-18}, {"relative": 1e-16}])
def test_tolerances_below_the_floor_say_what_is_reached(given):
    scene = spring(T=5.0, x=1.0, damping=damping(0.5, 0.3))
    run = fvi.solve(scene, **given)
    assert run.outcome == "refused"
    assert "out of reach: the best error reached is" in run.assessment.reason
    assert error(run, exact(scene)) <= 3.0 * run.error_estimate <= 1e-13


def test_samples_are_points_of_the_mesh():
    """A triangle of samples against the same force in pieces with its exact response."""
    knots = np.arange(0.0, 4.01, 0.5)
    values = np.where(np.arange(knots.size) % 2 == 0, 0.0, 1.0)
    sampled = fvi.SampledForce.through(knots, values, "linear")
    scene = spring(
        T=4.0,
        k=4.0,
        damping=damping(0.5, 0.3),
        forcing=fvi.Forcing(pieces=(fvi.ForcingPiece(components=(sampled,)),)),
    )
    run = fvi.solve(scene, relative=1e-7)
    assert set(knots.tolist()) <= set(run.time.tolist())
    assert run.outcome == "met"
    # an oracle of its own: the response to ramps t^1, summed
    step = exact(forced("t", stiffness=4.0, damping=damping(0.5, 0.3), final_time=4.0))
    times = np.linspace(0.0, 4.0, 401)
    slopes = np.diff(values) / np.diff(knots)
    total = slopes[0] * step(times)[:, 0]
    for begin, change in zip(knots[1:-1], np.diff(slopes), strict=True):
        late = np.maximum(times - begin, 0.0)
        total += change * np.where(late > 0, step(late)[:, 0], 0.0)
    amplitude = np.abs(total).max()
    assert np.abs(run(times)[:, 0] - total).max() <= 1e-7 * amplitude


@pytest.mark.few(1)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-7])
def test_kinks_that_no_formula_tells_of(tolerance):
    """A force that a program computes is run on an unrelated mesh as well."""
    force = FunctionForce(function=lambda t: np.abs(np.sin(t)))
    data = {"damping": damping(0.5, 0.3), "final_time": 10.0}
    scene = spring(forcing=fvi.Forcing(pieces=(fvi.ForcingPiece(components=(force,)),)), **data)
    run, told = (
        fvi.solve(scene, tolerance=tolerance),
        fvi.solve(forced("abs(sin(t))", **data), tolerance=1e-10),
    )
    assert told.outcome == "met"
    if run.outcome == "met":
        check(run, told, tolerance)
