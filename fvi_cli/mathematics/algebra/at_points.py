"""Programs at many points at once, with parameters of its own for every member."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS, REAL_BRANCHES, value_of
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array


class PointFormulas:
    """The values of a program as a function of points, quickly.

    Values at a point are the same to the last bit whatever other points stand beside it.
    Floating-point errors are treated as the caller's ``np.errstate`` says.

    Variables are the names of the components of points. Parameters, the other names, are numbers or
    arrays that broadcast with a component: points ``(q, n, k)`` of q members go with ``(q, 1)``.
    """

    def __init__(
        self,
        system: FormulaSystem,
        variables: Sequence[str],
        parameters: Mapping[str, float | Array],
        functions: Mapping[str, Callable[..., Any]] = NUMPY_FUNCTIONS,
    ) -> None:
        places = {name: place for place, name in enumerate(variables)}
        self._given: list[Any] = [
            places[name] if name in places else value_of(name, parameters) for name in system.names
        ]
        self._run = system.compiled_for(functions)
        self._kind = complex if functions is REAL_BRANCHES else float
        self._count = len(system.outputs)

    def __call__(self, *points: Array) -> Array:
        """The values ``(..., number of outputs)`` at points ``(..., k)``.

        Several arrays stand for one with all of their components.
        """
        # contiguous: vector instructions do the same to every point, wherever it stands
        components = [
            np.ascontiguousarray(one[..., index])
            for one in points
            for index in range(one.shape[-1])
        ]
        values = self._run(*[components[k] if type(k) is int else k for k in self._given])
        shape = points[0].shape[:-1]
        if self._count == 1:
            (only,) = values
            # an array with a base is the point itself
            if isinstance(only, np.ndarray) and only.base is None and only.shape == shape:
                return only[..., None]
        found = np.empty((*shape, self._count), dtype=self._kind)
        for index, value in enumerate(values):
            found[..., index] = value
        return found
