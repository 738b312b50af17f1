"""Intervals against profiles by brute force on closed forms."""

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
from fvi_cli.studies.fits.model import Evaluation, MotionModel
from fvi_cli.studies.fits.settings import (
    DataSet,
    FitModel,
    FitParameter,
    FitSettings,
)

HERTZ = np.geomspace(0.05, 3.0, 20)
ZENER = {"law": "zener", "order": 0.5, "time": 1e-4, "relaxed": 0.0, "unrelaxed": 0.5}
SPRINGPOT = {"order": 0.6, "coefficient": 0.5}


def parts(values: Any) -> Any:
    return np.concatenate([values.real, values.imag])


def responses(values: Any, noise: float, seed: int) -> tuple[DataSet, Any]:
    """Real and imaginary part with noise, and all of them in one row."""
    drawn = parts(values) + noise * np.random.default_rng(seed).standard_normal(2 * HERTZ.size)
    columns = dict(zip(("real", "imaginary"), np.split(drawn, 2), strict=True))
    return response_data(HERTZ, columns), drawn


def fitted(data: DataSet, damping: list[Any], keys: dict[str, Any], noise: float) -> Any:
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
    return fit_nearby(FitSettings(data=(data,), models=(), deviation=noise), model)


@few_of(1, 3)
def test_a_superfluous_law_widens_no_interval_to_nothing(seed):
    """The law has a relaxation time of 1e-4; its modulus has nothing to explain."""
    noise = 0.002
    truth = springpot_response(HERTZ, 5.0, (0.6, 0.5))
    data, drawn = responses(truth, noise, seed)
    found = fitted(
        data,
        [SPRINGPOT, ZENER],
        {
            "stiffness": (5.0, 0.0, np.inf),
            "damping.0.coefficient": (0.5, 0.0, np.inf),
            "damping.1.unrelaxed": (0.5, 0.0, np.inf),
        },
        noise,
    )
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
    data, _ = responses(springpot_response(HERTZ, 5.0, (0.6, 0.5)), 0.01, 0)
    evaluate = MotionModel.evaluate

    def broken(self: MotionModel, inner: Any, *, with_jacobian: bool = True) -> Evaluation:
        if self.values(inner)[0] > edge:
            raise RunFailedError("no run beyond")
        return evaluate(self, inner, with_jacobian=with_jacobian)

    keys = {"stiffness": (4.9, 0.0, np.inf), "damping.0.coefficient": (0.5, 0.0, np.inf)}
    edge = np.inf
    whole = fitted(data, [SPRINGPOT], keys, 0.01).estimates[0]
    assert whole.low < whole.value < whole.high
    monkeypatch.setattr(MotionModel, "evaluate", broken)
    for share in (1e-4, 0.1, 0.6):
        edge = whole.value + share * (whole.high - whole.value)
        found = fitted(data, [SPRINGPOT], keys, 0.01).estimates[0]
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
    springpots = [
        {"order": order, "coefficient": keys[f"damping.{i}.coefficient"][0]} for i in (0, 1)
    ]
    found = fitted(data, springpots, keys, noise)
    assert not found.is_converged
    assert "some can change together" in found.message
    assert all(np.isnan([one.low, one.high]).all() for one in found.estimates)
    # the control: one of them alone
    alone = fitted(data, springpots[:1], dict(list(keys.items())[:2]), noise)
    assert alone.is_converged
    assert all(one.low < one.value < one.high for one in alone.estimates)


@pytest.mark.parametrize(("given", "said"), [(1e-5, "too short"), (10.0, "too long"), (0.01, "")])
def test_a_given_noise_that_the_data_do_not_have_is_told(given, said):
    data, _ = responses(springpot_response(HERTZ, 5.0, (0.6, 0.5)), 0.01, 0)
    keys = {"stiffness": (4.9, 0.0, np.inf), "damping.0.coefficient": (0.5, 0.0, np.inf)}
    found = [one for one in fitted(data, [SPRINGPOT], keys, given).warnings if "given noise" in one]
    assert len(found) == bool(said)
    assert all(f"the intervals are {said}" in one for one in found)
