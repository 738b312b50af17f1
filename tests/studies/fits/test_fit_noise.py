"""The noise of several columns: restricted likelihood, its degrees of freedom, what they cover."""

import numpy as np
import pytest
from fit_kinds import (
    KINDS,
    derivatives,
    fit_nearby,
    fitted,
    holds_in_theory,
    holds_truth,
    kind_named,
    noise_of,
)
from oracles.least_squares import restricted_deviations, viscous_motion
from scipy.stats import t as student

from fvi_cli.studies.fits.intervals import CONFIDENCE, quantile
from fvi_cli.studies.fits.model import Evaluation
from fvi_cli.studies.fits.settings import DataSet, FitModel, FitParameter, FitSettings, Series
from fvi_cli.studies.fits.statistics import freedoms, series_freedoms

DRAWS = 600


def sizes_of(kind):
    return [one.values.size for one in kind.series]


def shares_held(*, shared):
    """Coverage of linear problems; with `shared` every column is divided by sqrt(1 - p/n)."""
    sizes, p = [8, 16], 3
    derivatives = np.random.default_rng(2).standard_normal((sum(sizes), p))
    # the first column is the precise one
    derivatives[: sizes[0]] *= 30.0
    held = np.zeros(p)
    for number in range(DRAWS):
        noise = np.random.default_rng([8, number]).standard_normal(sum(sizes))
        deviations = np.ones(len(sizes))
        for _ in range(5):
            weight = np.repeat(1 / deviations, sizes)
            scaled = derivatives * weight[:, None]
            found = np.linalg.lstsq(scaled, noise * weight, rcond=None)[0]
            left = noise - derivatives @ found
            at = Evaluation(residuals=left * weight, jacobian=scaled)
            own = np.array(sizes) * (1 - p / sum(sizes)) if shared else series_freedoms(at, sizes)
            parts = np.split(left, np.cumsum(sizes)[:-1])
            deviations = np.sqrt(np.array([float(part @ part) for part in parts]) / own)
        errors = np.sqrt(np.diag(np.linalg.inv(scaled.T @ scaled)))
        ranks = [sum(sizes) - p] * p if shared else freedoms(at, sizes)
        wide = np.array([quantile(rank, is_known=False) for rank in ranks])
        held += np.abs(found) <= wide * errors
    return held / DRAWS


def test_a_precise_column_pays_for_the_parameters_that_it_determines():
    np.testing.assert_allclose(shares_held(shared=False), CONFIDENCE, atol=0.025)
    # the control: degrees of freedom that all columns share alike
    assert shares_held(shared=True).max() < CONFIDENCE - 0.06


@pytest.mark.few(1)
@pytest.mark.parametrize("ratio", [10, 100])
def test_the_noise_of_columns_is_that_of_restricted_likelihood(ratio):
    kind = kind_named(f"two columns, noises 1:{ratio}")
    found = fitted(kind, 0)
    noise = np.concatenate(noise_of(kind, 0))
    given = np.repeat(kind.deviations, sizes_of(kind))
    expected = restricted_deviations(noise, derivatives(kind) * given[:, None], sizes_of(kind))
    # the motion is not quite linear
    np.testing.assert_allclose([one.deviation for one in found.series], expected, rtol=0.02)


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(3))
def test_the_length_of_an_interval_is_that_of_the_freedom_of_its_column(seed):
    """A short precise column determines all: 5 values less 2 parameters, not 45 less 2."""
    draw = np.random.default_rng([30, seed])
    stiffness, coefficient = draw.uniform(2.0, 9.0), draw.uniform(0.1, 0.6)
    few, many = np.linspace(0.4, 3.6, 5), np.linspace(0.1, 3.9, 40)

    def motion(at):
        return viscous_motion(at, stiffness, coefficient, 0.0)

    speed = (motion(many + 1e-5) - motion(many - 1e-5)) / 2e-5
    x = motion(few) + 1e-5 * draw.standard_normal(few.size)
    vx = speed + 0.1 * draw.standard_normal(many.size)
    series = (
        Series(name="x", column="x", times=few, values=x),
        Series(name="vx", column="vx", times=many, values=vx),
    )
    model = FitModel(
        name="",
        specification={
            "kind": "damped-oscillator",
            "stiffness": stiffness,
            "damping": [{"order": 1.0, "coefficient": coefficient}],
            "initial": {"position": 1.0, "velocity": 0.0},
            "final_time": 4.0,
        },
        parameters=(
            FitParameter(key="problem.stiffness", start=stiffness, low=0.0),
            FitParameter(key="problem.damping.0.coefficient", start=coefficient, low=0.0),
        ),
    )
    data = (DataSet(name="a", series=series),)
    found = fit_nearby(FitSettings(data=data, models=()), model)
    for one in found.estimates:
        times = 0.5 * (one.high - one.low) / one.standard_error
        assert times == pytest.approx(student.ppf(0.975, 3), rel=0.05)
        # the control: as if every value told of it
        assert abs(times / student.ppf(0.975, 43) - 1) > 0.4


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if number in (2, 4) else pytest.mark.slow)
        for number, name in enumerate(KINDS)
    ],
)
def test_intervals_hold_the_truth_where_those_of_the_linear_problem_do(name):
    kind = kind_named(name)
    found = fitted(kind, 0)
    assert found.is_converged
    assert holds_truth(kind, found) == holds_in_theory(kind, 0)
