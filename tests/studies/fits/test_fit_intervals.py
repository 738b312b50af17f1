"""Fits of responses: intervals against profiles by brute force on closed forms, and limits."""

from typing import Any

import numpy as np
import pytest
from fit_kinds import fit_nearby
from measured_responses import response_data
from oracles.least_squares import (
    interval,
    least,
    springpot_response,
    zener_modulus,
)
from spread import few_of

from fvi_cli.integrator.gradients.gradient import RunFailedError
from fvi_cli.studies.fits.fitting import fit_model
from fvi_cli.studies.fits.model import Evaluation, MotionModel
from fvi_cli.studies.fits.settings import DataSet, FitModel, FitParameter, FitSettings
from fvi_cli.studies.fits.statistics import linearised

HERTZ = np.geomspace(0.05, 3.0, 20)
ZENER = {"law": "zener", "order": 0.5, "time": 1e-4, "relaxed": 0.0, "unrelaxed": 0.5}
SPRINGPOT = {"order": 0.6, "coefficient": 0.5}
TRUTH = springpot_response(HERTZ, 5.0, (0.6, 0.5))
TWO = {"stiffness": (4.9, 0.0, np.inf), "damping.0.coefficient": (0.5, 0.0, np.inf)}
"""Parameters with where the search begins, and bounds."""


def parts(values: Any) -> Any:
    return np.concatenate([values.real, values.imag])


def responses(values: Any, noise: float, seed: int, hertz: Any = HERTZ) -> tuple[DataSet, Any]:
    """Real and imaginary part with noise, and all of them in one row."""
    drawn = parts(values) + noise * np.random.default_rng(seed).standard_normal(2 * hertz.size)
    columns = dict(zip(("real", "imaginary"), np.split(drawn, 2), strict=True))
    return response_data(hertz, columns), drawn


def fitted(
    data: DataSet, damping: list[Any], keys: dict[str, Any], noise: float | None, fit: Any = None
) -> Any:
    specification = {
        "kind": "damped-oscillator",
        "mass": 1.0,
        "stiffness": 5.0,
        "damping": damping,
        "initial": {"position": 0.0, "velocity": 0.0},
        "final_time": 1.0,
    }
    parameters = tuple(
        FitParameter(key=f"problem.{key}", start=start, low=low, high=high)
        for key, (start, low, high) in keys.items()
    )
    model = FitModel(name="", specification=specification, parameters=parameters)
    return (fit or fit_nearby)(FitSettings(data=(data,), models=(), deviation=noise), model)


@few_of(1, 3)
def test_a_superfluous_law_widens_no_interval_to_nothing(seed):
    """The law has a relaxation time of 1e-4; its modulus has nothing to explain."""
    noise = 0.002
    data, drawn = responses(TRUTH, noise, seed)
    keys = {**TWO, "damping.1.unrelaxed": (0.5, 0.0, np.inf)}
    found = fitted(data, [SPRINGPOT, ZENER], keys, noise)
    s = 2j * np.pi * HERTZ

    def residuals(point: Any) -> Any:
        law = zener_modulus(HERTZ, point[2], 0.5, 1e-4)
        model = 1.0 / (s**2 + point[0] + point[1] * s**0.6 + law)
        return (parts(model) - drawn) / noise

    low, high = np.zeros(3), np.full(3, 1e6)
    best, _ = least(residuals, [np.array([5.0, 0.5, b]) for b in (0.01, 1.0, 10.0)], low, high)
    for index, one in enumerate(found.estimates):
        ends = interval(residuals, best, index, low, high, freedom=1e9, variance=1.0)
        width = ends[1] - ends[0]
        assert one.low == pytest.approx(ends[0], abs=0.02 * width), one.name
        assert one.high == pytest.approx(ends[1], abs=0.02 * width), one.name


def test_a_failed_evaluation_is_neither_inside_nor_outside(monkeypatch):
    """Motions that cannot be computed leave an end open; nothing ends at the estimate."""
    data, _ = responses(TRUTH, 0.01, 0)
    evaluate = MotionModel.evaluate

    def broken(self: MotionModel, point: Any, *, with_jacobian: bool = True) -> Evaluation:
        if point[0] > edge:
            raise RunFailedError("no run beyond")
        return evaluate(self, point, with_jacobian=with_jacobian)

    whole = fitted(data, [SPRINGPOT], TWO, 0.01).estimates[0]
    assert whole.low < whole.value < whole.high
    monkeypatch.setattr(MotionModel, "evaluate", broken)
    for share in (1e-4, 0.1, 0.6):
        edge = whole.value + share * (whole.high - whole.value)
        found = fitted(data, [SPRINGPOT], TWO, 0.01).estimates[0]
        assert np.isnan(found.high)
        assert found.low == pytest.approx(whole.low, rel=1e-3)


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(3))
def test_parameters_that_can_be_traded_have_no_interval(seed):
    """Two springpots of one order side by side: only the sum of their coefficients is known."""
    draw = np.random.default_rng([31, seed])
    stiffness, total = 10.0 ** draw.uniform(0, 2), 10.0 ** draw.uniform(-1, 0.5)
    order, share = float(draw.uniform(0.2, 1.8)), float(draw.uniform(0.1, 0.9))
    truth = springpot_response(HERTZ, stiffness, (order, total))
    noise = 0.01 * float(np.abs(truth).mean())
    data, _ = responses(truth, noise, seed)
    keys = {
        "stiffness": (stiffness, 0.0, np.inf),
        "damping.0.coefficient": (share * total, 0.0, np.inf),
        "damping.1.coefficient": ((1 - share) * total, 0.0, np.inf),
    }
    springpots = [{"order": order, "coefficient": one * total} for one in (share, 1 - share)]
    found = fitted(data, springpots, keys, noise)
    assert not found.is_converged
    assert "some can change together" in found.message
    assert all(np.isnan([one.low, one.high]).all() for one in found.estimates)
    # the control: one of them alone
    alone = fitted(data, springpots[:1], dict(list(keys.items())[:2]), noise)
    assert alone.is_converged
    assert all(one.low < one.value < one.high for one in alone.estimates)


def test_a_parameter_without_influence_has_no_error():
    slopes = np.array([[1.0, 0.0], [2.0, 0.0], [-1.0, 0.0]])
    found = linearised(slopes, [3])
    assert not found.is_regular
    assert np.isinf(found.errors).all()
    slopes[1, 1] = 3.0
    found = linearised(slopes, [3])
    assert found.is_regular
    inverse = np.linalg.inv(slopes.T @ slopes)
    np.testing.assert_allclose(found.errors, np.sqrt(np.diag(inverse)), rtol=1e-12)


def test_bounds_hold():
    data, _ = responses(TRUTH, 0.002, 1)
    found = fitted(data, [SPRINGPOT], {**TWO, "damping.0.order": (0.8, 0.7, 1.5)}, None, fit_model)
    order = found.estimates[2]
    assert order.value == pytest.approx(0.7, abs=1e-6)
    assert order.low == 0.7
    # the others have intervals as if the order were known to lie there
    for one in found.estimates[:2]:
        assert one.low < one.value - one.standard_error / 100 < one.high


def test_order_and_coefficient_in_a_narrow_band_are_told_with_the_number():
    narrow = np.linspace(0.30, 0.36, 40)
    data, _ = responses(springpot_response(narrow, 5.0, (0.6, 0.5)), 0.001, 2, narrow)
    found = fitted(data, [SPRINGPOT], {**TWO, "damping.0.order": (0.9, 0.05, 1.95)}, None)
    lower = np.tril(found.correlations, -1)
    correlation = lower.flat[np.abs(lower).argmax()]
    assert abs(correlation) > 0.99
    (said,) = [one for one in found.warnings if "can hardly be separated" in one]
    assert f"by these data: correlation {correlation:+.4f}" in said


@pytest.mark.parametrize("clean", ["magnitude", "phase"])
def test_a_column_without_noise_beside_one_with_noise_decides(clean):
    columns = {"magnitude": np.abs(TRUTH), "phase": np.degrees(np.angle(TRUTH))}
    (noisy,) = set(columns) - {clean}
    columns[noisy] *= 1.0 + 1e-3 * np.random.default_rng(3).standard_normal(HERTZ.size)
    keys = {"damping.0.coefficient": (0.4, 0.0, np.inf)}
    found = fitted(response_data(HERTZ, columns), [SPRINGPOT], keys, None, fit_model)
    assert found.estimates[0].value == pytest.approx(0.5, rel=1e-9)
