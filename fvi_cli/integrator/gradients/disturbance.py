"""What parameters change in the equations of a run while its motion is held fixed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from fvi_cli.effects.forcing import ForceComponent, Forcing
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances import loads_along
from fvi_cli.integrator.gradients.linearised import Disturbance, LinearisedRun
from fvi_cli.integrator.gradients.parameters import Parameter, by_rule, energy_of
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.mathematics.algebra.builder import derivatives
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression

MEMORY = ("damping.", "laws.", "initial_velocity")
"""Kinds of numbers on which the damping force at fixed motion depends."""


def disturbance(run: LinearisedRun, parameters: Sequence[Parameter]) -> Disturbance:
    """Effect of parameters on the equations of a run."""
    scene, steps = run.scene, run.steps
    points = (steps.stage_position, steps.velocity, steps.stage_time)
    start = (scene.initial_position, scene.initial_velocity, np.zeros(()))
    at = scene.derivatives(*(np.asarray(part)[None] for part in start))
    shape = len(parameters), steps.n_steps, run.tables.degree + 1, run.d
    loads, (position, impulse) = np.zeros(shape), np.zeros((2, len(parameters), run.d))
    for k, one in enumerate(parameters):
        mass, stiffness = (one.of(name, run.d, run.d) for name in ("mass", "stiffness"))
        momentum, force = _by_formulas(scene, one, *points)
        loads[k] = run.loads_by(momentum + points[1] @ mass, force - points[0] @ stiffness)
        if (forcing := rate_of_forcing(scene.forcing, one, "forcing")) is not None:
            loads[k] += _loads_of(run, replace(scene, forcing=forcing), "forcing")
        position[k] = one.of("initial_position")
        impulse[k] = at.mass[0] @ one.of("initial_velocity", run.d) + at.mixed[0] @ position[k]
        impulse[k] += start[1] @ mass + _by_formulas(scene, one, *start)[0]

    def of_memory(scenes: list[Scene]) -> Array:
        initial = [_loads_of(run, replace(one, forcing=None), "initial") for one in scenes]
        every = zip(run.forces_of(scenes, steps.velocity), initial, strict=True)
        return np.array([own - run.loads_by(0.0 * force, force) for force, own in every])

    loads += by_rule(scene, parameters, (*MEMORY, "initial_position"), of_memory)
    return Disturbance(loads, position, impulse)


def _loads_of(run: LinearisedRun, scene: Scene, part: str) -> Array:
    """Load vectors of all steps of a run by the forces of a scene, ``(n, s + 1, d)``."""
    steps = run.steps
    loads = StepLoads(scene, run.method, steps.tables)
    zero = np.zeros((steps.n_steps, steps.tables.degree + 1, scene.dimension))
    return loads_along(loads, steps, run.scene.break_points).get(part, zero)


def _by_formulas(
    scene: Scene, one: Parameter, x: Array, v: Array, time: Array
) -> tuple[Array, Array]:
    """Derivatives of momenta and forces by names in formulas of energies, ``(..., d)`` both."""
    kind, own = energy_of(scene)
    momentum, force = np.zeros_like(v), np.zeros_like(x)
    if not (rates := one.under(f"{kind}.")):
        return momentum, force
    if kind == "lagrangian":
        system, values = _rate_of(own.first, own.parameters, rates)
        found = own.evaluate(system, x, v, time, values)
        return found[..., : own.dimension], found[..., own.dimension :]
    system, values = _rate_of(own.gradient_system, own.parameters, rates)
    return momentum, -own.evaluate(system, x, values)


def rate_of_remainder(
    scene: Scene, one: Parameter, x: Array, v: Array, a: Array, time: Array
) -> Array:
    r"""Derivative of :math:`\partial_q L - \frac{d}{dt} \partial_v L` by names in formulas.

    Along a motion, with its accelerations; ``(n, d)``.
    """
    if (own := scene.lagrangian) is None:
        return _by_formulas(scene, one, x, v, time)[1]
    system, values = _rate_of(own.imbalance, own.parameters, one.under("lagrangian."))
    found = own.evaluate(system, x, v, time, values, a)
    return np.asarray(found[..., : own.dimension] - found[..., own.dimension :])


def rate_of_forcing(forcing: Forcing | None, one: Parameter, prefix: str) -> Forcing | None:
    """Derivative of a forcing; None if it is zero."""
    if forcing is None or not one.under(f"{prefix}."):
        return None
    pieces = []
    for number, piece in enumerate(forcing.pieces):
        place, every = f"{prefix}.{number}", enumerate(piece.components)
        rates = [_rate_of_component(own, one.under(f"{place}.{index}.")) for index, own in every]
        by_weights = np.zeros_like(piece.weights) + one.of(f"{place}.weights'")
        weights = np.hstack([by_weights, piece.weights])
        pieces.append(replace(piece, components=(*piece.components, *rates), weights=weights))
    return Forcing(pieces=tuple(pieces))


def _rate_of_component(component: ForceComponent, rates: Mapping[str, Any]) -> ForceComponent:
    if isinstance(component, SampledForce) and rates:
        return replace(component, coefficients=rates["coefficients'"])
    if not (isinstance(component, Expression) and rates):
        return Expression.parse("0", variables=("t",))
    system, values = _rate_of(component.system, dict(component.constants), rates)
    known = tuple(sorted(values.items()))
    return Expression("the derivative of a force", ("t",), known, system=system)


def _rate_of(
    system: FormulaSystem, parameters: Mapping[str, Any], rates: Mapping[str, Any]
) -> tuple[FormulaSystem, dict[str, Any]]:
    """The derivative of all outputs of a program, and the values of its names."""
    names = tuple(sorted(set(rates).intersection(system.names)))
    return _rate_system(system, names), {
        **parameters,
        **{f"d{name}'": float(rates[name]) for name in names},
    }


@lru_cache(maxsize=256)
def _rate_system(system: FormulaSystem, names: tuple[str, ...]) -> FormulaSystem:
    return derivatives(system, [{name: f"d{name}'" for name in names}])[len(system.outputs) :]
