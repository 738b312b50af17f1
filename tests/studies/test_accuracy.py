"""A tolerance in place of a ladder: what is chosen, kept and refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.planning.resolution import find_resolution
from fvi_cli.scenes.linear_response import match_scene
from fvi_cli.scenes.named import linear_oscillator, pendulum
from fvi_cli.studies.accuracy import reach_tolerance
from fvi_cli.studies.accuracy_results import Reached
from fvi_cli.studies.accuracy_settings import USUAL_CANDIDATES
from fvi_cli.studies.norms import error_norm


def oscillator(order: float, *, coefficient: float = 0.3, **given: object) -> Scene:
    values: dict[str, object] = {"final_time": 8.0, "initial_position": 1.0, **given}
    damping = [FractionalDamping(order=order, coefficient=np.array([[coefficient]]))]
    return linear_oscillator(damping=damping, **values)  # type: ignore[arg-type]


def true_error(scene: Scene, reached: Reached, norm: str = "max") -> float:
    solution = match_scene(scene)
    assert solution is not None
    assert reached.trajectory is not None
    run = reached.trajectory
    return error_norm(run.position, solution.position(run.time), run.step_size, norm)  # type: ignore[arg-type]


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9, 1e-11])
@pytest.mark.parametrize("order", [0.3, 1.0, 1.5, 1.9])
def test_tolerance_is_kept_against_the_characteristic_roots(order: float, tolerance: float) -> None:
    scene = oscillator(order, initial_velocity=0.5)
    reached = reach_tolerance(scene, USUAL_CANDIDATES, tolerance)
    assert reached.verdict == "ok"
    assert reached.estimate <= tolerance
    assert true_error(scene, reached) <= reached.estimate
    assert math.log2(reached.n_steps).is_integer()
    # a ladder without pilots would take as many runs as there are doublings
    assert len(reached.attempts) <= 5


def test_a_run_on_a_quarter_of_the_steps_would_not_have_kept_it() -> None:
    from fvi_cli.integrator.integrate import integrate

    scene = oscillator(1.0)
    reached = reach_tolerance(scene, [Method(cq="gauss", degree=2)], 1e-8)
    solution = match_scene(scene)
    assert solution is not None
    coarse = integrate(scene, reached.method, reached.n_steps // 4)
    error = np.abs(coarse.position - solution.position(coarse.time)).max()
    assert true_error(scene, reached) <= 1e-8 < error


@pytest.mark.parametrize("norm", ["max", "final", "l2"])
def test_every_norm_is_kept(norm: str) -> None:
    scene = oscillator(0.5)
    reached = reach_tolerance(scene, USUAL_CANDIDATES, 1e-7, norm)  # type: ignore[arg-type]
    assert reached.verdict == "ok"
    assert true_error(scene, reached, norm) <= reached.estimate <= 1e-7


def test_only_the_methods_that_are_given_are_used() -> None:
    methods = [Method(cq="bdf2", degree=1, forcing_quadrature="exact")]
    scene = oscillator(0.5)
    reached = reach_tolerance(scene, methods, 1e-4)
    assert (reached.verdict, reached.method) == ("ok", methods[0])
    assert true_error(scene, reached) <= 1e-4
    baseline = Baseline(name="gruenwald-letnikov")
    reached = reach_tolerance(scene, [baseline], 1e-2)
    assert (reached.verdict, reached.method) == ("ok", baseline)
    assert true_error(scene, reached) <= 1e-2


def test_the_cheaper_of_two_methods_is_taken() -> None:
    midpoint, gauss = Method(cq="gauss", degree=1), Method(cq="gauss", degree=3, start="graded")
    for methods in ([midpoint, gauss], [gauss, midpoint]):
        assert reach_tolerance(oscillator(0.5), methods, 1e-10).method == gauss


def test_tolerances_below_round_off_are_refused_with_the_floor() -> None:
    reached = reach_tolerance(oscillator(0.5), USUAL_CANDIDATES, 1e-15)
    assert reached.verdict == "refused"
    assert "below the floor 4.4e-14 of round-off" in reached.message
    # by what comes out: the start says nothing of the size of the motion
    loud = oscillator(0.5, initial_position=0.0, initial_velocity=1e5)
    reached = reach_tolerance(loud, USUAL_CANDIDATES, 1e-10)
    assert reached.verdict == "refused"
    assert "below the floor" in reached.message


def test_break_points_lie_on_the_grid() -> None:
    from fvi_cli.effects.forcing import ForcingPiece
    from fvi_cli.mathematics.expressions import Expression

    def constant(value: str) -> tuple[Expression]:
        return (Expression.parse(value, variables=("t",)),)

    forcing = Forcing(
        pieces=(
            ForcingPiece(components=constant("8"), until=1.0),
            ForcingPiece(components=constant("0")),
        )
    )
    scene = oscillator(1.5, final_time=5.0, initial_position=0.0, forcing=forcing)
    reached = reach_tolerance(scene, USUAL_CANDIDATES, 1e-8)
    assert reached.verdict == "ok"
    assert reached.n_steps % 5 == 0
    assert math.log2(reached.n_steps / 5).is_integer()
    assert true_error(scene, reached) <= 1e-8


def test_a_short_feature_of_the_force_is_not_missed() -> None:
    forcing = Forcing.from_text("exp(-((t - 3.28)/0.004)**2)")
    scene = oscillator(1.0, initial_position=0.0, forcing=forcing)
    reached = reach_tolerance(scene, USUAL_CANDIDATES, 1e-6)
    assert reached.verdict == "ok"
    assert reached.trajectory is not None
    # an impulse of 0.004 sqrt(pi) sets it swinging, damped by exp(-0.15 t)
    largest = 0.004 * math.sqrt(math.pi) * math.exp(-0.15 * math.pi / 2)
    assert np.abs(reached.trajectory.position).max() == pytest.approx(largest, rel=0.05)
    # both of these miss it, and agree
    from fvi_cli.integrator.integrate import integrate

    for n_steps in (8, 16):
        trajectory = integrate(scene, reached.method, n_steps)
        assert np.abs(trajectory.position).max() < 1e-6


def test_stiff_modes_are_not_mistaken_for_rest() -> None:
    # Gauss methods leave an unresolved mode where it is: two coarse runs agree
    scene = linear_oscillator(
        final_time=1.0,
        mass=np.eye(2),
        stiffness=np.diag([1.0, 1e12]),
        damping=[FractionalDamping(order=0.5, coefficient=0.1 * np.eye(2))],
        initial_position=np.array([1.0, 1e-3]),
        initial_velocity=np.zeros(2),
    )
    resolution = find_resolution(scene, 1e-6)
    assert resolution.least_steps == 250_000
    assert "rate 1e+06" in resolution.reason
    # what is smaller than the tolerance may stay unresolved
    assert find_resolution(scene, 1e-2).least_steps < 8


def test_overdamped_layers_are_seen() -> None:
    scene = oscillator(1.0, coefficient=1e5, initial_velocity=1.0, initial_position=0.0)
    assert find_resolution(scene, 1e-8).least_steps == 200_000
    assert find_resolution(scene, 1e-4).least_steps < 8


def test_aliases_of_an_oscillation_do_not_pass() -> None:
    scene = oscillator(1.0, coefficient=0.01, stiffness=1e6, final_time=1.0)
    reached = reach_tolerance(scene, USUAL_CANDIDATES, 1e-3)
    assert reached.verdict == "ok"
    assert true_error(scene, reached) <= 1e-3


def test_nonlinear_scenes_are_refined_by_what_runs_show() -> None:
    scene = pendulum(
        final_time=10.0,
        damping=[FractionalDamping(order=0.5, coefficient=np.array([[0.3]]))],
        initial_position=np.array([1.0]),
    )
    reached = reach_tolerance(scene, USUAL_CANDIDATES, 1e-8)
    fine = reach_tolerance(scene, [Method(cq="gauss", degree=4, start="graded")], 1e-12)
    assert reached.trajectory is not None
    assert fine.trajectory is not None
    every = max(reached.n_steps, fine.n_steps) // min(reached.n_steps, fine.n_steps)
    few, many = sorted(
        (reached.trajectory.position, fine.trajectory.position), key=lambda values: values.shape[0]
    )
    assert np.abs(few - many[::every]).max() <= reached.estimate <= 1e-8


def test_what_cannot_be_reached_is_refused_with_what_was_reached() -> None:
    scene = oscillator(0.5)
    reached = reach_tolerance(scene, [Method(cq="gauss", degree=1)], 1e-11, available_bytes=10**6)
    assert reached.verdict == "refused"
    assert "memory" in reached.message
