"""Values of measured columns as a scene predicts them, with derivatives by parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.gradient import run_steps, sensitivities
from fvi_cli.integrator.gradients.linearised import LinearisedRun
from fvi_cli.integrator.gradients.parameters import Described, Parameter, symbol_rates
from fvi_cli.integrator.gradients.quantity import Formula, MotionAt
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.scenes.structures.structure import ground_shares
from fvi_cli.studies.fits.settings import Amplitude, DataSet
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness
from fvi_cli.studies.vibration.response import ground_amplitude, harmonic_force

Predicted = list[tuple[Array, Array]]
"""For every series a pair: values, ``(n,)``, and derivatives by p parameters, ``(n, p)``."""
METHOD = Method(cq="gauss", degree=8, start="none")
"""The method by which motions are computed."""


def predict_motion(
    described: Described, steps: AnySteps, data: DataSet, parameters: Sequence[Parameter]
) -> Predicted:
    """Predict the measured columns of a motion.

    Raises
    ------
    RunFailedError
        If the run does not come to its end.
    """
    scene, names = described
    if scene.prescribed is not None:
        return _predict_prescribed(described, steps, data, parameters)
    times = np.unique(np.concatenate([one.times for one in data.series]))
    formulas = [one for one in data.series if one.formula is not None]
    if not parameters and not formulas:
        done = run_steps(scene, METHOD, steps)
        motion = MotionAt(done, done.located(times)).motion()
        empty = np.zeros((times.size, scene.dimension, 0))
        changes = (empty, empty)
    else:
        found = sensitivities(scene, METHOD, steps, times, parameters)
        motion = (found.position, found.velocity)
        changes = (found.by_position, found.by_velocity)
    predicted = []
    for one in data.series:
        places, kind = np.searchsorted(times, one.times), int(one.is_velocity)
        if one.formula is None:
            values, slopes = (each[kind][places, one.component] for each in (motion, changes))
        else:
            formula = Formula(found.run, one.times, one.formula, names)
            values, slopes = formula.values, found.of(formula)
        predicted.append((values, slopes))
    return predicted


def _predict_prescribed(
    described: Described, steps: AnySteps, data: DataSet, parameters: Sequence[Parameter]
) -> Predicted:
    """Predict forces of dampers whose displacement is given, the same for all parameters."""
    scene, names = described
    run = LinearisedRun(scene, METHOD, run_steps(scene, METHOD, steps))
    predicted = []
    for one in data.series:
        if one.formula is None:
            predicted.append((one.values, np.zeros((one.values.size, len(parameters)))))
            continue
        formula = Formula(run, one.times, one.formula, names)
        slopes = np.array([formula.rates(each) for each in parameters])
        predicted.append((formula.values, slopes.reshape(-1, one.times.size).T))
    return predicted


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
        response, slopes = _damper_stiffness(scene, s, parameters)
    predicted = []
    for series in data.series:
        amplitude = series.amplitude
        assert amplitude is not None
        places = np.searchsorted(hertz, series.times)
        rate = s[places] ** amplitude.rate
        values = rate * (response[places] @ amplitude.row)
        changes = rate[:, None] * np.einsum("d,ndp->np", amplitude.row, slopes[places])
        predicted.append(_part(amplitude, values, changes))
    return predicted


def _displacements(
    scene: Scene,
    s: ComplexArray,
    data: DataSet,
    parameters: Sequence[Parameter],
    ground_direction: Any,
) -> tuple[ComplexArray, ComplexArray]:
    """Amplitudes ``(n, d)``, and their derivatives by p parameters, ``(n, d, p)``."""

    def force(of: Scene) -> Array:
        every = [
            harmonic_force(text, of, data.coordinates, ground_direction) for text in data.forces
        ]
        return np.asarray(sum(every))

    solve = _solver(DynamicStiffness(scene), s)
    load = np.broadcast_to(force(scene)[:, None], (s.size, scene.dimension, 1))
    response = solve(load.astype(complex))[..., 0]
    left = np.zeros((*response.shape, len(parameters)), dtype=complex)
    along = ground_shares(ground_direction, scene.dimension)
    for column, one in enumerate(parameters):
        for symbol, matrix in symbol_rates(scene, one, s):
            left[..., column] -= symbol[:, None] * (response @ matrix)
        if "mass" in one.rates:
            left[..., column] -= ground_amplitude(data.forces) * along @ one.rates["mass"]
    return response, solve(left) if parameters else left


def _damper_stiffness(
    scene: Scene, s: ComplexArray, parameters: Sequence[Parameter]
) -> tuple[ComplexArray, ComplexArray]:
    """Complex stiffness g(s) of dampers whose displacement is given; shapes of `_displacements`."""
    total, changes = np.zeros(s.shape, complex), np.zeros((s.size, 1, len(parameters)), complex)
    every: list[FractionalDamping | Law] = [*scene.damping, *scene.laws]
    for part in every:
        symbols = np.array([part.symbol(at) for at in s.tolist()])
        total += part.matrix[0, 0] * (getattr(part, "spring", 0.0) + symbols)
    for column, one in enumerate(parameters):
        for symbol, matrix in symbol_rates(scene, one, s):
            changes[:, 0, column] += symbol * np.asarray(matrix)[0, 0]
    return total[:, None], changes


def _solver(stiffness: DynamicStiffness, s: ComplexArray) -> Callable[[ComplexArray], ComplexArray]:
    """Solutions of T(s) x = b for every s, shapes ``(n, d, k)``."""
    try:
        if not stiffness.is_sparse:
            forms = np.stack(list(map(dense, stiffness.forms)))
            inverse = np.linalg.inv(np.tensordot(stiffness.symbols_over(s), forms, axes=1))
            return lambda right: np.asarray(inverse @ right)
        factors = [stiffness.factors(one) for one in s.tolist()]
    except np.linalg.LinAlgError:
        raise ValueError("a mode without damping lies at a measured frequency") from None
    return lambda right: np.array([o.solve(b) for o, b in zip(factors, right, strict=True)])


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
