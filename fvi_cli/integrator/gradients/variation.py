r"""What a parameter does to the equations of a run, with the motion held fixed.

A scene for a value of the parameter is given; how fast its numbers move is found by central
differences of order four. Their steps are shortened until the differences of order two agree with
them. What the moving numbers do to momenta, forces and load vectors is exact (`numbers`), and what
this does to the motion is left to the linearised run. Forces that are no formulas, the memory of
relaxation laws and the jump of a Riemann-Liouville derivative are differentiated by their values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.balance import loads_along
from fvi_cli.integrator.gradients.linearised import Disturbance, LinearisedRun
from fvi_cli.integrator.gradients.numbers import numbers_of, rate_of_forcing, rates_of_forces
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.mathematics.arrays import Array

DIFFERENCE = 1e-3
"""First difference of a parameter, relative to its size."""
ATTEMPTS = 6
"""Differences that are tried, each a tenth of the one before."""
AGREEMENT = 1e-5
"""Relative difference of both orders at which that of order four is right to some 1e-10."""
SMOOTH = 1e-3
"""Relative difference of both orders above which nothing was found."""
ROUND_OFF = 1e-14
"""Of values of which differences are taken, relative."""
FELT = 1e-8
"""Relative round-off of a derivative above which longer differences are tried."""
GROWTHS = 12
"""Differences that are tried then, each ten times the one before."""

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
"""Arrays that are differentiated, by the scene and the value of the parameter."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Variation:
    """One parameter of a scene."""

    family: Callable[[float], Scene]  # for a value; all have the same damping terms
    value: float  # in the scene that was integrated
    name: str = "parameter"  # in messages


def disturbance(run: LinearisedRun, variations: Sequence[Variation]) -> Disturbance:
    """What parameters do to the equations of a run.

    Raises
    ------
    ValueError
        If the scene is not there, or another one, close beside a value.
    """
    parts = [_disturbance(run, one) for one in variations]
    (n, r, d), s = run.steps.velocity.shape, run.tables.degree
    shapes = {"loads": (n, s + 1, d), "damping": (n, r, d)}
    return Disturbance(
        **{
            name: np.array([part[name] for part in parts]).reshape(-1, *shapes.get(name, (d,)))
            for name in ("loads", "damping", "position", "velocity", "momentum")
        }
    )


def _disturbance(run: LinearisedRun, one: Variation) -> dict[str, Array]:
    scene, points = run.scene, run.points
    own, k = numbers_of(scene)[0], len(scene.damping)
    jumps = scene.derivative != "caputo"
    position, velocity = scene.initial_position, scene.initial_velocity

    def of_damping(varied: Scene) -> list[Any]:
        kernels = [law.kernel for law in varied.laws]
        remembered: Any = 0.0
        if kernels != [law.kernel for law in scene.laws]:
            remembered = run.forces_of(kernels)
        return [
            np.array([term.order for term in varied.damping]),
            np.array([f.matrix for f in varied.damping]),
            np.array([law.size * law.matrix for law in varied.laws]),
            remembered,
            loads_of(run, varied, "of_damping") if jumps else 0.0,
            varied.initial_position,
            varied.initial_velocity,
        ]

    def by_numbers(varied: Scene, _: float) -> list[Any]:
        structure, numbers = numbers_of(varied)
        if structure != own:
            raise ValueError(f"{one.name}: the scene has another form near {one.value:g}")
        return of_damping(varied) + numbers

    def by_values(varied: Scene, _: float) -> list[Any]:
        with np.errstate(all="ignore"):
            start = varied.momentum(position, velocity, 0.0)
            return [
                *of_damping(varied),
                *varied.forces(*points),
                start,
                loads_of(run, varied, "of_forcing"),
            ]

    try:
        orders, coefficients, laws, remembered, loads, x, v, *rates = differentiate(
            one, scene, by_numbers
        )
        momentum, force = rates_of_forces(scene, rates, *points)
        start = rates_of_forces(scene, rates, position, velocity, 0.0)[0]
        if (forcing := rate_of_forcing(scene, rates)) is not None:
            loads = loads + loads_of(run, replace(scene, forcing=forcing), "of_forcing")
    except ValueError:
        found = differentiate(one, scene, by_values)
        orders, coefficients, laws, remembered, loads, x, v, momentum, force, start, more = found
        loads = loads + more
    if x.any() or v.any():
        at_start = scene.derivatives(position[None], velocity[None], np.zeros(1))
        start = start + at_start.mass[0] @ v + at_start.mixed[0] @ x
    damping = np.zeros_like(force)
    for force_of_one, matrix in zip(run.plain_forces, [*coefficients, *laws], strict=False):
        if matrix.any():
            damping += force_of_one @ matrix
    slopes = run.plain_forces[len(run.coefficients) :]
    for rate, slope, matrix in zip(orders, slopes, run.coefficients, strict=False):
        if rate:
            damping -= rate * slope @ matrix
    if np.ndim(remembered):
        damping += np.einsum("knia,kab->nib", remembered, run.coefficients[k:])
    return {
        "loads": loads + run.loads_by(momentum, force - damping),
        "damping": damping,
        "position": x,
        "velocity": v,
        "momentum": start,
    }


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
        If the scene is not there, or another one, close beside the value, or what is
        differentiated is not smooth there.
    """
    step = DIFFERENCE * (abs(one.value) or 1.0)
    best: _Differences | None = None
    for attempt in range(ATTEMPTS):
        try:
            found = _differences(one, scene, values, step, CENTRAL)
        except ValueError:
            # an order beside 0 or 2
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
    for _ in range(GROWTHS):
        if best.noise <= FELT:
            break
        step *= 10.0
        for stencils in (CENTRAL, FORWARD):
            try:
                longer = _differences(one, scene, values, step, stencils)
            except ValueError:
                continue
            # the factors on one side are larger
            if longer.noise < best.noise and longer.doubt <= max(AGREEMENT, 20.0 * longer.noise):
                best = longer
            break
    return best.derivatives


@dataclass(frozen=True, kw_only=True, eq=False)
class _Differences:
    """Derivatives by differences, their relative doubt and relative round-off."""

    step: float
    derivatives: list[Any]
    doubt: float
    noise: float


def _differences(
    one: Variation, scene: Scene, values: Values, step: float, stencils: Stencils
) -> _Differences:
    at = []
    for place in stencils[1]:
        varied = one.family(one.value + place * step)
        if (len(varied.damping), varied.dimension) != (len(scene.damping), scene.dimension):
            raise ValueError(f"{one.name}: the scene has another form near {one.value:g}")
        at.append([np.asarray(o) for o in values(varied, one.value + place * step)])
    flat = np.array([np.concatenate([own.ravel() for own in row]) for row in at])
    # what does not change has the derivative 0, without round-off of the factors
    base = flat[0]
    factors = [[stencil.get(place, 0.0) / step for place in stencils[1]] for stencil in stencils]
    second, fourth = (np.asarray(row) @ (flat - base) for row in factors)
    derivatives, doubt, noise, begin = [], 0.0, 0.0, 0
    for own in at[0]:
        part = slice(begin, begin := begin + own.size)
        derivatives.append(fourth[part].reshape(own.shape))
        if fourth[part].any():
            size, left = np.abs(fourth[part]).max(), np.abs(second[part] - fourth[part]).max()
            round_off = ROUND_OFF * np.abs(base[part]).max() / step
            noise = max(noise, float(round_off / size))
            doubt = max(doubt, float(left / size) if round_off < left < np.inf else 0.0)
    return _Differences(step=step, derivatives=derivatives, doubt=doubt, noise=noise)
