r"""Effect of a parameter on the equations of a run, with the motion held fixed.

A function gives the scene for a value of the parameter. The rates of the scene's numbers are found
by central differences of order four, with steps that are shortened until differences of order two
agree. The derivatives of momenta, forces and load vectors by the numbers are exact (`numbers`); the
linearised run gives the effect on the motion. Forces that are not formulas, the memory of
relaxation laws and the jump of a Riemann-Liouville derivative are differentiated by their values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, NoReturn

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.balance import loads_along
from fvi_cli.integrator.gradients.linearised import Disturbance, LinearisedRun, damped
from fvi_cli.integrator.gradients.numbers import numbers_of, rate_of_forcing, rates_of_forces
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.mathematics.arrays import Array

DIFFERENCE = 1e-3
"""First difference of a parameter, relative to its size."""
ATTEMPTS = 6
"""Number of differences that are tried, each a tenth of the one before."""
AGREEMENT = 1e-5
"""Relative difference of the results of both orders at which order four is right to some 1e-10."""
SMOOTH = 1e-3
"""Relative difference of the results of both orders above which there is no derivative."""
ROUND_OFF = 1e-14
"""Relative round-off of the values of which differences are taken."""
LARGEST_ROUND_OFF = 1e-8
"""Relative round-off of a derivative above which longer differences are tried."""
LONGER_DIFFERENCES = 12
"""Number of longer differences that are tried then, each ten times the one before."""

Stencils = tuple[Mapping[int, float], Mapping[int, float]]
"""Factors of the values at multiples of a difference, of order two and of order four."""
CENTRAL: Stencils = (
    {1: 0.5, -1: -0.5},
    {1: 2.0 / 3.0, -1: -2.0 / 3.0, 2: -1.0 / 12.0, -2: 1.0 / 12.0},
)
FORWARD: Stencils = (
    {0: -1.5, 1: 2.0, 2: -0.5},
    {0: -25.0 / 12.0, 1: 4.0, 2: -3.0, 3: 4.0 / 3.0, 4: -0.25},
)

Values = Callable[[Scene, float], Sequence[Any]]
"""From the scene and the value of the parameter to the arrays that are differentiated."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Variation:
    """One parameter of a scene."""

    family: Callable[[float], Scene]  # the scene for a value; all have the same damping terms
    value: float  # in the scene that was integrated
    name: str = "parameter"  # in messages

    def refuse_form(self) -> NoReturn:
        """Raise an error: scenes near the value are not comparable."""
        raise ValueError(f"{self.name}: the scene has another form near {self.value:g}")


def disturbance(run: LinearisedRun, variations: Sequence[Variation]) -> Disturbance:
    """Effect of parameters on the equations of a run.

    Raises
    ------
    ValueError
        If the scene does not exist near a value, or has another form there.
    """
    parts = [_disturbance(run, one) for one in variations]
    # shapes, also without any parameter
    (n, r, d), s = run.steps.velocity.shape, run.tables.degree
    empty = [np.zeros(shape) for shape in ((0, n, s + 1, d), (0, d), (0, d), (0, n, r, d))]
    every = zip(*parts, strict=True) if parts else empty
    names = [one.name for one in fields(Disturbance)]
    return Disturbance(**dict(zip(names, map(np.array, every), strict=True)))


def _disturbance(run: LinearisedRun, one: Variation) -> tuple[Array, Array, Array, Array]:
    """Load vectors, position and momentum at the start, and damping force by one parameter."""
    scene, points = run.scene, run.points
    position, velocity = scene.initial_position, scene.initial_velocity
    structure, kernels = numbers_of(scene)[0], [law.kernel for law in scene.laws]

    def of_damping(varied: Scene) -> list[Any]:
        own = [law.kernel for law in varied.laws]
        return [
            np.array([term.order for term in varied.damping]),
            np.array([term.matrix for term in varied.damping]),
            np.array([law.size * law.matrix for law in varied.laws]),
            run.forces_of(own) if own != kernels else 0.0,
            loads_of(run, varied, "of_initial_data") if scene.derivative != "caputo" else 0.0,
            varied.initial_position,
            varied.initial_velocity,
        ]

    def by_numbers(varied: Scene, _: float) -> list[Any]:
        form, numbers = numbers_of(varied)
        if form != structure:
            one.refuse_form()
        return of_damping(varied) + numbers

    def by_values(varied: Scene, _: float) -> list[Any]:
        with np.errstate(all="ignore"):
            forcing = loads_of(run, varied, "of_forcing")
            motion = varied.forces(*points)
            start = varied.momentum(position, velocity, 0.0)
        return [*of_damping(varied), start, *motion, forcing]

    try:
        orders, coefficients, laws, remembered, loads, x, v, *rates = differentiate(
            one, scene, by_numbers
        )
        momentum, force = rates_of_forces(scene, rates, *points)
        impulse = rates_of_forces(scene, rates, position, velocity, 0.0)[0]
        if (forcing := rate_of_forcing(scene, rates)) is not None:
            loads = loads + loads_of(run, replace(scene, forcing=forcing), "of_forcing")
    except ValueError:
        orders, coefficients, laws, remembered, loads, x, v, *motion = differentiate(
            one, scene, by_values
        )
        impulse, momentum, force, forcing = motion
        loads = loads + forcing
    if x.any() or v.any():
        at_start = scene.derivatives(position[None], velocity[None], np.zeros(1))
        impulse = impulse + at_start.mass[0] @ v + at_start.mixed[0] @ x
    # by the matrices of all terms, and by their orders
    turned = [-rate * matrix for rate, matrix in zip(orders, run.coefficients, strict=False)]
    matrices = [*coefficients, *laws] or [np.zeros_like(run.coefficients[0])]
    damping = run.changes_by_start(v) + damped(run.plain_forces, [*matrices, *turned])
    if np.ndim(remembered):
        damping += damped(remembered, run.coefficients[len(scene.damping) :])
    return loads + run.loads_by(momentum, force - damping), x, impulse, damping


def loads_of(run: LinearisedRun, scene: Scene, part: str) -> Array:
    """Load vectors of all steps of a run by the forces of a scene, ``(n, s + 1, d)``."""
    steps = run.steps
    fresh = np.isin(steps.time[:-1], [0.0, *scene.break_points])
    found = loads_along(getattr(StepLoads(scene, run.method, steps.tables), part), steps, fresh)
    zero = np.zeros((steps.n_steps, steps.tables.degree + 1, scene.dimension))
    return zero if found is None else found


def differentiate(one: Variation, scene: Scene, values: Values) -> list[Any]:
    """Derivatives of values by a parameter of the scene.

    Raises
    ------
    ValueError
        If the scene does not exist near the value or has another form there, or if an array is
        not smooth there.
    """
    step = DIFFERENCE * (abs(one.value) or 1.0)
    best: _Differences | None = None
    for attempt in range(ATTEMPTS):
        try:
            found = _differences(one, scene, values, step, CENTRAL)
        except ValueError:
            # for example an order close to 0 or 2
            if attempt == ATTEMPTS - 1 and best is None:
                raise
        else:
            best = found if best is None or found.doubt < best.doubt else best
            if found.doubt <= AGREEMENT:
                break
        step *= 0.1
    assert best is not None
    if best.doubt > SMOOTH:
        raise ValueError(
            f"{one.name}: what it changes is not smooth at {one.value:g}, and has no derivative; "
            "take another value"
        )
    # a difference relative to a value near 0 is round-off and little else
    step = best.step
    for _ in range(LONGER_DIFFERENCES):
        if best.noise <= LARGEST_ROUND_OFF:
            break
        step *= 10.0
        for stencils in (CENTRAL, FORWARD):
            try:
                longer = _differences(one, scene, values, step, stencils)
            except ValueError:
                continue
            # one-sided differences have larger factors
            if longer.noise < best.noise and longer.doubt <= max(AGREEMENT, 20.0 * longer.noise):
                best = longer
            break
    return best.derivatives


class _Differences(NamedTuple):
    """Derivatives by differences, their relative error (`doubt`) and round-off (`noise`)."""

    step: float
    derivatives: list[Any]
    doubt: float
    noise: float


def _differences(
    one: Variation, scene: Scene, values: Values, step: float, stencils: Stencils
) -> _Differences:
    rows = []
    for place in stencils[1]:
        number = one.value + place * step
        varied = one.family(number)
        if (len(varied.damping), varied.dimension) != (len(scene.damping), scene.dimension):
            one.refuse_form()
        rows.append([np.asarray(own) for own in values(varied, number)])
    factors = [[stencil.get(place, 0.0) / step for place in stencils[1]] for stencil in stencils]
    derivatives, doubt, noise = [], 0.0, 0.0
    for column in zip(*rows, strict=True):
        flat = np.array([own.ravel() for own in column])
        # relative to the first value: constants have the derivative 0 without round-off
        with np.errstate(invalid="ignore"):
            # infinite values give nan
            second, fourth = np.array(factors) @ (flat - flat[0])
        derivatives.append(fourth.reshape(column[0].shape))
        if fourth.any():
            size, left = np.abs(fourth).max(), np.abs(second - fourth).max()
            round_off = ROUND_OFF * np.abs(flat[0]).max() / step
            noise = max(noise, float(round_off / size))
            doubt = max(doubt, float(left / size) if round_off < left < np.inf else 0.0)
    return _Differences(step, derivatives, doubt, noise)
