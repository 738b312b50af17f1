"""A description of motions as a function of its free parameters, with exact derivatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.gradient import RunFailedError, run_steps
from fvi_cli.integrator.gradients.parameters import Described, parameter_of
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.observe.dampers import damper_values
from fvi_cli.integrator.observe.request import Observations, known_names
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.registry import build_problem, build_scene
from fvi_cli.studies.fits.predictions import METHOD, Predicted, predict_motion, predict_response
from fvi_cli.studies.fits.settings import DataSet, FitModel
from fvi_cli.studies.members import with_values

MOST_STEPS, MORE_STEPS = 20_000, 100
"""Most steps of a run; during the search: two for every measurement, and so many more."""
COARSE = 64
"""Number of steps of the runs that find the size of a motion without measured positions."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """The model at one point."""

    residuals: Array
    """(model - data) / deviation of every value, shape ``(n,)``."""
    jacobian: Array | None = None
    """Derivatives with respect to inner parameters, ``(n, p)``; None: they were not requested."""

    @property
    def cost(self) -> float:
        """Sum of the squares."""
        return float(self.residuals @ self.residuals)


class MotionModel:
    """The motions of all data sets as functions of the free parameters.

    `deviations` are those of all series, one after the other; `evaluations` counts runs.
    """

    def __init__(
        self, model: FitModel, data: Sequence[DataSet], deviations: Sequence[float]
    ) -> None:
        self.model, self.data, self.deviations = model, tuple(data), list(deviations)
        self.series = [one for each in data for one in each.series]
        self.free = model.parameters
        self.meshes: list[AnySteps] = []
        self.evaluations = 0

    @property
    def size(self) -> int:
        """Number of measured values."""
        return sum(self.sizes)

    @property
    def sizes(self) -> list[int]:
        """Number of values of every series."""
        return [one.values.size for one in self.series]

    def split(self, residuals: Array) -> list[Array]:
        """Residuals of every series in the unit of the data."""
        parts = np.split(residuals, np.cumsum(self.sizes)[:-1])
        return [part * deviation for part, deviation in zip(parts, self.deviations, strict=True)]

    @property
    def start(self) -> Array:
        """Starting point of the search, inner parameters (logarithms of positive ones)."""
        return np.array([one.inner(one.start) for one in self.free])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the inner parameters, ``(p,)`` each."""
        pairs = np.array([one.inner_bounds for one in self.free]).reshape(-1, 2)
        return pairs[:, 0], pairs[:, 1]

    def values(self, inner: Array) -> Array:
        """The parameters of a point in inner parameters."""
        return np.array([one.outer(u) for one, u in zip(self.free, inner, strict=True)])

    def slopes(self, inner: Array) -> Array:
        """Derivatives of the parameters with respect to the inner ones."""
        return np.array(
            [
                value if one.is_positive else 1.0
                for one, value in zip(self.free, self.values(inner), strict=True)
            ]
        )

    def assignments(self, number: int, values: Array) -> dict[str, float]:
        """Key paths with their values, for one data set."""
        named = {one.key: float(value) for one, value in zip(self.free, values, strict=True)}
        return {**self.data[number].changes, **named}

    def _specified(
        self, number: int, values: Array, index: int = -1, value: float = 0.0
    ) -> Mapping[str, Any]:
        """The ``problem`` mapping of one data set, with another value of one parameter if any."""
        if index >= 0:
            values = values.copy()
            values[index] = value
        return with_values(self.model.specification, self.assignments(number, values))

    def scene(self, number: int, values: Array, index: int = -1, value: float = 0.0) -> Scene:
        """The scene of one data set, up to its last measurement.

        Raises
        ------
        ValueError
            If there is none for these values.
        """
        scene, data = build_scene(self._specified(number, values, index, value)), self.data[number]
        return scene if data.forces else replace(scene, final_time=data.last_time)

    def remesh(self, inner: Array, tolerance: float) -> None:
        """Choose the steps anew, for motions near this point.

        Raises
        ------
        RunFailedError
            If a run does not come to its end.
        """
        values = self.values(inner)
        self.meshes = [1] * len(self.data)
        for number, data in enumerate(self.data):
            if not data.forces:
                steps = AdaptiveSteps(tolerance=tolerance, most_steps=MOST_STEPS)
                scene = self.scene(number, values)
                self.meshes[number] = run_steps(scene, METHOD, steps).mesh(scene.break_points)
                self.evaluations += 1

    def size_at_start(self) -> float:
        """Largest position in coarse runs at the starting point of the search.

        Raises
        ------
        ValueError
            If they do not come to their end.
        """
        values = self.values(self.start)
        runs = [
            run_steps(self.scene(number, values), METHOD, COARSE)
            for number, data in enumerate(self.data)
            if not data.forces
        ]
        return max((float(np.abs(one.position).max()) for one in runs), default=0.0)

    def loosen(self, tolerance: float) -> None:
        """Choose the steps of every run on its own from now on.

        A motion that needs far more steps than there are measurements is not the one measured.
        """
        self.meshes = [
            AdaptiveSteps(
                tolerance=tolerance,
                most_steps=MORE_STEPS + 2 * max(one.times.size for one in data.series),
            )
            for data in self.data
        ]

    def evaluate(self, inner: Array, *, with_jacobian: bool = True) -> Evaluation:
        """Residuals and their derivatives, computed on the steps that were chosen last.

        Raises
        ------
        RunFailedError
            If a run does not come to its end.
        ValueError
            If there is no scene for these values.
        """
        values, factors = self.values(inner), self.slopes(inner)
        residuals: list[Array] = []
        rows: list[Array] = []
        for number, data in enumerate(self.data):
            self.evaluations += 1
            own = range(len(self.free)) if with_jacobian else ()
            # steps of the search may lead to motions that grow beyond all bounds
            with np.errstate(all="ignore"):
                predicted = self._predicted(number, data, values, own)
            for one, (found, rates) in zip(data.series, predicted, strict=True):
                left, deviation = found - one.values, self.deviations[len(rows)]
                if one.amplitude is not None and one.amplitude.part == "phase":
                    left = (left + 180.0) % 360.0 - 180.0
                residuals.append(left / deviation)
                part = np.zeros((one.values.size, len(self.free)))
                part[:, own] = rates / deviation
                rows.append(part * factors)
        together, slopes = np.concatenate(residuals), np.concatenate(rows)
        if not (np.isfinite(together).all() and np.isfinite(slopes).all()):
            raise RunFailedError("the motion is not finite")
        return Evaluation(residuals=together, jacobian=slopes if with_jacobian else None)

    def _predicted(
        self, number: int, data: DataSet, values: Array, own: Sequence[int]
    ) -> Predicted:
        """Values of the model for a data set, with derivatives by some of the parameters."""
        described = self._described(number, values)
        parameters = [
            parameter_of(
                self.free[index].key,
                partial(self._described, number, values, index),
                float(values[index]),
                described,
            )
            for index in own
        ]
        if data.forces:
            direction = self.model.specification.get("ground_direction", 1.0)
            return predict_response(described[0], data, parameters, direction)
        return predict_motion(described, self.meshes[number], data, parameters)

    def _described(
        self, number: int, values: Array, index: int = -1, value: float = 0.0
    ) -> Described:
        """The scene of one data set, and the names in the formulas of its columns."""
        scene, data = self.scene(number, values, index, value), self.data[number]
        names = Observations(coordinates=data.coordinates)
        known = {*known_names(data.coordinates), *damper_values(scene)}
        used = [one.formula.names for one in data.series if one.formula is not None]
        if any(one - known for one in used):
            specified = self._specified(number, values, index, value)
            problem = build_problem(specified, search=False)
            names = replace(names, parameters=problem.numbers, inputs=problem.inputs)
        return scene, names

    def curves(self, inner: Array, count: int) -> list[Array]:
        """For every series times and fitted values, for a figure, shape ``(2, count)``."""
        values, found = self.values(inner), []
        for number, data in enumerate(self.data):
            first = min(float(one.times[0]) for one in data.series) if data.forces else 0.0
            times = np.linspace(first, data.last_time, count)
            finer = replace(data, series=tuple(replace(one, times=times) for one in data.series))
            predicted = self._predicted(number, finer, values, ())
            found += [np.array([times, curve]) for curve, _ in predicted]
        return found


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))
