"""What can be measured: formulas of a motion, and responses to harmonic forces."""

from typing import Any

import numpy as np
import pytest
from measured_responses import response_data

import fvi_cli as fvi
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.studies.fits.model import Evaluation, MotionModel
from fvi_cli.studies.fits.settings import DataSet, FitModel, FitParameter, FitSettings, Series

STRUCTURE: dict[str, Any] = {
    "kind": "structure",
    "mass": [[1.0, 0.0], [0.0, 2.0]],
    "stiffness": [[14.0, -5.0], [-5.0, 5.0]],
    "damping": [{"order": 0.6, "coefficient": 0.4, "acts_on": ["x1", "x2 - x1"]}],
    "initial": {"position": [0.3, -0.2], "velocity": [0.5, 0.0]},
    "final_time": 4.0,
}
PENDULUM: dict[str, Any] = {
    "kind": "lagrangian",
    "coordinates": ["x"],
    "lagrangian": "0.5*m*vx**2*(1 + 0.2*sin(x)**2) + m*g*cos(x)",
    "parameters": {"m": 1.5, "g": 4.0},
    "damping": [{"order": 0.7, "coefficient": 0.3}],
    "initial": {"position": 1.2, "velocity": 0.3},
    "final_time": 4.0,
}
SOLID: dict[str, Any] = {
    "kind": "damped-oscillator",
    "mass": 1.3,
    "stiffness": 2.0,
    "damping": [
        {"law": "zener", "order": 0.6, "time": 0.4, "relaxed": 1.0, "unrelaxed": 4.0},
        {"order": 1.0, "coefficient": 0.2},
    ],
    "forcing": "0.4*sin(2*t)",
    "initial": {"position": 1.0, "velocity": 0.5},
    "final_time": 4.0,
}
SHAKEN: dict[str, Any] = {
    "kind": "frame",
    "storeys": 2,
    "stiffness": [30.0, 20.0],
    "dampers": [{"order": 0.5, "coefficient": 0.8}],
    "parameters": {"strength": 3.0},
    "ground_acceleration": "strength*exp(-t)*sin(4*t)",
    "final_time": 4.0,
}
FORMULAS = {
    "frame": (SHAKEN, ["x1", "x2"], "ax2 + ground_acceleration"),
    "structure": (STRUCTURE, ["x1", "x2"], "ax2 - 0.3*dx1*x2 + vx1**2"),
    "lagrangian": (PENDULUM, ["x"], "g*sin(x) + ax*m + dx"),
    "law": (SOLID, ["x"], "ax + 2*dx*x"),
}
KEYS = {
    "frame": ["parameters.strength", "stiffness.0", "dampers.0.order"],
    "structure": ["mass.1.1", "stiffness.0.0", "damping.0.order", "initial.velocity.0"],
    "lagrangian": ["parameters.m", "damping.0.order", "damping.0.coefficient"],
    "law": ["mass", "damping.0.time", "damping.0.order", "damping.0.unrelaxed"],
}


def model_of(specification: dict[str, Any], keys: list[str], *data: DataSet) -> MotionModel:
    from fvi_cli.studies.members import value_at

    parameters = tuple(
        FitParameter(key=f"problem.{key}", start=float(value_at(specification, f"problem.{key}")))
        for key in keys
    )
    model = FitModel(name="", specification=specification, parameters=parameters)
    return MotionModel(model, FitSettings(data=data, models=(), deviation=1.0))


def check_derivatives(model: MotionModel, at: Evaluation, share: float) -> None:
    """Compare derivatives with differences of order four."""
    for index, value in enumerate(model.start):
        step = share * value * np.eye(model.start.size)[index]
        sides = [
            model.evaluate(model.start + k * step, with_jacobian=False).residuals
            for k in (-2, -1, 1, 2)
        ]
        difference = (sides[0] - 8 * sides[1] + 8 * sides[2] - sides[3]) / (12 * share * value)
        scale = np.abs(difference).max()
        np.testing.assert_allclose(at.jacobian[:, index], difference, rtol=0, atol=1e-8 * scale)


@pytest.mark.few(2)
@pytest.mark.parametrize("name", FORMULAS)
def test_derivatives_of_formulas(name):
    specification, coordinates, text = FORMULAS[name]
    names = ["t", *(p + c for p in ("", "v", "a", "d") for c in coordinates), "m", "g"]
    names.append("ground_acceleration")
    times = np.array([0.4, 1.3, 2.9, 3.7])
    series = Series(
        name=text,
        column="y",
        times=times,
        values=np.zeros(4),
        formula=Expression.parse(text, variables=names),
    )
    data = DataSet(name="a", series=(series,), coordinates=tuple(coordinates))
    model = model_of(specification, KEYS[name], data)
    model.remesh(model.start, 1)
    at = model.evaluate(model.start)
    check_derivatives(model, at, 1e-3)


def test_formulas_are_those_of_a_run():
    """The same numbers as the quantities that ``fvi run`` stores."""
    config = {
        "name": "a",
        "problem": SOLID,
        "method": {"rk": "gauss", "degree": 5},
        "ladder": {"steps": 64},
        "output": {"times": [0.4, 1.3, 2.9]},
        "quantities": {"y": FORMULAS["law"][2]},
    }
    (outcome,) = fvi.run(config)
    stored = outcome.finished[0].trajectory.observed.quantities["y"]
    names = ["t", "x", "vx", "ax", "dx"]
    series = Series(
        name="y",
        column="y",
        times=np.array([0.4, 1.3, 2.9]),
        values=np.zeros(3),
        formula=Expression.parse(FORMULAS["law"][2], variables=names),
    )
    model = model_of(SOLID, ["mass"], DataSet(name="a", series=(series,), coordinates=("x",)))
    model.remesh(model.start, 2)
    found = model.evaluate(model.start, with_jacobian=False).residuals
    np.testing.assert_allclose(found, stored, rtol=1e-7)


def test_a_response_and_its_derivatives():
    hertz = np.linspace(0.05, 0.9, 7)
    parts = ["real", "imaginary", "magnitude", "phase"]
    data = response_data(
        hertz,
        dict.fromkeys(parts, np.zeros(7)),
        row=(-1.0, 1.0),
        rates={"magnitude": 2},
        force="x2=2",
        coordinates=("x1", "x2"),
    )
    keys = ["mass.1.1", "damping.0.order", "damping.0.coefficient"]
    model = model_of(STRUCTURE, keys, data)
    at = model.evaluate(model.start)
    found = at.residuals.reshape(4, 7)
    # by hand
    s = 2j * np.pi * hertz
    damper = 0.4 * s**0.6
    forward = np.array([-1.0, 1.0])
    every = []
    for one, z in zip(s, damper, strict=True):
        matrix = np.diag([1.0, 2.0]) * one**2 + np.array([[14.0, -5.0], [-5.0, 5.0]])
        matrix = matrix + z * np.array([[2.0, -1.0], [-1.0, 1.0]])
        every.append(forward @ np.linalg.solve(matrix, [0.0, 2.0]))
    by_hand = np.array(every)
    np.testing.assert_allclose(found[0], by_hand.real, rtol=1e-12)
    np.testing.assert_allclose(found[1], by_hand.imag, rtol=1e-12)
    np.testing.assert_allclose(found[2], np.abs(s**2 * by_hand), rtol=1e-12)
    np.testing.assert_allclose(found[3], np.degrees(np.angle(by_hand)), rtol=1e-12)
    check_derivatives(model, at, 2e-4)


RESPONSE = """\
name: frf
problem:
  kind: damped-oscillator
  mass: 1.0
  stiffness: 30.0
  damping: [{order: 1.0, coefficient: 1.0}]
  final_time: 1.0
ladder: {steps: [8]}
fit:
  data: {file: frf.csv, frequency: f, force: x=2, columns: {ax: {magnitude: m, phase: p}}}
  parameters:
    problem.stiffness: {from: 0}
    problem.damping.0.order: {from: 0.05, to: 1.95}
    problem.damping.0.coefficient: {from: 0}
"""


def test_a_response_gives_the_parameters_back(tmp_path):
    hertz = np.linspace(0.2, 2.5, 60)
    s = 2j * np.pi * hertz
    value = 2.0 * s**2 / (s**2 + 0.7 * s**1.4 + 40.0)
    rows = np.column_stack([hertz, np.abs(value), np.degrees(np.angle(value))])
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    (tmp_path / "frf.csv").write_text("f,m,p\n" + "\n".join(lines) + "\n")
    (tmp_path / "frf.yaml").write_text(RESPONSE)
    (result,) = fvi.fit(tmp_path / "frf.yaml")
    assert result.best.is_converged
    values = [one.value for one in result.best.estimates]
    np.testing.assert_allclose(values, [40.0, 1.4, 0.7], rtol=1e-8)
