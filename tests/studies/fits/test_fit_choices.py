"""Bounds, and what is told of doubtful fits: on responses."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from measured_responses import response_data

import fvi_cli as fvi
from fvi_cli.reports import to_text
from fvi_cli.reports.kinds.fit import fit_report
from fvi_cli.studies.fits.fitting import fit_model
from fvi_cli.studies.fits.model import Evaluation, MotionModel
from fvi_cli.studies.fits.result import FitResult, ModelFit
from fvi_cli.studies.fits.search import least_squares_from
from fvi_cli.studies.fits.settings import (
    DataSet,
    FitModel,
    FitParameter,
    FitSettings,
)
from fvi_cli.studies.fits.statistics import covariance

WIDE = np.geomspace(0.05, 3.0, 40)


def receptance(hertz: Any, stiffness: float, *terms: tuple[float, float], mass: float = 1.0) -> Any:
    """Amplitude of x under a force of 1, by hand."""
    s = 2j * np.pi * hertz
    return 1.0 / (mass * s**2 + stiffness + sum(c * s**g for g, c in terms))


def measured(name: str, hertz: Any, values: Any, noise: float = 0.0, **changes: float) -> DataSet:
    drawn = np.random.default_rng([7, len(name)]).standard_normal((2, hertz.size))
    columns = {
        "real": values.real + noise * drawn[0],
        "imaginary": values.imag + noise * drawn[1],
    }
    return response_data(hertz, columns, name, changes=changes)


def fitted(data: list[DataSet], *parameters: FitParameter, terms: int = 1) -> ModelFit:
    specification = {
        "kind": "damped-oscillator",
        "mass": 1.0,
        "stiffness": 7.0,
        "damping": [{"order": 0.9, "coefficient": 0.4}, {"order": 0.4, "coefficient": 0.9}][:terms],
        "initial": {"position": 0.0, "velocity": 0.0},
        "final_time": 1.0,
    }
    model = FitModel(name="", specification=specification, parameters=parameters)
    return fit_model(FitSettings(data=tuple(data), models=()), model)


def parameter(key: str, start: float, **more: Any) -> FitParameter:
    least = 0.05 if key.endswith("order") else 0.0
    return FitParameter(key=f"problem.{key}", start=start, **{"low": least, **more})


STIFFNESS = parameter("stiffness", 7.0)
ORDER = parameter("damping.0.order", 0.9, high=1.95)
COEFFICIENT = parameter("damping.0.coefficient", 0.4)


def test_bounds_hold_and_are_told():
    data = [measured("a", WIDE, receptance(WIDE, 5.0, (0.6, 0.5)), 0.002)]
    bounded = parameter("damping.0.order", 0.8, low=0.7, high=1.5)
    found = fitted(data, STIFFNESS, bounded, COEFFICIENT)
    order = found.estimates[1]
    assert order.value == pytest.approx(0.7, abs=1e-6)
    assert order.low >= 0.7
    assert order.at_bound == "low"
    # the others have intervals as if the order were known to lie there
    for one in (found.estimates[0], found.estimates[2]):
        assert one.low < one.value - one.standard_error / 100 < one.high


def test_order_and_coefficient_in_a_narrow_band_are_told_with_the_number():
    narrow = np.linspace(0.30, 0.36, 40)
    data = [measured("a", narrow, receptance(narrow, 5.0, (0.6, 0.5)), 0.001)]
    found = fitted(data, parameter("stiffness", 5.0), ORDER, COEFFICIENT)
    lower = np.tril(found.correlations, -1)
    correlation = lower.flat[np.abs(lower).argmax()]
    assert abs(correlation) > 0.99
    (said,) = [one for one in found.warnings if "can hardly be separated" in one]
    assert f"by these data: correlation {correlation:+.4f}" in said


def test_a_parameter_without_influence_has_no_error():
    slopes = np.array([[1.0, 0.0], [2.0, 0.0], [-1.0, 0.0]])
    with np.errstate(all="raise"):
        _, errors, is_told = covariance(Evaluation(residuals=np.ones(3), jacobian=slopes), 0.5)
    assert not is_told
    assert np.isinf(errors).all()
    slopes[1, 1] = 3.0
    _, errors, is_told = covariance(Evaluation(residuals=np.ones(3), jacobian=slopes), 0.5)
    inverse = np.linalg.inv(slopes.T @ slopes)
    assert is_told
    np.testing.assert_allclose(errors, np.sqrt(0.5 * np.diag(inverse)), rtol=1e-12)


def test_what_failed_says_what_cannot_be_separated_and_comes_last():
    narrow = np.linspace(0.30, 0.36, 40)
    data = [measured("a", narrow, receptance(narrow, 5.0, (0.6, 0.5)), 0.001)]
    found = fitted(data, parameter("stiffness", 5.0), ORDER, COEFFICIENT)
    described = replace(found.model, name="not at its end")
    failed = replace(found, model=described, is_converged=False, message="long", criterion=-1e9)
    assert any("can hardly be separated" in one for one in failed.warnings)
    good = replace(found, model=replace(found.model, name="at its end"))
    settings = FitSettings(data=tuple(data), models=(described, good.model))
    result = FitResult(name="two", settings=settings, models=(failed, good))
    words = to_text(fit_report("two", [result]).blocks)
    assert words.index("at its end") < words.index("not at its end")
    assert "not at its end: no fit: long" in words


def test_a_search_without_end_is_told_in_one_sentence():
    data = [measured("a", WIDE, receptance(WIDE, 5.0, (0.6, 0.5)), 0.002)]
    specification = fitted(data, STIFFNESS, ORDER, COEFFICIENT).model
    model = MotionModel(specification, data, [1e-3] * 2)
    found = least_squares_from(model, model.start, most=1)
    assert found.message
    assert not found.message.endswith(".")


@pytest.mark.few(2)
@pytest.mark.parametrize(("name", "rate"), [("x", 0), ("vx", 1), ("ax", 2)])
@pytest.mark.parametrize("parts", [("real", "imaginary"), ("magnitude", "phase")])
def test_panels_of_a_response_say_what_was_measured_and_in_which_unit(tmp_path, name, rate, parts):
    values = (2j * np.pi * WIDE) ** rate * receptance(WIDE, 5.0, (0.9, 0.5))
    values *= 1.0 + 1e-3 * np.random.default_rng(rate).standard_normal((WIDE.size, 2)) @ (1, 1j)
    pair = {"real": values.real, "imaginary": values.imag}
    pair |= {"magnitude": abs(values), "phase": np.degrees(np.angle(values))}
    file = tmp_path / "measured.csv"
    table = np.stack([WIDE, *(pair[one] for one in parts)], axis=1)
    np.savetxt(file, table, delimiter=",", header=",".join(("f", *parts)), comments="")
    problem = {"kind": "damped-oscillator", "mass": 1.0, "stiffness": 5.0, "exact": "none"}
    problem |= {"damping": [{"order": 0.9, "coefficient": 0.4}], "final_time": 1.0}
    problem["initial"] = {"position": 0.0, "velocity": 0.0}
    data = {"file": str(file), "frequency": "f", "force": "x"}
    data["columns"] = {name: dict(zip(parts, parts, strict=True))}
    result = fvi.fit(
        {
            "name": "measured",
            "problem": problem,
            "method": "gauss4",
            "ladder": {"steps": [16]},
            "units": {"time": "s", "length": "m", "force": "N"},
            "fit": {"data": data, "parameters": {"problem.damping.0.coefficient": {"from": 0}}},
        }
    )
    axes = fvi.figures(result)["measured-fit"].axes
    said = [" ".join(one.get_ylabel().split()) for one in axes[:2]]
    unit = ("m per N", "m/s per N", "m/s² per N")[rate]
    for text, part in zip(said, parts, strict=True):
        words = "part of" if part in ("real", "imaginary") else "of"
        assert text.startswith(f"{part} {words} {name} (")
        assert text.endswith("(degrees)" if part == "phase" else f"{unit})")


@pytest.mark.parametrize("clean", ["magnitude", "phase"])
def test_a_column_without_noise_beside_one_with_noise_decides(clean):
    values = receptance(WIDE, 7.0, (0.9, 0.5))
    columns = {"magnitude": np.abs(values), "phase": np.degrees(np.angle(values))}
    (noisy,) = set(columns) - {clean}
    noise = 1.0 + 1e-3 * np.random.default_rng(3).standard_normal(WIDE.size)
    columns[noisy] = columns[noisy] * noise
    found = fitted([response_data(WIDE, columns, "a")], COEFFICIENT)
    assert found.estimates[0].value == pytest.approx(0.5, rel=1e-9)
