"""Fits: what comes out of data whose parameters are known."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from command_line import fvi as here
from command_line import rows_of
from fit_kinds import KINDS, fit_nearby, measured
from letters import spring
from spread import few_of

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


def motion(times: Any) -> Any:
    """x(t) of the oscillator of mass 1 by another route."""
    scene = spring((TRUE["order"], TRUE["coefficient"]), T=10.0, k=TRUE["stiffness"], x=1.0)
    from oracles.linear_response import match_scene

    solution = match_scene(scene)
    return solution.position(np.asarray(times))[:, 0]


MODEL = FitModel(name="", specification=SPECIFICATION, parameters=PARAMETERS)


def settings(values: Any, noise: float | None = None) -> FitSettings:
    series = Series(name="x", column="x", times=TIMES, values=values)
    return FitSettings(data=(DataSet(name="a", series=(series,)),), models=(), deviation=noise)


def noise(seed: int, size: float) -> Any:
    return size * np.random.default_rng(seed).standard_normal(TIMES.size)


def test_clean_data_give_the_parameters_back():
    found = fit_model(settings(motion(TIMES)), MODEL)
    assert found.is_converged
    for one, true in zip(found.estimates, TRUE.values(), strict=True):
        assert one.value == pytest.approx(true, rel=1e-8)
    assert found.warnings == ()


@pytest.fixture(scope="module")
def noisy() -> Any:
    return fit_model(settings(motion(TIMES) + noise(3, 0.02)), MODEL)


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

    described = MotionModel(MODEL, settings(motion(TIMES) + noise(3, 0.02), 0.02))
    estimates = np.array([one.value for one in noisy.estimates])
    best = described.evaluate(estimates, with_jacobian=False)
    high = noisy.estimates[1].high

    def others(point: Any) -> Any:
        whole = np.array([point[0], high, point[1]])
        return described.evaluate(whole, with_jacobian=False).residuals

    held = least_squares(others, estimates[[0, 2]], xtol=1e-8)
    variance = best.cost / (TIMES.size - 3)
    assert np.sqrt((2 * held.cost - best.cost) / variance) == pytest.approx(2.002, rel=0.02)


@few_of(1, 26, "number")
def test_far_starts_find_the_minimum(number):
    draw = np.random.default_rng([9, number])
    kind = list(KINDS.values())[number % len(KINDS)]
    factors = 5.0 ** draw.uniform(-1.0, 1.0, len(kind.free))
    for place, key in enumerate(kind.free):
        if key.endswith("order"):
            factors[place] = draw.uniform(0.1, 0.9) / kind.truth[place]
    if kind.problem["kind"] == "material":
        # laws stiffen
        factors[:2] = np.sort(factors[:2])
    data = measured(kind, number)
    found = fit_model(data, kind.model(factors))
    assert found.is_converged
    assert found.criterion < fit_nearby(data, kind.model()).criterion + 1e-3


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
