"""A description of motions as a function of its free parameters, with exact derivatives."""

from __future__ import annotations

import math
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
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.kinds.material import Material
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.scenes.registry import read_problem
from fvi_cli.studies.fits.predictions import METHOD, Predicted, predict_motion, predict_response
from fvi_cli.studies.fits.settings import DataSet, FitModel
from fvi_cli.studies.members import with_values

MOST_STEPS, MORE_STEPS = 20_000, 100
"""Most steps of a run; during the search: two for every measurement, and so many more."""
COARSE_SHARE = 1e-4
"""Tolerance relative to the range of a displacement with kinks: for every decade below this one
there is a halving behind each."""
COARSE = 64
"""Number of steps of the runs that find the size of a motion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """The model at one point."""

    residuals: Array  # (model - data) / deviation of every value, (n,)
    jacobian: Array  # derivatives by inner parameters, (n, p)

    @property
    def cost(self) -> float:
        """Sum of the squares."""
        return float(self.residuals @ self.residuals)


class MotionModel:
    """The motions of all data sets as functions of the free parameters.

    `deviations` are those of all series, a number or one for each value, ``(n,)``.
    """

    def __init__(
        self, model: FitModel, data: Sequence[DataSet], deviations: Sequence[Array | float]
    ) -> None:
        self.model, self.data, self.deviations = model, tuple(data), list(deviations)
        self.series = [one for each in data for one in each.series]
        self.free = model.parameters
        self.sizes = [one.values.size for one in self.series]
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
        is_positive = np.array([one.is_positive for one in self.free])
        return np.where(is_positive, self.values(inner), 1.0)

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

    def _steps_through_kinks(self, scene: Scene, tolerance: float) -> Mesh | None:
        """Few steps through a displacement with kinks, where forces are measured; or None."""
        if scene.prescribed is None or not scene.prescribed.kinks:
            return None
        motion = replace(scene.prescribed, final_time=scene.final_time)
        at_kinks = motion.displacement(np.array([0.0, *motion.break_points, motion.final_time]))
        share = tolerance / float(np.ptp(at_kinks))
        return halved_mesh(motion, max(0, round(math.log10(COARSE_SHARE / share))))

    def _run(self, number: int, scene: Scene) -> RunSteps:
        """The run of a data set on the steps that were chosen last."""
        mesh = self.meshes[number]
        if number not in self._motions:
            return run_steps(scene, METHOD, mesh)
        if number not in self._runs or self._runs[number][0] is not mesh:
            self._runs[number] = mesh, run_steps(scene, METHOD, mesh)
        return self._runs[number][1]

    def remesh(self, inner: Array, tolerance: float) -> None:
        """Choose the steps anew, for motions near this point.

        Raises
        ------
        RunFailedError
            If a run does not come to its end.
        """
        steps = AdaptiveSteps(tolerance=tolerance, most_steps=MOST_STEPS)
        self.meshes = [1] * len(self.data)
        for number, data in enumerate(self.data):
            if not data.forces:
                scene, _ = self.described(number, self.values(inner))
                self.meshes[number] = self._steps_through_kinks(scene, tolerance) or run_steps(
                    scene, METHOD, steps
                ).mesh(scene.break_points)

    def loosen(self, tolerance: float) -> None:
        """Choose the steps of every run on its own from now on.

        A motion that needs far more steps than there are measurements is not the one measured.
        """
        most = [MORE_STEPS + 2 * max(one.times.size for one in data.series) for data in self.data]
        self.meshes = [AdaptiveSteps(tolerance=tolerance, most_steps=one) for one in most]

    def size_at_start(self) -> float:
        """Largest position in coarse runs at the starting point of the search; 1 without any.

        Raises
        ------
        RunFailedError
            If they do not come to their end.
        """
        size = 0.0
        for number, data in enumerate(self.data):
            if not data.forces:
                scene, _ = self.described(number, self.values(self.start))
                done = run_steps(scene, METHOD, COARSE)
                size = max(size, float(np.abs(done.position).max()))
        return size or 1.0

    def evaluate(self, inner: Array, *, with_jacobian: bool = True) -> Evaluation:
        """Residuals and their derivatives, computed on the steps that were chosen last.

        Raises
        ------
        RunFailedError
            If there is no scene for these values, or a run does not come to its end.
        """
        values = self.values(inner)
        own = range(len(self.free)) if with_jacobian else ()
        residuals, rows = list[Array](), list[Array]()
        for number, data in enumerate(self.data):
            # steps of the search may lead to motions that grow beyond all bounds
            with np.errstate(all="ignore"):
                predicted = self._predicted(number, data, values, own)
            for one, (found, rates) in zip(data.series, predicted, strict=True):
                left, deviation = found - one.values, self.deviations[len(rows)]
                if one.amplitude is not None and one.amplitude.part == "phase":
                    left = (left + 180.0) % 360.0 - 180.0
                residuals.append(left / deviation)
                rows.append(rates / np.reshape(deviation, (-1, 1)))
        together, jacobian = np.concatenate(residuals), np.concatenate(rows)
        if with_jacobian:
            jacobian = jacobian * self.slopes(inner)
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

    def curves(self, inner: Array, count: int) -> list[Array]:
        """For every series times and fitted values, for a figure, shape ``(2, count)``."""
        found = []
        for number, data in enumerate(self.data):
            first = min(float(one.times[0]) for one in data.series) if data.forces else 0.0
            times = np.linspace(first, data.last_time, count)
            finer = replace(data, series=tuple(replace(one, times=times) for one in data.series))
            predicted = self._predicted(number, finer, self.values(inner), ())
            found += [np.array([times, curve]) for curve, _ in predicted]
        return found
