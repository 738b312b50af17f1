"""Values of measured columns as a scene predicts them, with derivatives by parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.along import Along
from fvi_cli.integrator.gradients.gradient import jacobians
from fvi_cli.integrator.gradients.linearised import LinearisedRun
from fvi_cli.integrator.gradients.parameters import Described, Parameter, by_rule
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.studies.fits.settings import Amplitude, DataSet
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness
from fvi_cli.studies.vibration.response import harmonic_load

Predicted = list[tuple[Array, Array]]
"""For every series a pair: values, ``(n,)``, and derivatives by p parameters, ``(n, p)``."""
METHOD = Method(cq="gauss", degree=8, start="none")
"""The method by which motions are computed."""
MATRICES = ("mass", "stiffness", "damping.", "laws.")


def predict_motion(
    described: Described, steps: RunSteps, data: DataSet, parameters: Sequence[Parameter]
) -> Predicted:
    """Predict the measured columns of a motion from the steps of its run."""
    scene, names = described
    run = LinearisedRun(scene, METHOD, steps)
    every = []
    for one in data.series:
        formula = one.formula or Expression.parse(one.name, variables=(one.name,))
        every.append(Along(run, one.times, formula, names, parameters))
    slopes = jacobians(run, every, parameters)
    return [(one.values, own) for one, own in zip(every, slopes, strict=True)]


def predict_response(
    scene: Scene, data: DataSet, parameters: Sequence[Parameter], ground_direction: Any = 1.0
) -> Predicted:
    """Predict the measured columns of a response to harmonic forces, ``T(i omega) q = f``.

    Raises
    ------
    ValueError
        If the scene is not linear, or nothing limits the response at a frequency.
    """
    hertz = np.unique(np.concatenate([one.times for one in data.series]))
    s = 2j * math.pi * hertz

    def load(of: Scene) -> ComplexArray:
        found, _ = harmonic_load(data.forces, of, data.coordinates, ground_direction)
        return found.astype(complex)

    def forces(scenes: list[Scene]) -> ComplexArray:
        """T q of scenes at the amplitudes, less the load."""
        found = []
        for one in scenes:
            parts = DynamicStiffness(one)
            every: Any = zip(parts.symbols(s).T, parts.forms, strict=True)  # dense or sparse
            total = sum(symbol[:, None] * (form @ amplitudes.T).T for symbol, form in every)
            found.append(total if is_given else total - load(one))
        return np.array(found)

    if is_given := scene.prescribed is not None:
        # the force of a unit displacement, without that of the mass
        amplitudes = np.ones((s.size, 1), complex)
        response = forces([scene])[0] - s[:, None] ** 2 * dense(scene.inertia.form)
        slopes = np.zeros((len(parameters), *response.shape), complex)
        slopes += by_rule(scene, parameters, MATRICES, forces)
    else:
        stiffness = DynamicStiffness(scene)
        try:
            solvers = [stiffness.solver(one) for one in s.tolist()]
            response = amplitudes = np.array([solve(load(scene)) for solve in solvers])
        except np.linalg.LinAlgError:
            raise ValueError("a mode without damping lies at a measured frequency") from None
        pushed = np.zeros((len(parameters), *response.shape), complex)
        pushed -= by_rule(scene, parameters, MATRICES, forces)
        every = zip(solvers, pushed.transpose(1, 2, 0), strict=True)
        slopes = np.array([solve(one) for solve, one in every]).transpose(2, 0, 1)
    predicted = []
    for series in data.series:
        amplitude = series.amplitude
        assert amplitude is not None
        places = np.searchsorted(hertz, series.times)
        factor = s[places] ** amplitude.rate
        values = factor * (response[places] @ amplitude.row)
        changes = factor[:, None] * (slopes[:, places] @ amplitude.row).T
        predicted.append(_part(amplitude, values, changes))
    return predicted


def _part(amplitude: Amplitude, values: ComplexArray, changes: ComplexArray) -> tuple[Array, Array]:
    """Magnitude, phase, real or imaginary part of complex numbers, and its changes."""
    if amplitude.part == "real":
        return values.real, changes.real
    if amplitude.part == "imaginary":
        return values.imag, changes.imag
    turned = values.conj()[:, None] * changes
    size = np.abs(values)
    if amplitude.part == "magnitude":
        return size, turned.real / size[:, None]
    return np.degrees(np.angle(values)), np.degrees(turned.imag / size[:, None] ** 2)
