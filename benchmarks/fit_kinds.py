"""Data of many kinds without noise, and the problems that are fitted to them.

They come from Laplace transforms inverted in extended precision, complex moduli, and DOP853.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from benchmarks.fit_benches import BENCH, bench
from benchmarks.fit_kind import Array, Kind
from fvi_cli.studies.fits.settings import (
    Amplitude,
    DataSet,
    Series,
)

Complex = NDArray[np.complex128]
Transform = Callable[[mpmath.mpc], mpmath.mpc]

HERTZ = np.geomspace(0.05, 1.5, 24)


def _problem(damping: list[Any], velocity: float = 0.0, **more: Any) -> dict[str, Any]:
    return {
        "kind": "damped-oscillator",
        "mass": 1.0,
        "stiffness": 4.0,
        "damping": damping,
        "initial": {"position": 1.0, "velocity": velocity},
        "final_time": 10.0,
        **more,
    }


def _springpot(order: float, coefficient: float = 0.6) -> list[Any]:
    return [{"order": order, "coefficient": coefficient}]


def _series(name: str, times: Array, values: Array) -> Series:
    return Series(name=name, column=name, times=times, values=values, is_velocity=name == "vx")


def _inverted(transform: Transform, times: Array) -> Array:
    with mpmath.workdps(30):
        return np.array(
            [
                float(mpmath.invertlaplace(transform, t, method="talbot", degree=50))
                for t in times.tolist()
            ]
        )


def _free_motion(
    times: Array, modulus: Transform, start: float = 1.0, velocity: float = 0.0, order: float = 0.0
) -> Array:
    """X of x'' + (k + modulus) x: a law takes x - x(0), a derivative of order > 1 less v(0) t."""

    def transform(s: mpmath.mpc) -> mpmath.mpc:
        known = start / s + (velocity / s**2 if order > 1 else 0)
        return (s * start + velocity + modulus(s) * known) / (s**2 + modulus(s) + 4)

    return _inverted(transform, times)


def _motions(
    damping: list[Any],
    modulus: Transform,
    times: Array,
    free: Mapping[str, float],
    noise: float,
    velocity: float = 0.0,
    order: float = 0.0,
) -> Kind:
    values = _free_motion(times, modulus, velocity=velocity, order=order)
    data = DataSet(name="a", series=(_series("x", times, values),))
    return Kind(
        problem=_problem(damping, velocity),
        free=free,
        data=(data,),
        deviations=(noise,),
    )


def _powers(order: float) -> Transform:
    return lambda s: 0.6 * s ** mpmath.mpf(order)


def _with_velocity(ratio: float) -> Kind:
    """Position and velocity, of noises that differ by `ratio`."""
    times = np.linspace(0.2, 6.0, 20)
    modulus = _powers(0.6)

    def velocity(s: mpmath.mpc) -> mpmath.mpc:
        return s * (s + modulus(s) / s) / (s**2 + modulus(s) + 4) - 1

    data = DataSet(
        name="a",
        series=(
            _series("x", times, _free_motion(times, modulus)),
            _series("vx", times, _inverted(velocity, times)),
        ),
    )
    return Kind(
        problem=_problem(_springpot(0.6)),
        free={"stiffness": 4.0, "damping.0.coefficient": 0.6, "damping.0.order": 0.6},
        data=(data,),
        deviations=(0.2 / ratio if ratio > 20 else 0.02, 0.2),
    )


def _response(
    damping: list[Any], modulus: Complex, free: Mapping[str, float], noise: float
) -> Kind:
    s = 2j * np.pi * HERTZ
    values = 1.0 / (s**2 + 4.0 + modulus)
    series = tuple(
        Series(
            name=part,
            column=part,
            times=HERTZ,
            values=column,
            amplitude=Amplitude(row=np.ones(1), rate=0, part=part),
        )
        for part, column in (("real", values.real), ("imaginary", values.imag))
    )
    data = DataSet(name="a", series=series, forces=("x",), coordinates=("x",))
    return Kind(problem=_problem(damping), free=free, data=(data,), deviations=(noise, noise))


def _several_sets() -> Kind:
    times = np.linspace(0.3, 6.0, 15)
    found = tuple(
        DataSet(
            name=name,
            series=(_series("x", times, _free_motion(times, _powers(0.6), start)),),
            changes={"problem.initial.position": start},
        )
        for name, start in (("low", 1.0), ("high", 2.0))
    )
    return Kind(
        problem=_problem(_springpot(0.6)),
        free={
            "stiffness": 4.0,
            "damping.0.coefficient": 0.6,
            "damping.0.order": 0.6,
            "initial.position@low": 1.0,
            "initial.position@high": 2.0,
        },
        data=found,
        deviations=(0.02, 0.03),
    )


def _duffing() -> Kind:
    times = np.linspace(0.2, 6.0, 25)
    motion = solve_ivp(
        lambda t, y: (y[1], -0.4 * y[1] - 2.0 * y[0] - 1.5 * y[0] ** 3),
        (0.0, 6.0),
        (1.0, 0.0),
        method="DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-14,
    )
    position = np.asarray(motion.y[0], dtype=float)
    problem = {
        "kind": "duffing",
        "stiffness": 2.0,
        "cubic_stiffness": 1.5,
        "damping": [{"order": 1.0, "coefficient": 0.4}],
        "initial": {"position": 1.0, "velocity": 0.0},
        "final_time": 10.0,
    }
    return Kind(
        problem=problem,
        free={"stiffness": 2.0, "cubic_stiffness": 1.5, "damping.0.coefficient": 0.4},
        data=(DataSet(name="a", series=(_series("x", times, position),)),),
        deviations=(0.02,),
    )


_THREE = {"stiffness": 4.0, "damping.0.coefficient": 0.6, "damping.0.order": 0.6}
_SHORT, _USUAL = np.linspace(0.4, 5.0, 8), np.linspace(0.2, 6.0, 25)
_S = np.asarray(2j * np.pi * HERTZ, dtype=np.complex128)


def _zener() -> Kind:
    law = {"law": "zener", "order": 0.6, "time": 0.3, "relaxed": 0.0, "unrelaxed": 3.0}

    def modulus(s: mpmath.mpc) -> mpmath.mpc:
        power = (s * mpmath.mpf("0.3")) ** mpmath.mpf(0.6)
        return 3 * power / (1 + power)

    free = {"damping.0.unrelaxed": 3.0, "damping.0.time": 0.3, "stiffness": 4.0}
    return _motions([law], modulus, _USUAL, free, 0.01)


def _superfluous() -> Kind:
    law = {"law": "zener", "order": 0.5, "time": 0.3, "relaxed": 0.0, "unrelaxed": 0.1}
    free = {"stiffness": 4.0, "damping.0.coefficient": 0.6, "damping.1.unrelaxed": 0.0}
    return _response([*_springpot(0.6), law], 0.6 * _S**0.6, free, 0.005)


def _prony() -> Kind:
    law = {"law": "prony", "moduli": [2.0], "times": [0.4], "relaxed": 0.0}
    free = {"stiffness": 4.0, "damping.0.moduli.0": 2.0, "damping.0.times.0": 0.4}
    return _response([law], 2.0 * _S * 0.4 / (1 + _S * 0.4), free, 0.005)


def _beside_one(order: float) -> Kind:
    return _motions(
        _springpot(order),
        _powers(order),
        _USUAL,
        _THREE | {"damping.0.order": order},
        0.02,
        velocity=1.0,
        order=order,
    )


KINDS: Mapping[str, Callable[[], Kind]] = {
    "two columns, noises 1:10": lambda: _with_velocity(10.0),
    "two columns, noises 1:100": lambda: _with_velocity(100.0),
    "a superfluous Zener law": _superfluous,
    "order 0.97 with a start velocity": lambda: _beside_one(0.97),
    "order 1.03 with a start velocity": lambda: _beside_one(1.03),
    "Zener law": _zener,
    "Prony law, frequencies": _prony,
    "springpot": lambda: _motions(_springpot(0.6), _powers(0.6), _USUAL, _THREE, 0.02),
    "springpot, frequencies": lambda: _response(_springpot(0.6), 0.6 * _S**0.6, _THREE, 0.01),
    "two data sets, start positions of their own": _several_sets,
    "8 samples": lambda: _motions(_springpot(0.6), _powers(0.6), _SHORT, _THREE, 0.01),
    "Duffing's oscillator": _duffing,
}
"""How the data of every kind are made, by name."""


@cache
def kind_named(name: str) -> Kind:
    """The data of a kind, made once."""
    makers: dict[str, Callable[[], Kind]] = {**KINDS, BENCH: bench}
    return replace(makers[name](), name=name)
