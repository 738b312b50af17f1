"""Values of measured columns as a scene predicts them, with derivatives by parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.formula import Formula, MotionAt, NameResolver
from fvi_cli.integrator.gradients.gradient import run_steps, sensitivities
from fvi_cli.integrator.gradients.variation import Variation, differentiate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.dampers import damper_values, dampers_of, forces_along
from fvi_cli.integrator.observations.motion import DenseMotion
from fvi_cli.integrator.observations.observer import Observer
from fvi_cli.integrator.observations.request import Observations, known_names
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.scenes.registry import build_problem
from fvi_cli.studies.fits.settings import Amplitude, DataSet, Series
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness
from fvi_cli.studies.vibration.response import harmonic_force

Predicted = list[tuple[Array, Array]]
"""For every series a pair: values, ``(n,)``, and derivatives by p parameters, ``(n, p)``."""
Specified = Callable[[int, float], Mapping[str, Any]]
"""From the index of a parameter and its value to the ``problem`` mapping."""

METHOD = Method(cq="gauss", degree=8, start="none")
"""The method by which motions are computed."""


def predict_motion(
    scene: Scene,
    steps: AnySteps,
    data: DataSet,
    variations: Sequence[Variation],
    specified: Specified,
) -> Predicted:
    """Predict the measured columns of a motion.

    Raises
    ------
    RunFailedError
        If the run does not come to its end.
    """
    if scene.prescribed is not None:
        return _predict_prescribed(scene, steps, data, variations, specified)
    times = np.unique(np.concatenate([one.times for one in data.series]))
    formulas = [one for one in data.series if one.formula is not None]
    if not variations and not formulas:
        done = run_steps(scene, METHOD, steps)
        motion = MotionAt(done, done.located(times)).motion()
        empty = np.zeros((times.size, scene.dimension, 0))
        changes = (empty, empty)
    else:
        found = sensitivities(scene, METHOD, steps, times, variations)
        motion = (found.position, found.velocity)
        changes = (found.by_position, found.by_velocity)
    predicted = []
    for one in data.series:
        places, kind = np.searchsorted(times, one.times), int(one.is_velocity)
        if one.formula is None:
            values, slopes = (each[kind][places, one.component] for each in (motion, changes))
        else:
            names = _resolve_names(one, data, specified, damper_values(scene))
            formula = Formula(found.run, one.times, one.formula, names)
            values, slopes = formula.values, found.of(formula)
        predicted.append((values, slopes))
    return predicted


def _predict_prescribed(
    scene: Scene,
    steps: AnySteps,
    data: DataSet,
    variations: Sequence[Variation],
    specified: Specified,
) -> Predicted:
    """Predict forces of dampers whose displacement is given, the same for all parameters."""
    assert scene.prescribed is not None
    run = run_steps(scene, METHOD, steps)

    def values(of: Scene, number: float = 0.0, *, index: int = -1) -> list[Array]:
        motion = DenseMotion(
            scenes=(of,),
            steps=(run,),
            find_forces=partial(forces_along, [of], METHOD, [run]),
        )
        found = []
        for one in data.series:
            if one.formula is None:
                found.append(one.values)
                continue
            names = _resolve_names(one, data, specified, damper_values(of))(index, number)
            along = Observer(motion, [names]).along(one.formula)
            found.append(along(*motion.located(0, one.times)))
        return found

    slopes = [
        differentiate(one, scene, partial(values, index=index))
        for index, one in enumerate(variations)
    ]
    return [
        (own, np.array([one[k] for one in slopes]).reshape(len(slopes), own.size).T)
        for k, own in enumerate(values(scene))
    ]


def _resolve_names(
    one: Series, data: DataSet, specified: Specified, dampers: Mapping[str, object]
) -> NameResolver:
    """The names in the formula of a series, with the parameters of the problem."""

    def resolve_names(index: int, number: float) -> Observations:
        names = one.formula.names if one.formula is not None else frozenset()
        numbers: Mapping[str, float] = {}
        inputs: Mapping[str, Forcing | None] = {}
        if names - set(known_names(data.coordinates)) - set(dampers):
            problem = build_problem(specified(index, number), search=False)
            numbers, inputs = problem.numbers, problem.inputs
        return Observations(coordinates=data.coordinates, parameters=numbers, inputs=inputs)

    return resolve_names


def predict_response(
    scene: Scene, data: DataSet, variations: Sequence[Variation], ground_direction: Any = 1.0
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
        response, slopes = _displacements(scene, s, data, variations, ground_direction)
    else:
        response, slopes = _damper_stiffness(scene, s, variations)
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
    variations: Sequence[Variation],
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
    left = np.zeros((*response.shape, len(variations)), dtype=complex)

    def unbalanced(varied: Scene, _: float) -> list[ComplexArray]:
        # as two terms: the change of their difference would be lost in round-off
        applied = _applied(DynamicStiffness(varied), s, response)
        return [np.broadcast_to(force(varied), applied.shape), -applied]

    for column, one in enumerate(variations):
        left[..., column] = sum(differentiate(one, scene, unbalanced))
    return response, solve(left) if variations else left


def _damper_stiffness(
    scene: Scene, s: ComplexArray, variations: Sequence[Variation]
) -> tuple[ComplexArray, ComplexArray]:
    """Complex stiffness g(s) of dampers whose displacement is given; shapes of `_displacements`."""

    def stiffness(of: Scene, _: float = 0.0) -> list[ComplexArray]:
        total = np.zeros(s.shape, dtype=complex)
        for part in (part for parts in dampers_of(of) for part in parts):
            factor, spring = float(part.matrix[0, 0]), getattr(part, "spring", 0.0)
            total += factor * (spring + np.array([part.symbol(at) for at in s.tolist()]))
        return [total]

    slopes = [differentiate(one, scene, stiffness)[0] for one in variations]
    changes = np.array(slopes, dtype=complex).reshape(len(slopes), s.size)
    return stiffness(scene)[0][:, None], changes.T[:, None]


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


def _applied(stiffness: DynamicStiffness, s: ComplexArray, response: ComplexArray) -> ComplexArray:
    """T(s) q for every s, shape ``(n, d)``."""
    total = np.zeros_like(response)
    for symbol, form in zip(stiffness.symbols_over(s).T, stiffness.forms, strict=True):
        total += symbol[:, None] * np.asarray(form @ response.T).T  # type: ignore[operator]
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
