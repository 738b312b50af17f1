"""The elementary functions of formulas on intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.intervals.interval import Interval, everything, hull

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
    function = NUMPY_FUNCTIONS[name]
    first, last = _DOMAINS.get(name, (-math.inf, math.inf))

    def on_interval(value: Interval) -> Interval:
        with np.errstate(all="ignore"):
            return hull(
                function(np.clip(value.low, first, last)),
                function(np.clip(value.high, first, last)),
            )

    return on_interval


def _even(name: str) -> Callable[[Interval], Interval]:
    """A function that is even and increases with the size of its argument."""
    function = NUMPY_FUNCTIONS[name]

    def on_interval(value: Interval) -> Interval:
        holds_zero = (value.low <= 0) & (value.high >= 0)
        with np.errstate(all="ignore"):
            ends = hull(function(value.low), function(value.high))
            least = function(np.zeros(()))
        return Interval(np.where(holds_zero, least, ends.low), ends.high)

    return on_interval


def _holds(value: Interval, first: float, period: float) -> NDBool:
    """Whether the interval holds a point ``first + k period``."""
    with np.errstate(all="ignore"):
        following = first + period * np.ceil((value.low - first) / period)
    return np.asarray((following <= value.high) | ~np.isfinite(following))


NDBool = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def _sin(value: Interval) -> Interval:
    return _wave(value, np.sin, 0.5 * math.pi)


def _cos(value: Interval) -> Interval:
    return _wave(value, np.cos, 0.0)


def _wave(value: Interval, function: Callable[[Array], Array], top: float) -> Interval:
    with np.errstate(all="ignore"):
        ends = hull(function(value.low), function(value.high))
    at_top = _holds(value, top, 2 * math.pi)
    at_bottom = _holds(value, top + math.pi, 2 * math.pi)
    return Interval(
        np.where(at_bottom, -1.0, np.maximum(ends.low, -1.0)),
        np.where(at_top, 1.0, np.minimum(ends.high, 1.0)),
    )


def _tan(value: Interval) -> Interval:
    with np.errstate(all="ignore"):
        ends = hull(np.tan(value.low), np.tan(value.high))
    pole = _holds(value, 0.5 * math.pi, math.pi)
    return Interval(np.where(pole, -math.inf, ends.low), np.where(pole, math.inf, ends.high))


def _gamma(value: Interval) -> Interval:
    function = NUMPY_FUNCTIONS["gamma"]
    with np.errstate(all="ignore"):
        ends = hull(function(value.low), function(value.high))
    turns = (value.low <= GAMMA_TURNS_AT) & (value.high >= GAMMA_TURNS_AT)
    all_numbers, sound = everything(value.low), value.low > 0
    return Interval(
        np.where(sound, np.where(turns, LEAST_GAMMA, ends.low), all_numbers.low),
        np.where(sound, ends.high, all_numbers.high),
    )


INTERVAL_FUNCTIONS: Final[Mapping[str, Callable[[Interval], Interval]]] = MappingProxyType(
    {
        **{name: _monotone(name) for name in _MONOTONE},
        **{name: _even(name) for name in ("abs", "cosh")},
        "sin": _sin,
        "cos": _cos,
        "tan": _tan,
        "gamma": _gamma,
    }
)
"""The functions an expression may call, on intervals."""
