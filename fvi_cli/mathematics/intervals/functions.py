"""The elementary functions of formulas on intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.intervals.interval import Interval, everything, hull, monotone

_DOMAINS: Final[Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        "sqrt": (0.0, math.inf),
        "log": (0.0, math.inf),
        "log1p": (-1.0, math.inf),
        "arcsin": (-1.0, 1.0),
        "arccos": (-1.0, 1.0),
        "arccosh": (1.0, math.inf),
        "arctanh": (-1.0, 1.0),
    }
)
_MONOTONE: Final = (
    *_DOMAINS,
    *("cbrt", "exp", "expm1", "sinh", "tanh", "arctan", "arcsinh", "sign"),
)
GAMMA_TURNS_AT: Final = 1.4616321449683622
"""Where the gamma function of positive numbers is least."""
LEAST_GAMMA: Final = 0.8856031944108886


def _monotone(name: str) -> Callable[[Interval], Interval]:
    function, domain = NUMPY_FUNCTIONS[name], _DOMAINS.get(name, ())
    return lambda value: monotone(function, value, *domain)


def _even(name: str) -> Callable[[Interval], Interval]:
    """A function that is even and increases with the size of its argument."""
    function = NUMPY_FUNCTIONS[name]

    def on_interval(value: Interval) -> Interval:
        holds_zero = (value.low <= 0) & (value.high >= 0)
        ends = monotone(function, value)
        return Interval(np.where(holds_zero, function(np.zeros(())), ends.low), ends.high)

    return on_interval


def _holds(value: Interval, first: float, period: float) -> NDArray[np.bool_]:
    """Whether the interval holds a point ``first + k period``."""
    following = first + period * np.ceil((value.low - first) / period)
    return np.asarray((following <= value.high) | ~np.isfinite(following))


def _wave(value: Interval, function: Callable[[Array], Array], top: float) -> Interval:
    """Sine or cosine, the first maximum of which is given."""
    ends = monotone(function, value)
    at_top = _holds(value, top, 2 * math.pi)
    at_bottom = _holds(value, top + math.pi, 2 * math.pi)
    return Interval(
        np.where(at_bottom, -1.0, np.maximum(ends.low, -1.0)),
        np.where(at_top, 1.0, np.minimum(ends.high, 1.0)),
    )


def _tan(value: Interval) -> Interval:
    ends = monotone(np.tan, value)
    pole = _holds(value, 0.5 * math.pi, math.pi)
    return Interval(np.where(pole, -math.inf, ends.low), np.where(pole, math.inf, ends.high))


def _gamma(value: Interval) -> Interval:
    ends = monotone(NUMPY_FUNCTIONS["gamma"], value)
    turns = (value.low <= GAMMA_TURNS_AT) & (value.high >= GAMMA_TURNS_AT)
    all_numbers, sound = everything(value.low), value.low > 0
    return Interval(
        np.where(sound, np.where(turns, LEAST_GAMMA, ends.low), all_numbers.low),
        np.where(sound, ends.high, all_numbers.high),
    )


def _extremum(name: str) -> Callable[[Interval | float, Interval | float], Interval]:
    function = NUMPY_FUNCTIONS[name]

    def on_intervals(a: Interval | float, b: Interval | float) -> Interval:
        (a_low, a_high), (b_low, b_high) = _ends(a), _ends(b)
        return hull(function(a_low, b_low), function(a_high, b_high))

    return on_intervals


def _ends(value: Interval | float) -> tuple[Array, Array]:
    if isinstance(value, Interval):
        return value.low, value.high
    return np.asarray(value), np.asarray(value)


def _select(
    a: Interval | float, b: Interval | float, below: Interval | float, above: Interval | float
) -> Interval:
    """The range of what is taken; of both where it is not known which."""
    (a_low, a_high), (b_low, b_high) = _ends(a), _ends(b)
    first, second = _ends(below), _ends(above)
    low = np.where(a_low > b_high, second[0], first[0])
    high = np.where(a_low > b_high, second[1], first[1])
    unknown = ~((a_low > b_high) | (a_high < b_low))
    return hull(
        np.where(unknown, np.minimum(first[0], second[0]), low),
        np.where(unknown, np.maximum(first[1], second[1]), high),
    )


INTERVAL_FUNCTIONS: Final[Mapping[str, Callable[..., Interval]]] = MappingProxyType(
    {
        **{name: _monotone(name) for name in _MONOTONE},
        **{name: _even(name) for name in ("abs", "cosh")},
        "sin": lambda value: _wave(value, np.sin, 0.5 * math.pi),
        "cos": lambda value: _wave(value, np.cos, 0.0),
        "tan": _tan,
        "gamma": _gamma,
        **{name: _extremum(name) for name in ("min", "max")},
        "select": _select,
    }
)
"""The functions an expression may call, on intervals."""
