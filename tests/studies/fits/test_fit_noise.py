"""The noise of several columns: restricted likelihood, its degrees of freedom, what they cover."""

import numpy as np
import pytest
from oracles.least_squares import restricted_deviations

from benchmarks.fit_coverage import (
    _derivatives,
    coverage_lines,
    fitted,
    holds_in_theory,
    holds_truth,
    noise_of,
)
from benchmarks.fit_kinds import KINDS, kind_named
from fvi_cli.studies.fits.fitting import fit_model
from fvi_cli.studies.fits.model import Evaluation
from fvi_cli.studies.fits.profile import CONFIDENCE, quantile
from fvi_cli.studies.fits.settings import DataSet, FitSettings, Series
from fvi_cli.studies.fits.statistics import freedoms, own_freedoms

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
            own = np.array(sizes) * (1 - p / sum(sizes)) if shared else own_freedoms(at, sizes)
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


@pytest.mark.parametrize("ratio", [10, 100])
def test_the_noise_of_columns_is_that_of_restricted_likelihood(ratio):
    kind = kind_named(f"two columns, noises 1:{ratio}")
    found = fitted(kind, 0)
    noise = np.concatenate(noise_of(kind, 0))
    given = np.repeat(kind.deviations, sizes_of(kind))
    expected = restricted_deviations(noise, _derivatives(kind) * given[:, None], sizes_of(kind))
    # the motion is not quite linear
    np.testing.assert_allclose([one.deviation for one in found.series], expected, rtol=0.02)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if number in (4, 8) else pytest.mark.slow)
        for number, name in enumerate(KINDS)
    ],
)
def test_intervals_hold_the_truth_where_those_of_the_linear_problem_do(name):
    kind = kind_named(name)
    found = fitted(kind, 0)
    assert found.is_converged
    assert holds_truth(kind, found) == holds_in_theory(kind, 0)


def test_noise_cannot_be_estimated_where_the_parameters_use_up_a_column():
    kind = kind_named("two data sets, start positions of their own")
    low, high = kind.data
    (full,), (other,) = low.series, high.series
    short = Series(**{**vars(full), "times": full.times[:1], "values": full.values[:1]})
    noisy = Series(**{**vars(other), "values": other.values + noise_of(kind, 0)[1]})
    data = (
        DataSet(**{**vars(low), "series": (short,)}),
        DataSet(**{**vars(high), "series": (noisy,)}),
    )
    # its start position is its own, and takes its only value
    found = fit_model(FitSettings(data=data, models=()), kind.model, with_scan=False)
    assert not found.is_converged
    assert (
        "noise of column x cannot be estimated: the parameters use up its values (1)"
        in found.message
    )


def test_the_table_counts_fits_that_fail_and_open_ends():
    kind = kind_named("springpot")
    good = [(*holds_in_theory(kind, number), False, False) for number in range(3)]
    rows = [*good, (False, False, False, True, False), (True, True, True, False, True)]
    lines = coverage_lines({kind.name: rows})
    (line,) = [one for one in lines if one.startswith(f"| {kind.name} |")]
    assert line.startswith(f"| {kind.name} | 5 | ")
    assert line.endswith(" | 1 | 1 |")
