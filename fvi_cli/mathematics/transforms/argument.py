r"""Change of log f along a path, for the argument principle.

Points are put between neighbours until log f, the modulus included, changes by less than 1 from one
to the next, and half way between them by what the change of the whole interval predicts. The
modulus and the points half way show zeros that come in twos, whose turns of two pi would be
overlooked.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvi_cli.mathematics.arrays import Array, ComplexArray

LogFunction = Callable[[ComplexArray], ComplexArray]

_LARGEST_CHANGE = 1.0
_LARGEST_SURPRISE = 0.5
_ROUNDS = 48
_MOST_POINTS = 200_000


class PathError(ValueError):
    """The function cannot be followed along a path: a zero lies on it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Followed:
    """A function along a path.

    Parameters
    ----------
    parameters, points
        Where it was evaluated, shape ``(n,)``.
    values
        log f there, any branch.
    """

    parameters: Array
    points: ComplexArray
    values: ComplexArray

    @property
    def turn(self) -> float:
        """Change of the argument of f, radians."""
        return float(principal_changes(self.values).imag.sum())


def follow(
    log_function: LogFunction, path: Callable[[Array], ComplexArray], parameters: Array
) -> Followed:
    """Evaluate log f on a path so densely that its change is known.

    Parameters
    ----------
    log_function
        Any branch of log f at an array of points, minus infinity at a zero.
    path
        Points of parameters.
    parameters
        To begin with, increasing.

    Raises
    ------
    PathError
        If a zero lies on the path to round-off.
    """

    def evaluate(at: Array) -> ComplexArray:
        values = log_function(path(at))
        if not np.isfinite(values).all():
            raise PathError("no finite value on the path")
        return values

    values = evaluate(parameters)
    suspect = np.ones(parameters.size - 1, dtype=bool)
    for _ in range(_ROUNDS):
        coarse = np.flatnonzero(suspect)
        if not coarse.size:
            return Followed(parameters=parameters, points=path(parameters), values=values)
        if parameters.size + coarse.size > _MOST_POINTS:
            break
        middles = 0.5 * (parameters[coarse] + parameters[coarse + 1])
        whole = principal_changes(values)
        new = evaluate(middles)
        parameters = np.insert(parameters, coarse + 1, middles)
        values = np.insert(values, coarse + 1, new)
        halves = principal_changes(values)
        # an interval needs no more points when its halves are small and add up to it
        first = coarse + np.arange(coarse.size)
        surprise = np.abs(halves[first] + halves[first + 1] - whole[coarse])
        settled = surprise < _LARGEST_SURPRISE
        suspect = np.zeros(parameters.size - 1, dtype=bool)
        suspect[first] = ~settled | (np.abs(halves[first]) > _LARGEST_CHANGE)
        suspect[first + 1] = ~settled | (np.abs(halves[first + 1]) > _LARGEST_CHANGE)
    raise PathError("a zero lies on the path")


def principal_changes(values: ComplexArray) -> ComplexArray:
    """Differences of neighbours whose imaginary parts lie between -pi and pi."""
    change = values[1:] - values[:-1]
    turns = np.round(change.imag / (2 * math.pi))
    return np.asarray(change - 2j * math.pi * turns)
