"""The page of benches says what is said of coarse samples, and its drawn data are right."""

import numpy as np
import pytest

from benchmarks.fit_benches import (
    FEWEST,
    MOST_PER_PERIOD,
    SMOOTH,
    drawn_bench,
    samples_per_period,
    smooth_bench,
)
from benchmarks.fit_coverage import between_lines, covered_between
from fvi_cli.studies.fits.model import MotionModel, rms

DRAWS = np.random.default_rng(11).integers(0, 10**6, 3).tolist()


def misfit(kind):
    """RMS difference of the forces at the truth, by the program and by the closed form."""
    model = MotionModel(kind.model, kind.data, [1.0])
    point = np.array([one.inner(v) for one, v in zip(model.free, kind.truth, strict=True)])
    model.remesh(point, 1e-9)
    return rms(model.evaluate(point, with_jacobian=False).residuals)


@pytest.mark.slow
@pytest.mark.parametrize("number", DRAWS)
def test_the_drawn_forces_are_those_of_the_displacement_up_to_its_samples(number):
    kind = drawn_bench(number)
    assert FEWEST <= samples_per_period(number) <= MOST_PER_PERIOD
    assert kind.name == SMOOTH
    again = drawn_bench(number)
    assert np.array_equal(kind.series[0].values, again.series[0].values)
    coarse, fine = (misfit(smooth_bench(per_period, 1.0)) for per_period in (20, 200))
    # straight lines: the error falls with the interval or faster
    assert fine < 0.12 * coarse
    largest = float(np.abs(kind.series[0].values).max())
    assert 1e-4 * largest < misfit(kind) < 0.2 * largest


def row(said, again, straight, followed, failed=False):
    return (said, again, *straight, *followed, failed, False)


def test_shares_are_those_of_the_answers():
    good, half = (True, True), (True, False)
    rows = [
        row(True, False, half, good),
        row(True, True, half, half),
        row(False, False, good, good),
        row(False, False, half, half),
        row(True, False, half, good, failed=True),
    ]
    lines = between_lines({"6 to 10": rows, "none": [], "all said": rows[:2]})
    assert lines[-2] == ("| 6 to 10 | 5 | 50 | 25 | 62.5 | 75.0 | 75.0 | 12.5 | 1 | 0 |")
    assert lines[-1].startswith("| all said | 2 | 100 | 50 | 50.0 | - | 75.0 |")


@pytest.mark.slow
def test_a_coarse_displacement_is_fitted_as_its_remark_asks_for():
    number = next(n for n in range(100) if samples_per_period(n) < 9)
    ((said, _, *answers),) = covered_between(drawn_bench, [number])
    assert said
    straight, followed = answers[:4], answers[4:8]
    assert sum(followed) >= sum(straight)
    assert not any(answers[8:])
