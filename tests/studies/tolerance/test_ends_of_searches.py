"""Searches end where steps run out, at failures and at round-off."""

import numpy as np
import pytest
from command_line import fvi as command
from letters import spring
from spread import spread

import fvi_cli as fvi
from fvi_cli.studies.tolerance import search


def test_a_search_whose_steps_run_out_makes_no_further_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = spring((0.5, 0.01), k=1.0, T=50.0, x=1.0)
    assert fvi.solve(scene, tolerance=1e-8).met
    monkeypatch.setattr(search, "MOST_STEPS", 12)
    calls, own = [], search.adaptive_run
    monkeypatch.setattr(search, "adaptive_run", lambda *a: calls.append(a) or own(*a))
    run = fvi.solve(scene, tolerance=1e-8)
    assert not run.met
    assert run.assessment is not None
    assert len(calls) == 1
    assert "the largest number of steps is reached" in run.assessment.reason


@spread(
    few=2, speed=[200.0, 300.0, -300.0, 3.0, 0.3], steps=[1, 8, fvi.AdaptiveSteps(tolerance=1e-4)]
)
def test_a_run_that_fails_at_once_says_why(speed: float, steps: int | fvi.AdaptiveSteps) -> None:
    """No velocity is found from the momentum of a start with a huge one; the start itself stays."""
    scene = fvi.lagrangian_scene(
        coordinates=("x",),
        lagrangian="exp(vx) + exp(-vx) + vx**2/2",
        initial_velocity=speed,
        final_time=1.0,
    )
    run = fvi.integrate(scene, fvi.method_named("gauss3"), steps)
    assert run.position.shape[0] == run.time.size >= 1
    assert run.energy is not None
    assert np.isfinite(run.energy).all()
    # the control: a start from which the motion goes on
    assert (run.status == "ok") == (abs(speed) < 100)
    found = fvi.solve(scene, tolerance=1e-6)
    if run.status != "ok":
        assert not found.met
        assert found.assessment is not None
        assert "t = 0:" in found.assessment.reason


def test_a_tolerance_below_round_off_is_refused_in_every_table(tmp_path):
    (tmp_path / "found.yaml").write_text(
        "name: found\nproblem: {kind: damped-oscillator, "
        "damping: [{order: 0.5, coefficient: 0.3}], initial: {position: 1.0}, final_time: 4.0}\n"
        "accuracy: {tolerance: 1e-18}\n"
    )
    ran = command("run", tmp_path / "found.yaml", "-q", "-o", tmp_path)
    assert ran.exit_code == 1
    assert "refused" in ran.stdout
    # the control: one within reach is met
    given = ("--set", "accuracy.tolerance=1e-8")
    met = command("run", tmp_path / "found.yaml", "-q", "-o", tmp_path, *given, code=0).stdout
    assert "refused" not in met
