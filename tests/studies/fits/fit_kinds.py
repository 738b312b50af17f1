"""Measurements of many kinds, and how often intervals of fits to them hold the truth.

The program makes the data at the truth. The same noise is given to the linear problem: the
derivatives at the truth, the true noise of every value.
"""

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import pytest
from measured_responses import response_data

from fvi_cli.studies.fits import fitting
from fvi_cli.studies.fits.intervals import quantile
from fvi_cli.studies.fits.model import MotionModel
from fvi_cli.studies.fits.search import least_squares_from
from fvi_cli.studies.fits.settings import DataSet, FitModel, FitParameter, FitSettings, Series
from fvi_cli.studies.members import value_at

DATA = {"initial": {"position": 1.0, "velocity": 0.0}, "final_time": 10.0}
SPRINGPOT = DATA | {"damping": [{"order": 0.6, "coefficient": 0.6}]}
OSCILLATOR = SPRINGPOT | {"kind": "damped-oscillator", "mass": 1.0, "stiffness": 4.0}
THREE = ("stiffness", "damping.0.coefficient", "damping.0.order")
ZENER = {"law": "zener", "order": 0.6, "time": 0.3, "relaxed": 1.0, "unrelaxed": 3.0}
PRONY = {"law": "prony", "moduli": [3.0], "times": [0.4], "relaxed": 0.0}
TWO = [{"order": 0.3, "coefficient": 0.5}, {"order": 1.2, "coefficient": 0.3}]
FRAME = {
    "kind": "frame",
    "storeys": 2,
    "stiffness": [30.0, 20.0],
    "dampers": [{"order": 0.5, "coefficient": 0.8}],
    "ground_acceleration": {"pieces": [{"until": 1.0, "value": "sin(3*t)"}, {"value": "0"}]},
    "final_time": 6.0,
}
TRIANGLE = [{"until": 1.0, "value": "t"}, {"until": 3.0, "value": "2 - t"}, {"value": "t - 4"}]
BENCH = {"kind": "material", "law": ZENER, "displacement": {"pieces": TRIANGLE}, "final_time": 4.0}
HERTZ = np.geomspace(0.05, 1.5, 24)


@dataclass(frozen=True, kw_only=True, eq=False)
class Kind:
    """A problem at its truth, the numbers that are fitted, and noise of what is measured."""

    problem: dict
    noise: dict
    free: tuple = THREE
    times: np.ndarray = field(default_factory=lambda: np.linspace(0.2, 6.0, 25))
    motions: tuple = ({},)  # what is different in each, by key
    is_response: bool = False
    is_relative: bool = False
    is_given: bool = False  # whether the fit knows the noise

    @property
    def truth(self):
        return np.array([float(value_at(self.problem, f"problem.{key}")) for key in self.free])

    def model(self, factors=1.0):
        """The model whose search begins at the truth times factors."""
        parameters = [
            FitParameter(
                key=f"problem.{key}",
                start=start,
                low=0.05 if key.endswith("order") else 0.0,
                high=0.95 if key.endswith("order") else np.inf,
            )
            for key, start in zip(self.free, (self.truth * factors).tolist(), strict=True)
        ]
        return FitModel(name="", specification=self.problem, parameters=tuple(parameters))


KINDS = {
    "springpot": Kind(problem=OSCILLATOR, noise={"x": 0.02}),
    "8 samples": Kind(problem=OSCILLATOR, noise={"x": 0.01}, times=np.linspace(0.4, 5.0, 8)),
    "two columns": Kind(problem=OSCILLATOR, noise={"x": 0.002, "vx": 0.2}),
    "two motions": Kind(
        problem=OSCILLATOR,
        noise={"x": 0.02},
        times=np.linspace(0.3, 6.0, 12),
        motions=({}, {"problem.initial.position": 2.5}),
    ),
    "two springpots": Kind(
        problem=OSCILLATOR | {"damping": TWO},
        noise={"x": 0.01},
        free=("damping.0.coefficient", "damping.1.coefficient"),
    ),
    "Zener law": Kind(
        problem=OSCILLATOR | {"damping": [ZENER]},
        noise={"x": 0.01},
        free=("damping.0.unrelaxed", "damping.0.time"),
    ),
    "Prony series": Kind(
        problem=OSCILLATOR | {"damping": [PRONY]},
        noise={"x": 0.01},
        free=("stiffness", "damping.0.moduli.0", "damping.0.times.0"),
    ),
    "response": Kind(
        problem=OSCILLATOR, noise={"real": 0.01, "imaginary": 0.01}, times=HERTZ, is_response=True
    ),
    "response, relative noise": Kind(
        problem=OSCILLATOR,
        noise={"magnitude": 0.02},
        times=HERTZ,
        is_response=True,
        is_relative=True,
        is_given=True,
    ),
    "Duffing, known noise": Kind(
        problem=OSCILLATOR | {"kind": "duffing", "cubic_stiffness": 1.0},
        noise={"x": 0.02},
        free=("stiffness", "cubic_stiffness", "damping.0.coefficient"),
        is_given=True,
    ),
    "pendulum": Kind(
        problem=SPRINGPOT | {"kind": "pendulum", "omega": 2.0},
        noise={"x": 0.02},
        free=("omega", *THREE[1:]),
    ),
    "shaken frame": Kind(
        problem=FRAME,
        noise={"x1": 0.0005, "x2": 0.0005},
        free=("stiffness.0", "stiffness.1", "dampers.0.coefficient"),
    ),
    "damper on the bench": Kind(
        problem=BENCH,
        noise={"force": 0.05},
        free=("law.relaxed", "law.unrelaxed", "law.order"),
        times=np.linspace(0.1, 4.0, 30),
    ),
}


def with_values(data, values):
    """The data with all their values in one row, which are parted among the series."""
    rows = iter(values.reshape(-1, data[0].series[0].times.size))
    return tuple(
        replace(one, series=tuple(replace(each, values=next(rows)) for each in one.series))
        for one in data
    )


def linear_model(kind, data):
    """Residuals at the truth, and their derivatives."""
    model = MotionModel(kind.model(), FitSettings(data=data, models=(), deviation=1.0))
    model.remesh(model.start, 2)
    return model.evaluate(model.start)


@cache
def exact_data(kind):
    """What is measured, without noise."""
    zero = np.zeros(kind.times.size)
    if kind.is_response:
        empty = (response_data(kind.times, dict.fromkeys(kind.noise, zero)),)
    else:
        series = [Series(name=one, column=one, times=kind.times, values=zero) for one in kind.noise]
        empty = tuple(
            DataSet(name=str(number), series=tuple(series), changes=changes)
            for number, changes in enumerate(kind.motions)
        )
    return with_values(empty, linear_model(kind, empty).residuals)


def values_of(kind):
    return np.concatenate([each.values for one in exact_data(kind) for each in one.series])


def deviations_of(kind):
    """Of the noise of every value."""
    sizes = np.tile(np.repeat(list(kind.noise.values()), kind.times.size), len(kind.motions))
    return sizes * np.abs(values_of(kind)) if kind.is_relative else sizes


def noise_of(kind, number):
    """Drawn noise of all values, over its deviation."""
    seed = [5, list(KINDS.values()).index(kind), number]
    return np.random.default_rng(seed).standard_normal(deviations_of(kind).size)


def measured(kind, number):
    """Settings of a fit to noisy data."""
    values = values_of(kind) + noise_of(kind, number) * deviations_of(kind)
    (size, *_) = kind.noise.values()
    given = {"relative" if kind.is_relative else "deviation": size} if kind.is_given else {}
    return FitSettings(data=with_values(exact_data(kind), values), models=(), **given)


def fit_nearby(settings, model):
    """A fit whose search begins at the given start alone, which is faster."""

    def nearby(motions):
        return least_squares_from(motions, motions.start, tolerance=1e-3).point

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fitting, "search", nearby)
        return fitting.fit_model(settings, model)


def holds_truth(kind, found):
    """Which intervals hold the truth; an open end holds all."""
    pairs = zip(found.estimates, kind.truth.tolist(), strict=True)
    return [not (one.low > true or one.high < true) for one, true in pairs]


def holds_in_theory(kind, number):
    """Which exact intervals of the linear problem with this noise hold the truth."""
    jacobian = linear_model(kind, exact_data(kind)).jacobian / deviations_of(kind)[:, None]
    noise = noise_of(kind, number)
    found, _, _, _ = np.linalg.lstsq(jacobian, noise, rcond=None)
    left = noise - jacobian @ found
    freedom = noise.size - found.size
    variance = 1.0 if kind.is_given else left @ left / freedom
    errors = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)) * variance)
    wide = quantile(np.inf if kind.is_given else freedom)
    return (np.abs(found) <= wide * errors).tolist()
