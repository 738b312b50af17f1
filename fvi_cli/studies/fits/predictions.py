"""Values of measured columns as a scene predicts them, with derivatives by parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.laws import Law
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
from fvi_cli.studies.vibration.response import harmonic_force

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
    if scene.prescribed is None:
        response, slopes = _displacements(scene, s, data, parameters, ground_direction)
    else:

        def stiffnesses(scenes: list[Scene]) -> ComplexArray:
            return np.array([_damper_stiffness(one, s) for one in scenes])

        response = stiffnesses([scene])[0][:, None]
        slopes = np.zeros((len(parameters), *response.shape), dtype=complex)
        slopes[..., 0] += by_rule(scene, parameters, MATRICES, stiffnesses)
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


def _displacements(
    scene: Scene,
    s: ComplexArray,
    data: DataSet,
    parameters: Sequence[Parameter],
    ground_direction: Any,
) -> tuple[ComplexArray, ComplexArray]:
    """Amplitudes ``(n, d)``, and their derivatives by p parameters, ``(p, n, d)``."""

    def force(of: Scene) -> Array:
        names = data.coordinates
        every = [harmonic_force(text, of, names, ground_direction) for text in data.forces]
        return np.asarray(sum(every))

    solve = _solver(DynamicStiffness(scene), s)
    load = force(scene).astype(complex)
    response = solve(np.broadcast_to(load[:, None], (s.size, load.size, 1)))[..., 0]

    def residuals(scenes: list[Scene]) -> ComplexArray:
        """T q - f of scenes at these amplitudes."""
        found = []
        for one in scenes:
            parts = DynamicStiffness(one)
            symbols = parts.symbols(s)
            every: Any = zip(symbols.T, parts.forms, strict=True)  # dense or sparse
            total = sum(symbol[:, None] * (form @ response.T).T for symbol, form in every)
            found.append(total - force(one))
        return np.array(found)

    left = np.zeros((len(parameters), *response.shape), dtype=complex)
    left -= by_rule(scene, parameters, MATRICES, residuals)
    return response, solve(left.transpose(1, 2, 0)).transpose(2, 0, 1)


def _solver(stiffness: DynamicStiffness, s: ComplexArray) -> Callable[[ComplexArray], ComplexArray]:
    """Solutions of T(s) x = b for every s, ``(n, d, k)``."""
    try:
        if not stiffness.is_sparse:
            forms = np.stack(list(map(dense, stiffness.forms)))
            inverse = np.linalg.inv(np.tensordot(stiffness.symbols(s), forms, axes=1))
            return lambda right: np.asarray(inverse @ right)
        inverses = [stiffness.solver(one) for one in s.tolist()]
    except np.linalg.LinAlgError:
        raise ValueError("a mode without damping lies at a measured frequency") from None
    return lambda right: np.array([of(b) for of, b in zip(inverses, right, strict=True)])


def _damper_stiffness(scene: Scene, s: ComplexArray) -> ComplexArray:
    """Complex stiffness g(s) of dampers whose displacement is given, ``(n,)``."""
    total = np.zeros(s.shape, complex)
    every: list[FractionalDamping | Law] = [*scene.damping, *scene.laws]
    for one in every:
        symbols = np.array([one.symbol(at) for at in s.tolist()])
        total += one.matrix[0, 0] * (getattr(one, "spring", 0.0) + symbols)
    return total


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
