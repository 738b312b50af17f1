"""A description of motions as a function of its free parameters, with exact derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from fvi_cli.effects.prescribed import PrescribedMotion
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.gradient import RunFailedError, run_steps
from fvi_cli.integrator.gradients.parameters import Described, parameter_of
from fvi_cli.integrator.material import halved_mesh
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.kinds.material import Material
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.scenes.registry import read_problem
from fvi_cli.studies.fits.predictions import METHOD, Predicted, predict_motion, predict_response
from fvi_cli.studies.fits.settings import DataSet, FitModel, FitSettings
from fvi_cli.studies.members import with_values
from fvi_cli.studies.tolerance.runs import likely_amplitude

TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
"""Tolerances of a step at every level of accuracy, relative to the likely size of the motion."""
SEARCH_TOLERANCE = 1e-4
"""The same in a search, where every run has steps of its own."""
MOST_STEPS, MORE_STEPS = 20_000, 100
"""Most steps of a run; in a search: two for every measurement, and so many more."""
HALVINGS = 3
"""How much more often, at every level, steps are halved behind kinks of a displacement."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """The model at one point."""

    residuals: Array  # (model - data) / deviation of every value, (n,)
    jacobian: Array  # derivatives by the parameters, (n, p)

    @property
    def cost(self) -> float:
        """Sum of the squares."""
        return float(self.residuals @ self.residuals)


class MotionModel:
    """The motions of all data sets as functions of the free parameters.

    `deviations` are those of all series, a number or one for each value, ``(n,)``.
    """

    def __init__(self, model: FitModel, settings: FitSettings) -> None:
        self.model, self.settings, self.data = model, settings, settings.data
        self.series = [one for each in self.data for one in each.series]
        self.deviations = [settings.deviations(one) for one in self.series]
        self.free = model.parameters
        self.sizes = [one.values.size for one in self.series]
        # steps of all runs; none: those of each are chosen on its own
        self.meshes: list[AnySteps] = []
        # displacements that are given, and the steps through them, which no parameter changes
        self._motions: dict[int, PrescribedMotion] = {}
        self._runs: dict[int, tuple[AnySteps, RunSteps]] = {}

    def split(self, residuals: Array) -> list[Array]:
        """Residuals of every series in the unit of the data."""
        parts = np.split(residuals, np.cumsum(self.sizes)[:-1])
        return [part * deviation for part, deviation in zip(parts, self.deviations, strict=True)]

    @property
    def start(self) -> Array:
        """Starting point of the search."""
        return np.array([one.start for one in self.free])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper limits of the parameters, ``(p,)`` each."""
        low, high = zip(*(one.limits for one in self.free), strict=True)
        return np.array(low), np.array(high)

    def assignments(self, number: int, values: Array) -> dict[str, float]:
        """Key paths with their values, for one data set."""
        named = {one.key: float(value) for one, value in zip(self.free, values, strict=True)}
        return {**self.data[number].changes, **named}

    def described(
        self, number: int, values: Array, index: int = -1, value: float = 0.0
    ) -> Described:
        """The scene of one data set up to its last measurement, and the names in its columns.

        `value` is another value of one parameter.

        Raises
        ------
        ValueError
            If there is none for these values.
        """
        values, data = values.copy(), self.data[number]
        values[index] = value if index >= 0 else values[index]
        specified = with_values(self.model.specification, self.assignments(number, values))
        kind = read_problem(specified)
        if isinstance(kind, Material) and not self._moves_displacement:
            if number not in self._motions:
                self._motions[number] = kind.build_motion()
            problem: AnyProblem = kind.build_problem(self._motions[number])
        else:
            problem = kind.build_problem()
        assert isinstance(problem, Problem)
        scene = problem.scene
        whole = scene if data.forces else replace(scene, final_time=data.last_time)
        return whole, problem.names

    @property
    def _moves_displacement(self) -> bool:
        """Whether a parameter may change a displacement that is given."""
        keys = ("problem.displacement", "problem.parameters")
        return any(one.key.startswith(keys) for one in self.free)

    def _run(self, number: int, scene: Scene) -> RunSteps:
        """The run of a data set on the steps that were chosen last."""
        mesh = self.meshes[number] if self.meshes else self._adaptive(number, scene)
        if number not in self._motions:
            return run_steps(scene, METHOD, mesh)
        if number not in self._runs or self._runs[number][0] != mesh:
            self._runs[number] = mesh, run_steps(scene, METHOD, mesh)
        return self._runs[number][1]

    def remesh(self, point: Array, level: int) -> None:
        """Choose steps for motions near this point, by a level of accuracy.

        Raises
        ------
        RunFailedError
            If a run does not come to its end.
        """
        self.meshes = [self._mesh(number, point, level) for number in range(len(self.data))]

    def _mesh(self, number: int, point: Array, level: int) -> AnySteps:
        if self.data[number].forces:
            return 1
        scene, _ = self.described(number, point)
        motion = scene.prescribed
        if motion and motion.kinks and level:
            return halved_mesh(replace(motion, final_time=scene.final_time), HALVINGS * level)
        tolerance = TOLERANCES[level] * _size(scene)
        steps = AdaptiveSteps(tolerance=tolerance, most_steps=MOST_STEPS)
        return run_steps(scene, METHOD, steps).mesh(scene.break_points)

    def _adaptive(self, number: int, scene: Scene) -> AdaptiveSteps:
        """Steps of a search.

        A motion that needs far more than there are measurements is not the one measured.
        """
        most = MORE_STEPS + 2 * max(one.times.size for one in self.data[number].series)
        return AdaptiveSteps(tolerance=SEARCH_TOLERANCE * _size(scene), most_steps=most)

    def evaluate(self, point: Array, *, with_jacobian: bool = True) -> Evaluation:
        """Residuals and their derivatives, computed on the steps that were chosen last.

        Raises
        ------
        RunFailedError
            If there is no scene for these values, or a run does not come to its end.
        """
        own = range(len(self.free)) if with_jacobian else ()
        residuals, rows = list[Array](), list[Array]()
        for number, data in enumerate(self.data):
            # steps of the search may lead to motions that grow beyond all bounds
            with np.errstate(all="ignore"):
                predicted = self._predicted(number, data, point, own)
            for one, (found, rates) in zip(data.series, predicted, strict=True):
                left, deviation = found - one.values, self.deviations[len(rows)]
                if one.amplitude is not None and one.amplitude.part == "phase":
                    left = (left + 180.0) % 360.0 - 180.0
                residuals.append(left / deviation)
                rows.append(rates / np.reshape(deviation, (-1, 1)))
        together, jacobian = np.concatenate(residuals), np.concatenate(rows)
        if not (np.isfinite(together).all() and np.isfinite(jacobian).all()):
            raise RunFailedError("the motion is not finite")
        return Evaluation(residuals=together, jacobian=jacobian)

    def _predicted(
        self, number: int, data: DataSet, values: Array, own: Sequence[int]
    ) -> Predicted:
        """Values of the model for a data set, with derivatives by some of the parameters."""
        try:
            described = self.described(number, values)
            parameters = [
                parameter_of(
                    self.free[index].key,
                    partial(self.described, number, values, index),
                    float(values[index]),
                    described,
                )
                for index in own
            ]
        except ValueError as error:
            raise RunFailedError(f"there is no scene with these values: {error}") from None
        if data.forces:
            direction: Any = self.model.specification.get("ground_direction", 1.0)
            return predict_response(described[0], data, parameters, direction)
        return predict_motion(described, self._run(number, described[0]), data, parameters)

    def curves(self, point: Array, count: int) -> list[Array]:
        """For every series times and fitted values, for a figure, shape ``(2, count)``."""
        found = []
        for number, data in enumerate(self.data):
            first = min(float(one.times[0]) for one in data.series) if data.forces else 0.0
            times = np.linspace(first, data.last_time, count)
            finer = replace(data, series=tuple(replace(one, times=times) for one in data.series))
            predicted = self._predicted(number, finer, point, ())
            found += [np.array([times, curve]) for curve, _ in predicted]
        return found


def _size(scene: Scene) -> float:
    """The likely size of a motion, a length."""
    if scene.prescribed is None:
        return likely_amplitude(scene) or 1.0
    times = np.linspace(0.0, scene.final_time, 65)
    return float(np.ptp(scene.prescribed.displacement(times))) or 1.0
