"""Data of several kinds without noise, and how often intervals of fits to them hold the truth.

They come from Laplace transforms inverted in extended precision and from complex moduli. The same
noise is given to the linear problem: the derivatives at the truth, the true noise of every column.
"""

from dataclasses import dataclass, replace
from functools import cache

import mpmath
import numpy as np
import pytest

from fvi_cli.studies.fits import fitting
from fvi_cli.studies.fits.intervals import quantile
from fvi_cli.studies.fits.model import MotionModel
from fvi_cli.studies.fits.search import least_squares_from
from fvi_cli.studies.fits.settings import (
    Amplitude,
    DataSet,
    FitModel,
    FitParameter,
    FitSettings,
    Series,
)

HERTZ = np.geomspace(0.05, 1.5, 24)
SHORT, USUAL = np.linspace(0.4, 5.0, 8), np.linspace(0.2, 6.0, 25)
SPRINGPOT = [{"order": 0.6, "coefficient": 0.6}]
THREE = {"stiffness": 4.0, "damping.0.coefficient": 0.6, "damping.0.order": 0.6}


@dataclass(frozen=True, kw_only=True, eq=False)
class Kind:
    """Exact data, the deviations of their noise, and the true numbers by key below ``problem``."""

    damping: list
    free: dict
    series: tuple
    deviations: tuple
    name: str = ""

    @property
    def truth(self):
        return np.array(list(self.free.values()))

    @property
    def data(self):
        forces = ("x",) if self.series[0].amplitude is not None else ()
        return DataSet(name="a", series=self.series, forces=forces, coordinates=("x",))

    @property
    def model(self):
        problem = {
            "kind": "damped-oscillator",
            "mass": 1.0,
            "stiffness": 4.0,
            "damping": self.damping,
            "initial": {"position": 1.0, "velocity": 0.0},
            "final_time": 10.0,
        }
        parameters = [
            FitParameter(
                key=f"problem.{name}",
                start=value,
                low=0.05 if name.endswith("order") else 0.0,
                high=1.95 if name.endswith("order") else np.inf,
            )
            for name, value in self.free.items()
        ]
        return FitModel(name="", specification=problem, parameters=tuple(parameters))


def column(name, times, values):
    return Series(name=name, column=name, times=times, values=values)


def springpot(s):
    return mpmath.mpf(0.6) * s ** mpmath.mpf(0.6)


def zener(s):
    power = (s * mpmath.mpf("0.3")) ** mpmath.mpf(0.6)
    return 3 * power / (1 + power)


def motion(times, modulus, *, is_velocity=False):
    """x or v of ``x'' + (4 + modulus) x = 0`` from rest at 1."""

    def position(s):
        return (s + modulus(s) / s) / (s**2 + modulus(s) + 4)

    def wanted(s):
        return s * position(s) - 1 if is_velocity else position(s)

    with mpmath.workdps(30):
        found = [
            mpmath.invertlaplace(wanted, t, method="talbot", degree=50) for t in times.tolist()
        ]
    return np.array([float(one) for one in found])


def free_motion(damping, modulus, times, free, noise):
    series = (column("x", times, motion(times, modulus)),)
    return Kind(damping=damping, free=free, series=series, deviations=(noise,))


def with_velocity(ratio):
    """Position and velocity, of noises that differ by `ratio`."""
    times = np.linspace(0.2, 6.0, 20)
    series = (
        column("x", times, motion(times, springpot)),
        column("vx", times, motion(times, springpot, is_velocity=True)),
    )
    precise = 0.2 / ratio if ratio > 20 else 0.02
    return Kind(damping=SPRINGPOT, free=THREE, series=series, deviations=(precise, 0.2))


def response():
    s = 2j * np.pi * HERTZ
    values = 1.0 / (s**2 + 4.0 + 0.6 * s**0.6)
    series = tuple(
        Series(
            name=part,
            column=part,
            times=HERTZ,
            values=numbers,
            amplitude=Amplitude(row=np.ones(1), rate=0, part=part),
        )
        for part, numbers in (("real", values.real), ("imaginary", values.imag))
    )
    return Kind(damping=SPRINGPOT, free=THREE, series=series, deviations=(0.01, 0.01))


def of_zener():
    law = {"law": "zener", "order": 0.6, "time": 0.3, "relaxed": 0.0, "unrelaxed": 3.0}
    free = {"damping.0.unrelaxed": 3.0, "damping.0.time": 0.3, "stiffness": 4.0}
    return free_motion([law], zener, USUAL, free, 0.01)


KINDS = {
    "two columns, noises 1:10": lambda: with_velocity(10.0),
    "two columns, noises 1:100": lambda: with_velocity(100.0),
    "Zener law": of_zener,
    "springpot": lambda: free_motion(SPRINGPOT, springpot, USUAL, THREE, 0.02),
    "springpot, frequencies": response,
    "8 samples": lambda: free_motion(SPRINGPOT, springpot, SHORT, THREE, 0.01),
}


@cache
def kind_named(name):
    return replace(KINDS[name](), name=name)


def noise_of(kind, number):
    """The noise of every series."""
    generator = np.random.default_rng([5, len(kind.name), number])
    return [
        deviation * generator.standard_normal(one.values.size)
        for one, deviation in zip(kind.series, kind.deviations, strict=True)
    ]


def fit_nearby(settings, model):
    """A fit whose search begins at the given start alone, which is faster."""

    def nearby(motions, scale):
        motions.loosen(1e-4 * scale)
        return least_squares_from(motions, motions.start, tolerance=1e-3)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fitting, "search", nearby)
        return fitting.fit_model(settings, model)


def fitted(kind, number):
    """A fit of noisy data, the size of whose noise is estimated."""
    series = tuple(
        replace(one, values=one.values + noise)
        for one, noise in zip(kind.series, noise_of(kind, number), strict=True)
    )
    data = replace(kind.data, series=series)
    return fit_nearby(FitSettings(data=(data,), models=()), kind.model)


def holds_truth(kind, found):
    """Which intervals hold the truth; an open end holds all."""
    return tuple(
        not (one.low > true or one.high < true)
        for one, true in zip(found.estimates, kind.truth, strict=True)
    )


@cache
def derivatives(kind):
    """Of all values, over the true noise, by the numbers themselves at the truth."""
    model = MotionModel(kind.model, (kind.data,), [1.0] * len(kind.series))
    point = np.array([one.inner(v) for one, v in zip(model.free, kind.truth, strict=True)])
    model.remesh(point, 1e-9)
    jacobian = model.evaluate(point).jacobian
    sizes = np.repeat(kind.deviations, [one.values.size for one in kind.series])
    return jacobian / model.slopes(point) / sizes[:, None]


def holds_in_theory(kind, number):
    """Which exact intervals of the linear problem with this noise hold the truth."""
    jacobian = derivatives(kind)
    noise = np.concatenate(
        [n / d for n, d in zip(noise_of(kind, number), kind.deviations, strict=True)]
    )
    found, _, _, _ = np.linalg.lstsq(jacobian, noise, rcond=None)
    left = noise - jacobian @ found
    freedom = noise.size - found.size
    errors = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)) * (left @ left) / freedom)
    return tuple(np.abs(found) <= quantile(freedom, is_known=False) * errors)
