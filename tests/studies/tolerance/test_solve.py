"""A tolerance that is reported as met is met, at any time; where it is not, the run says why."""

from collections.abc import Callable

import numpy as np
import pytest
from letters import spring, swing
from oracles.linear_response import match_scene

import fvi_cli as fvi
from fvi_cli.effects.sampled import FunctionForce

Array = np.ndarray


def damping(order: float, coefficient: float) -> list[fvi.FractionalDamping]:
    return [fvi.FractionalDamping(order=order, coefficient=np.array([[coefficient]]))]


def forced(text: str, **more) -> fvi.Scene:
    return spring(forcing=text, **more)


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


def test_a_tolerance_below_what_round_off_leaves_says_until_when_runs_agree():
    run = fvi.solve(SEPARATRIX, tolerance=1e-12)
    assert run.met is False
    assert error(run, separatrix) <= 5.0 * run.error_estimate
    until = float(run.assessment.reason.rpartition(" ")[2])
    early = np.linspace(0.0, until, 501)[:-1]
    assert np.abs(run(early)[:, 0] - separatrix(early)).max() < 1e-11


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
    assert fvi.solve(scene, tolerance=1e-9).met
    assert fvi.solve(scene, relative=1e-9).error_estimate == 0.0


@pytest.mark.parametrize("given", [{"tolerance": 1e-18}, {"relative": 1e-16}])
def test_tolerances_below_the_floor_say_what_is_reached(given):
    scene = spring(T=5.0, x=1.0, damping=damping(0.5, 0.3))
    run = fvi.solve(scene, **given)
    assert not run.met
    assert error(run, exact(scene)) <= 3.0 * run.error_estimate <= 1e-13


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
    assert told.met
    if run.met:
        check(run, told, tolerance)
