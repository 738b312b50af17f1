"""The kind `fractional-derivative` is Caputo's, whatever the function starts with."""

import numpy as np
import pytest
from scipy.special import gamma, gammainc

import fvi_cli as fvi
from fvi_cli.scenes.registry import build_problem


def last_value(order: float, function: str, bdf: int, folder) -> float:
    problem = {"kind": "fractional-derivative", "order": order, "function": function}
    source = {
        "name": "d",
        "problem": {**problem, "final_time": 2.0},
        "method": {"bdf": bdf},
        "ladder": {"steps": [400, 800]},
    }
    (outcome,) = fvi.run(source, output=folder)
    finished = outcome.finished[-1]
    return float(finished.trajectory.position[-1, 0])


@pytest.mark.few(4)
@pytest.mark.parametrize("order", [0.2, 0.5, 0.9, 1.2, 1.5, 1.9])
@pytest.mark.parametrize("bdf", [1, 2])
def test_functions_that_start_away_from_zero(order, bdf, tmp_path):
    # D^g e^t = e^t P(n - g, t), with the regularized incomplete gamma function
    value = last_value(order, "exp(t)", bdf, tmp_path)
    expected = np.exp(2.0) * gammainc(np.ceil(order) - order, 2.0)
    assert value == pytest.approx(expected, rel=2e-2 if bdf == 1 else 2e-4)
    shifted = last_value(order, "exp(t) + 5", bdf, tmp_path)
    assert shifted == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("order", [0.05, 0.5, 0.9, 1.0, 1.2, 1.5, 1.9])
def test_exact_values_are_those_of_closed_forms(order):
    def exact(function):
        problem = {"kind": "fractional-derivative", "order": order, "function": function}
        return build_problem({**problem, "final_time": 2.0}).exact(times)[:, 0]

    times = np.linspace(0.0, 2.0, 41)
    whole = np.ceil(order)
    wave = np.exp(times) * (gammainc(whole - order, times) if whole > order else 1.0)
    assert exact("exp(t) + 5") == pytest.approx(wave, abs=1e-12)
    power = gamma(3.3) / gamma(3.3 - order) * times ** (2.3 - order)
    assert exact("t**2.3") == pytest.approx(power, abs=1e-12)


@pytest.mark.parametrize(
    ("function", "order"), [("sqrt(t)", 0.8), ("abs(t - 0.7)", 0.5), ("sin(1000*t)", 0.5)]
)
def test_what_has_no_exact_values_is_refused(function, order):
    problem = {"kind": "fractional-derivative", "order": order, "function": function}
    with pytest.raises(ValueError, match="do not resolve"):
        build_problem({**problem, "final_time": 2.0})
