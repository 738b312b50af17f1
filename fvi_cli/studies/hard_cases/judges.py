"""How claims are measured: against exact solutions, by energies, and by comparing runs.

A judge takes the settings of a claim, then one result for each: a trajectory, or for
:data:`JUDGES_OF_PREDICTIONS` a stability prediction. Keywords are those of the claim.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fvi_cli.effects.forcing import ForcingPiece
from fvi_cli.integrator.stability.prediction import StabilityPrediction
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.memory_work import fractional_integral, work_along
from fvi_cli.mathematics.transforms.characteristic import characteristic_zeros
from fvi_cli.scenes.linear_response import match_scene
from fvi_cli.scenes.registry import build_scene
from fvi_cli.scenes.relaxation import LinearResponse, product
from fvi_cli.studies.hard_cases.case import CaseSetting

Settings = Sequence[CaseSetting]


def exact_solution(setting: CaseSetting) -> Callable[[Array], Array]:
    """The exact positions at times of shape ``(n,)``, by the truth of the setting.

    A number, a formula in t, the specification of a problem with the same solution, or
    ``{frequency: w}``; with ``null`` the Laplace transform of the scene itself.

    Raises
    ------
    ValueError
        If no exact solution of the scene is known.
    """
    truth = json.loads(setting.truth)
    if isinstance(truth, Mapping) and "frequency" in truth:
        (term,) = setting.scene.damping
        coefficient = float(term.matrix[0, 0])
        response = response_from_rest(term.order, coefficient, truth["frequency"])
        return lambda time: response(time)[:, None]
    if truth is None or isinstance(truth, Mapping):
        solution = match_scene(build_scene(truth) if truth else setting.scene)
        if solution is None:
            raise ValueError("hard case: no exact solution of this scene is known")
        return solution.position
    return ForcingPiece(components=(Expression.parse(truth, variables=("t",)),)).evaluate


@functools.lru_cache(maxsize=16)
def response_from_rest(order: float, coefficient: float, frequency: float) -> LinearResponse:
    r"""Solution of :math:`x'' + \mu D^\gamma x + x = \cos \omega t` from rest.

    Its transform :math:`s / ((s^2 + \omega^2) (s^2 + \mu s^\gamma + 1))` is a quotient of sums of
    powers.
    """
    below = product({2.0: 1.0, order: coefficient, 0.0: 1.0}, {2.0: 1.0, 0.0: frequency**2})
    whole = tuple(sorted(below.items(), reverse=True))
    zeros = characteristic_zeros(whole)
    return LinearResponse(terms=whole, inputs=((0.0, {1.0: 1.0}),), zeros=zeros)


@functools.lru_cache(maxsize=512)
def exact_positions(setting: CaseSetting, parts: int = 0) -> Array:
    """The exact solution on the grid, or at the ends of `parts` equal parts of it."""
    step_size = setting.scene.final_time / setting.n_steps
    return exact_solution(setting)(step_size * _shown(setting, parts).astype(float))


def _shown(setting: CaseSetting, parts: int) -> Array:
    last = setting.n_steps
    return np.asarray(last * np.arange((parts or last) + 1) // (parts or last))


def largest_ratio(difference: Array, scale: Array) -> float:
    """The largest absolute value of `difference` over that of `scale`."""
    return float(np.abs(difference).max() / np.abs(scale).max())


def error(settings: Settings, *runs: Trajectory, parts: int = 0) -> float:
    """Largest error on the grid over the largest exact position."""
    found = []
    for setting, run in zip(settings, runs, strict=True):
        exact = exact_positions(setting, parts)
        found.append(largest_ratio(run.position[_shown(setting, parts)] - exact, exact))
    return max(found)


def error_over_step(settings: Settings, *runs: Trajectory) -> float:
    """Largest error over the distance that a velocity of 1 covers in a step."""
    return max(
        float(np.abs(run.position - exact_positions(setting)).max() / run.step_size)
        for setting, run in zip(settings, runs, strict=True)
    )


def error_at(settings: Settings, run: Trajectory, *, time: float) -> float:
    """Relative error at one time."""
    exact = exact_solution(settings[0])(np.array([float(time)]))[0, 0]
    return abs(float(run.position[round(time / run.step_size), 0]) / float(exact) - 1.0)


def difference(settings: Settings, *runs: Trajectory, units: Sequence[float] = ()) -> float:
    """Largest relative difference from the first run, each run in its own unit of length."""
    scales = units or [1.0] * len(runs)
    first, *others = [run.position / unit for run, unit in zip(runs, scales, strict=True)]
    return max(largest_ratio(other - first, first) for other in others)


def error_of_difference(settings: Settings, first: Trajectory, second: Trajectory) -> float:
    """Relative error of the difference of the second run and the first."""
    exact = exact_positions(settings[0])
    return largest_ratio(second.position - first.position - exact, exact)


def distance(settings: Settings, first: Trajectory, second: Trajectory) -> float:
    """Largest difference of the positions of two runs."""
    return float(np.abs(first.position - second.position).max())


def energy_gain(settings: Settings, *runs: Trajectory) -> float:
    """The largest energy over the energy at the start, less 1."""
    energies = [_energy(run) for run in runs]
    return max(float(energy.max() / energy[0] - 1.0) for energy in energies)


def energy_change(settings: Settings, run: Trajectory) -> float:
    """The largest change of the energy over the energy at the start."""
    energy = _energy(run)
    return largest_ratio(energy - energy[0], energy[:1])


def _energy(run: Trajectory) -> Array:
    if run.energy is None:
        raise ValueError("hard case: a trajectory without energy cannot be judged by it")
    return run.energy


def energy_defect(settings: Settings, run: Trajectory, *, hanging: float) -> float:
    r"""Largest :math:`|E(t) + W(t) - E(0)|` over :math:`E(0)` above the energy `hanging` at rest.

    The scene has a general Lagrangian and damping of orders below 1.
    """
    scene, momentum, energy = settings[0].scene, run.momentum, _energy(run)
    if scene.lagrangian is None or momentum is None:
        raise ValueError("hard case: an energy balance needs a Lagrangian and momenta")
    velocity = scene.lagrangian.velocity(run.position, momentum, run.time)
    force = np.zeros_like(velocity)
    for term in scene.active_damping:
        memory = fractional_integral(1.0 - term.order, run.step_size, velocity)
        force += memory @ term.matrix
    work = work_along(force, velocity, run.step_size)
    return float(np.abs(energy + work - energy[0]).max() / (energy[0] - hanging))


def called_unstable(settings: Settings, *predictions: StabilityPrediction) -> float:
    """How many runs are predicted to be unstable."""
    return float(sum(prediction.verdict == "unstable" for prediction in predictions))


def error_of_predicted_growth(settings: Settings, *predictions: StabilityPrediction) -> float:
    """Relative error of the predicted growth."""
    return max(abs(one.growth_per_step / one.exact_growth - 1.0) for one in predictions)


JUDGES_OF_PREDICTIONS = (called_unstable, error_of_predicted_growth)
JUDGES: Mapping[str, Callable[..., float]] = {
    judge.__name__: judge
    for judge in (
        error,
        error_over_step,
        error_at,
        difference,
        error_of_difference,
        distance,
        energy_gain,
        energy_change,
        energy_defect,
        *JUDGES_OF_PREDICTIONS,
    )
}


def judge_of(name: str, settings: Settings, options: Mapping[str, Any]) -> Callable[..., float]:
    """A judge by its name, for the settings and options of a claim."""
    return functools.partial(JUDGES[name], tuple(settings), **options)
