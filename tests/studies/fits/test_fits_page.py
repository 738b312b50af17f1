"""The page of fits says what was measured; its data come from elsewhere."""

import numpy as np

from benchmarks.fits import ORDER, TimedFit, covered_in_theory, fits_page, motion, oscillator
from fvi_cli.integrator.gradients.gradient import run_steps
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.scenes.registry import build_scene
from fvi_cli.studies.fits.model import METHOD
from fvi_cli.studies.fits.profile import CONFIDENCE


def test_the_data_are_those_of_the_problem():
    times = np.array([0.3, 4.0, 9.7])
    for order, velocity in ((ORDER, 0.0), (1.7, 0.5)):
        scene = build_scene(oscillator(order, velocity))
        done = run_steps(scene, METHOD, AdaptiveSteps(tolerance=1e-9))
        np.testing.assert_allclose(done(times)[:, 0], motion(order, times, velocity), atol=1e-11)


def test_intervals_of_a_linear_motion_hold_the_truth_as_often_as_they_say():
    held = covered_in_theory(4000).mean(axis=0)
    assert held.shape == (3,)
    np.testing.assert_allclose(held, CONFIDENCE, atol=0.012)


def test_shares_and_failures_are_counted():
    held = [(True, True, False), (True, False, False), (True, True, True), (True, True, True)]
    timed = TimedFit(name="three", seconds=1.25, runs=20, worst=1.5, transform=0.014)
    theory = np.array([[True, True, True], [True, False, True], *[[True, True, True]] * 2])
    page = fits_page({"order 1": 3e-12}, held, theory, [(False,), (True,), (False,)], [timed])
    assert "hold it in 95.0 %, 95.0 % and 45.0 %" in page
    assert "100.0 % (stiffness), 75.0 % (coefficient) and 50.0 % (order)" in page
    assert "From 3 random starts" in page
    assert "1 fits failed" in page
    assert "| three | 1.2 | 0.014 | 20 | 1.5 |" in page
    assert "| order 1 | 3e-12 |" in page
