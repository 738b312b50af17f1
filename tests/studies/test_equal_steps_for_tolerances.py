"""A method and equal steps for a tolerance: what is chosen, kept and refused."""

import math

import numpy as np
import pytest
from letters import in_pieces
from spread import spread

import fvi_cli as fvi
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.data import linear_oscillator, pendulum
from fvi_cli.scenes.lagrangian import double_pendulum
from fvi_cli.scenes.linear_response import match_scene
from fvi_cli.studies.accuracy_settings import USUAL_CANDIDATES
from fvi_cli.studies.norms import error_norm
from fvi_cli.studies.tolerance.equal_steps import solve_on_equal_steps


def oscillator(order: float, *, coefficient: float = 0.3, **given: object) -> Scene:
    values: dict[str, object] = {"final_time": 8.0, "initial_position": 1.0, **given}
    damping = [FractionalDamping(order=order, coefficient=np.array([[coefficient]]))]
    return linear_oscillator(damping=damping, **values)


def solved(scene: Scene, methods: object = USUAL_CANDIDATES, **asked: object) -> Trajectory:
    """A run that must be met."""
    _, run, _ = solve_on_equal_steps(scene, methods, **asked)
    assert run.assessment.outcome == "met", run.assessment
    assert run.assessment.estimate <= run.assessment.tolerance
    assert np.ptp(np.diff(run.time)) <= 1e-9 * run.time[-1]
    return run


def true_error(scene: Scene, run: Trajectory, norm: str = "max") -> float:
    solution = match_scene(scene)
    return error_norm(run.position, solution.position(run.time), run.step_size, norm)


def estimate(run: Trajectory) -> float:
    return run.assessment.estimate


@spread(tolerance=[1e-3, 1e-6, 1e-9, 1e-11], order=[0.3, 1.0, 1.9])
def test_tolerance_is_kept_against_the_characteristic_roots(order, tolerance):
    scene = oscillator(order, initial_velocity=0.5)
    run = solved(scene, tolerance=tolerance)
    assert true_error(scene, run) <= estimate(run)
    assert math.log2(run.n_steps).is_integer()


def test_a_run_on_a_quarter_of_the_steps_would_not_have_kept_it():
    scene, gauss2 = oscillator(1.0), Method(cq="gauss", degree=2)
    run = solved(scene, [gauss2], tolerance=1e-8)
    coarse = integrate(scene, gauss2, run.n_steps // 4)
    assert true_error(scene, run) <= 1e-8 < true_error(scene, coarse)


@pytest.mark.parametrize("norm", ["max", "final", "l2"])
def test_every_norm_is_kept(norm):
    scene = oscillator(0.5)
    run = solved(scene, tolerance=1e-7, norm=norm)
    assert true_error(scene, run, norm) <= estimate(run)


def test_relative_tolerances_do_not_depend_on_the_unit_of_length():
    large, small = (solved(oscillator(0.5, initial_position=x), relative=1e-7) for x in (1e3, 1e-3))
    assert large.n_steps == small.n_steps
    assert estimate(large) == pytest.approx(1e6 * estimate(small), rel=1e-2)


def test_only_the_methods_that_are_given_are_used():
    scene = oscillator(0.5)
    bdf = Method(cq="bdf2", degree=1, forcing_quadrature="exact")
    methods: list[tuple[AnyMethod, float]] = [
        (bdf, 1e-4),
        (Baseline(name="gruenwald-letnikov"), 1e-2),
    ]
    for method, tolerance in methods:
        chosen, run, _ = solve_on_equal_steps(scene, [method], tolerance=tolerance)
        assert chosen == method
        assert true_error(scene, run) <= estimate(run) <= tolerance


def test_the_cheaper_of_two_methods_is_taken():
    midpoint, gauss = Method(cq="gauss", degree=1), Method(cq="gauss", degree=3, start="graded")
    for methods in ([midpoint, gauss], [gauss, midpoint]):
        assert solve_on_equal_steps(oscillator(0.5), methods, tolerance=1e-9)[0] == gauss


def test_break_points_lie_on_the_grid():
    forcing = in_pieces("8", 1.0, "0")
    scene = oscillator(1.5, final_time=5.0, initial_position=0.0, forcing=forcing)
    run = solved(scene, tolerance=1e-8)
    assert math.log2(run.n_steps / 5).is_integer()
    assert true_error(scene, run) <= 1e-8


def test_a_short_feature_of_the_force_is_not_missed():
    scene = oscillator(
        1.0, initial_position=0.0, forcing=Forcing.from_text("exp(-((t - 3.28)/0.004)**2)")
    )
    run = solved(scene, tolerance=1e-4)
    # an impulse of 0.004 sqrt(pi) sets it swinging, damped by exp(-0.15 t)
    largest = 0.004 * math.sqrt(math.pi) * math.exp(-0.15 * math.pi / 2)
    assert np.abs(run.position).max() == pytest.approx(largest, rel=0.05)
    # these miss it, and agree
    for n_steps in (8, 16):
        coarse = integrate(scene, USUAL_CANDIDATES[0], n_steps)
        assert np.abs(coarse.position).max() < 1e-3 * largest


def test_stiff_modes_and_layers_are_not_mistaken_for_rest():
    # Gauss methods leave an unresolved mode where it is: two coarse runs agree
    scene = linear_oscillator(
        final_time=1.0,
        mass=np.eye(2),
        stiffness=np.diag([1.0, 1e4]),
        damping=[FractionalDamping(order=0.5, coefficient=0.1 * np.eye(2))],
        initial_position=np.array([1.0, 1e-2]),
        initial_velocity=np.zeros(2),
    )
    assert solved(scene, tolerance=1e-4).n_steps >= 64
    # what is smaller than the tolerance may stay unresolved
    assert solved(scene, tolerance=0.05).n_steps <= 16
    layer = oscillator(1.0, coefficient=1e2, initial_velocity=1.0, initial_position=0.0)
    assert true_error(layer, solved(layer, tolerance=1e-7)) <= 1e-7
    aliased = oscillator(1.0, coefficient=0.01, stiffness=1e4, final_time=1.0)
    assert true_error(aliased, solved(aliased, tolerance=1e-3)) <= 1e-3


def test_nonlinear_scenes_agree_with_far_more_steps():
    damping = [FractionalDamping(order=0.5, coefficient=np.array([[0.3]]))]
    swing = pendulum(final_time=5.0, damping=damping, initial_position=np.array([1.0]))
    both = double_pendulum(
        final_time=1.0,
        initial_position=np.array([0.8, -0.4]),
        damping=[FractionalDamping(order=0.7, coefficient=0.2 * np.eye(2))],
    )
    for scene in (swing, both):
        run = solved(scene, tolerance=1e-8)
        fine = integrate(scene, USUAL_CANDIDATES[0], 8 * run.n_steps)
        assert np.abs(run.position - fine.position[::8]).max() <= estimate(run)


def test_what_cannot_be_reached_is_refused_with_what_was_reached():
    scene, midpoint = oscillator(0.5), Method(cq="gauss", degree=1)
    for asked, words in (
        ({"tolerance": 1e-11, "available_bytes": 10**6}, "the available memory: the best error"),
        ({"tolerance": 1e-18}, "the best error reached is"),
    ):
        _, run, _ = solve_on_equal_steps(scene, [midpoint], **asked)
        assert run.assessment.outcome == "refused"
        assert words in run.assessment.reason
        assert run.assessment.estimate > 0


@pytest.mark.parametrize("kind", ["rest", "line"])
def test_a_run_without_any_error_meets_every_tolerance(tmp_path, monkeypatch, kind):
    """Nothing pulls: equal steps are exact, and their error is 0."""
    monkeypatch.chdir(tmp_path)
    start = {"rest": (1.0, 0.0), "line": (0.25, 0.5)}[kind]
    (tmp_path / "exact.yaml").write_text(
        "name: exact\nexperiments:\n  - name: a\n    problem: {kind: damped-oscillator, "
        f"stiffness: 0, initial: {{position: {start[0]}, velocity: {start[1]}}}, final_time: 4}}\n"
        "    accuracy: {tolerance: 1.0e-6, mesh: uniform}\n",
        encoding="utf-8",
    )
    (outcome,) = fvi.run("exact.yaml")
    (finished,) = outcome.finished
    assert finished.status in ("ok", "floor")
    assert finished.trajectory.outcome == "met"
