"""Fits: what comes out of data whose parameters are known."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from command_line import fvi as here
from command_line import rows_of
from letters import spring

import fvi_cli as fvi
from fvi_cli.studies.fits.fitting import fit_model
from fvi_cli.studies.fits.model import MotionModel
from fvi_cli.studies.fits.settings import DataSet, FitModel, FitParameter, FitSettings, Series

TIMES = np.linspace(0.15, 9.9, 60)
TRUE = {"stiffness": 3.0, "order": 0.6, "coefficient": 0.5}
SPECIFICATION: dict[str, Any] = {
    "kind": "damped-oscillator",
    "stiffness": 2.0,
    "damping": [{"order": 0.9, "coefficient": 0.3}],
    "initial": {"position": 1.0, "velocity": 0.0},
    "final_time": 10.0,
}
PARAMETERS = (
    FitParameter(key="problem.stiffness", start=2.0, low=0.0),
    FitParameter(key="problem.damping.0.order", start=0.9, low=0.05, high=1.95),
    FitParameter(key="problem.damping.0.coefficient", start=0.3, low=0.0),
)


def motion(times: Any, position: float = 1.0, **changed: float) -> Any:
    """x(t) of the oscillator of mass 1 by another route."""
    values = TRUE | changed
    scene = spring(
        (values["order"], values["coefficient"]), T=10.0, k=values["stiffness"], x=position
    )
    from oracles.linear_response import match_scene

    solution = match_scene(scene)
    return solution.position(np.asarray(times))[:, 0]


def measured(values: Any, name: str = "a", **changes: float) -> DataSet:
    series = Series(name="x", column="x", times=TIMES, values=values)
    return DataSet(
        name=name,
        series=(series,),
        changes={f"problem.initial.{key}": value for key, value in changes.items()},
    )


def settings(*data: DataSet, noise: float | None = None) -> FitSettings:
    return FitSettings(data=data, models=(), deviation=noise)


def model(*parameters: FitParameter) -> FitModel:
    return FitModel(name="", specification=SPECIFICATION, parameters=parameters or PARAMETERS)


def noise(seed: int, size: float) -> Any:
    return size * np.random.default_rng(seed).standard_normal(TIMES.size)


def test_clean_data_give_the_parameters_back():
    found = fit_model(settings(measured(motion(TIMES))), model())
    assert found.is_converged
    for one, true in zip(found.estimates, TRUE.values(), strict=True):
        assert one.value == pytest.approx(true, rel=1e-8)
    assert found.warnings == ()


@pytest.fixture(scope="module")
def noisy() -> Any:
    return fit_model(settings(measured(motion(TIMES) + noise(3, 0.02))), model())


def test_intervals_hold_the_parameters_and_lie_around_the_estimates(noisy):
    for one, true in zip(noisy.estimates, TRUE.values(), strict=True):
        assert one.low < one.value < one.high
        assert one.low < true < one.high
        # close to linear: t times the standard error on either side
        assert one.high - one.low == pytest.approx(2 * 2.0 * one.standard_error, rel=0.1)
    assert noisy.series[0].deviation == pytest.approx(0.02, rel=0.3)
    assert noisy.whiteness > 0.01
    assert noisy.discretisation < 0.01


def test_the_ends_of_an_interval_are_where_the_misfit_says(noisy):
    """Scipy, with one parameter held and no derivatives, finds the same increase."""
    from scipy.optimize import least_squares

    data = measured(motion(TIMES) + noise(3, 0.02))
    described = MotionModel(model(), [data], [0.02])
    described.loosen(1e-6)
    best = described.evaluate(
        np.array(
            [one.inner(e.value) for one, e in zip(described.free, noisy.estimates, strict=True)]
        ),
        with_jacobian=False,
    )
    high = noisy.estimates[1].high

    def others(point: Any) -> Any:
        whole = np.array([point[0], high, point[1]])
        return described.evaluate(whole, with_jacobian=False).residuals

    start = np.log([noisy.estimates[0].value, noisy.estimates[2].value])
    held = least_squares(others, start, xtol=1e-8)
    variance = best.cost / (TIMES.size - 3)
    assert np.sqrt((2 * held.cost - best.cost) / variance) == pytest.approx(2.002, rel=0.02)


def test_derivatives_of_the_residuals():
    described = MotionModel(
        model(*PARAMETERS[:2]),
        [measured(motion(TIMES))],
        [0.1],
    )
    described.remesh(described.start, 1e-8)
    at = described.evaluate(described.start)
    for index in range(2):
        step = np.zeros(2)
        step[index] = 1e-4
        sides = [
            described.evaluate(described.start + sign * step, with_jacobian=False).residuals
            for sign in (1, -1)
        ]
        difference = (sides[0] - sides[1]) / 2e-4
        np.testing.assert_allclose(at.jacobian[:, index], difference, atol=1e-5)


def test_motions_share_parameters():
    data = (
        measured(motion(TIMES, 1.0) + noise(5, 0.01), "low", position=1.0),
        measured(motion(TIMES, 2.5) + noise(6, 0.01), "high", position=2.5),
    )
    found = fit_model(
        settings(*data, noise=0.01),
        model(
            PARAMETERS[0],
            PARAMETERS[2],
            FitParameter(key="problem.damping.0.order", start=0.6, low=0.3, high=0.95),
        ),
    )
    values = [one.value for one in found.estimates]
    np.testing.assert_allclose(values, [3.0, 0.5, 0.6], rtol=0.03)
    assert found.assignments[1]["problem.initial.position"] == 2.5
    # the noise is known: the misfit is a sum of squares of normal numbers
    assert 70 < found.misfit < 170


def test_what_fits_alike_is_said():
    # mass, stiffness and coefficient have a common factor
    found = fit_model(
        settings(measured(motion(TIMES) + noise(7, 0.01))),
        model(*PARAMETERS, FitParameter(key="problem.mass", start=1.2, low=0.0)),
    )
    assert not found.is_converged
    assert "the data do not determine all parameters" in found.message


CONFIG = {
    "name": "decay",
    "problem": SPECIFICATION,
    "method": {"rk": "gauss", "degree": 4},
    "ladder": {"steps": [32]},
    "fit": {
        "data": {"file": "decay.csv", "columns": {"x": "x"}},
        "parameters": {
            "problem.stiffness": {"from": 0},
            "problem.damping.0.order": {"from": 0.05, "to": 0.99},
            "problem.damping.0.coefficient": {"from": 0},
        },
        "models": {"springpot": {}, "viscous": {"set": {"problem.damping.0.order": 1.0}}},
    },
}


def test_the_command_writes_what_it_says(tmp_path):
    values = motion(TIMES) + noise(4, 0.005)
    rows = "".join(f"{t!r},{v!r}\n" for t, v in zip(TIMES.tolist(), values.tolist(), strict=True))
    (tmp_path / "decay.csv").write_text("t,x\n" + rows)
    (tmp_path / "decay.yaml").write_text(yaml.safe_dump(CONFIG, sort_keys=False))
    output = tmp_path / "out"
    arguments = ["fit", str(tmp_path / "decay.yaml"), "-o", str(output)]
    done = here(*arguments, "--json")
    assert done.exit_code == 0, done.stderr
    document = json.loads(done.stdout)
    assert [one["model"] for one in document["models"]] == ["springpot", "viscous"]
    assert all(Path(one).is_file() for one in document["files"])
    table = rows_of(output / "tables" / "decay-fit.csv")
    assert list(table[0])[:5] == ["parameter", "estimate", "standard_error", "low", "high"]
    for row, true in zip(table[:3], TRUE.values(), strict=True):
        assert float(row["estimate"]) == pytest.approx(true, rel=0.05)
    springpot, viscous = ({one["model"]: one for one in table}[k] for k in ("springpot", "viscous"))
    # the wrong law is far worse, and what it leaves is no noise
    assert float(viscous["aicc"]) - float(springpot["aicc"]) > 50
    assert float(viscous["whiteness"]) < 1e-6 < 0.01 < float(springpot["whiteness"])
    assert (output / "figures" / "decay-fit.png").is_file()
    assert (output / "figures" / "decay-fit-profiles.png").is_file()
    fitted = fvi.load(output / "decay-fitted.yaml")
    (outcome,) = fvi.run(fitted)
    assert outcome.finished[0].status == "ok"
    assert fitted.resolved["experiments"][0]["problem"]["stiffness"] == float(table[0]["estimate"])
    again = here(*arguments, "--check")
    assert again.exit_code == 0, again.stdout


def test_a_fit_that_fails_says_why(tmp_path):
    rows = "".join(f"{t},{np.cos(t)}\n" for t in np.arange(0.0, 4.0, 0.2))
    (tmp_path / "free.csv").write_text("t,x\n" + rows)
    (tmp_path / "free.yaml").write_text(
        "problem: {kind: damped-oscillator, stiffness: 1.1, initial: {position: 1},"
        " final_time: 4}\n"
        "ladder: {steps: [8]}\n"
        "fit:\n"
        "  data: {file: free.csv, columns: {x: x}}\n"
        "  parameters: {problem.stiffness: {from: 0}, problem.mass: {from: 0}}\n"
    )
    done = here("fit", str(tmp_path / "free.yaml"), "-o", str(tmp_path / "o"))
    assert done.exit_code == 1
    assert "the data do not determine all parameters" in done.stderr
    table = (tmp_path / "o" / "tables" / "free-fit.md").read_text(encoding="utf-8")
    assert "these are the best numbers so far" in table
    assert not (tmp_path / "o" / "free-fitted.yaml").exists()
