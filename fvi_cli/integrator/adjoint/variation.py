r"""What a parameter does to the effects of a scene, with the motion held fixed.

Formulas are differentiated as formulas (`formula_rates`). All other numbers of a scene are smooth
in the parameter, most of them linear: there central differences of order four are taken, for linear
ones they are exact. Their steps are shortened until the differences of order two agree with them.
What the parameter does to the motion is left to the linearised run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fvi_cli.effects.matrices import entries
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.adjoint.formula_rates import (
    SceneRates,
    numbers_of,
    structure_of,
    with_formulas_of,
)
from fvi_cli.integrator.adjoint.linearised import Disturbance, LinearisedRun
from fvi_cli.integrator.balances.mesh_balance import loads_along
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.steps.dynamics import dynamics_of
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
STRAIGHT = 1e-14
"""Round-off of numbers on a straight line, relative."""
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
    """One parameter of a scene.

    Parameters
    ----------
    family
        The scene for a value of the parameter; all of them have the same damping terms.
    value
        Its value in the scene that was integrated.
    name
        What it is called in complaints.
    """

    family: Callable[[float], Scene]
    value: float
    name: str = "parameter"


def disturbance(run: LinearisedRun, method: Method, variations: Sequence[Variation]) -> Disturbance:
    """What parameters do to the equations of a run.

    Raises
    ------
    ValueError
        If the scene is not there, or another one, close beside a value.
    """
    steps, d, p = run.steps, run.scene.dimension, len(variations)
    n, r = steps.velocity.shape[:2]
    momentum, force, damping = np.zeros((3, n, r, d, p))
    loads = np.zeros((n, steps.tables.degree + 1, d, p))
    starts = np.zeros((3, d, p))
    points = (steps.stage_position, steps.velocity, steps.stage_time)
    forces: tuple[Array, Array] | None = None
    for column, one in enumerate(variations):
        rates = _rates(one, run, method, points)
        momentum[..., column], loads[..., column] = rates.momentum, rates.loads
        damping[..., column], starts[..., column] = rates.damping, rates.starts
        if np.any(rates.orders) or np.any(rates.coefficients):
            if forces is None:
                forces = run.damping_forces
            k = run.memory.n_damping
            plain, slopes = forces[0][:k], forces[1][:k]
            damping[..., column] += np.einsum("knia,kab->nib", plain, rates.coefficients)
            damping[..., column] += np.einsum(
                "k,knia,kab->nib", rates.orders, slopes, run.memory.matrices[:k]
            )
        force[..., column] = rates.force - damping[..., column]
    return Disturbance(
        momentum=momentum,
        force=force,
        damping=damping,
        loads=loads if np.any(loads) else None,
        position=starts[0],
        velocity=starts[1],
        start_momentum=starts[2],
    )


def differentiate(
    one: Variation, scene: Scene, values: Values, *, is_straight: bool | None = None
) -> list[Any]:
    """Derivatives of values by a parameter.

    Parameters
    ----------
    one, scene
        The parameter, and the scene at its value.
    values
        What is differentiated.
    is_straight
        Whether it is linear in the parameter; None: if the numbers of the scene are.

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
            # over short differences everything is straight
            may_be_straight = is_straight is None and attempt == 0
            found = _central(one, scene, values, step, is_straight, may_be_straight)
        except ValueError:
            # an order beside 0 or 2
            if attempt == ATTEMPTS - 1 and best is None:
                raise
            step *= 0.1
            continue
        if found.is_exact:
            return found.derivatives
        if best is None or found.doubt < best.doubt:
            best = found
        if found.doubt <= AGREEMENT:
            break
        step *= 0.1
    assert best is not None
    if best.doubt > SMOOTH:
        raise ValueError(
            f"{one.name}: what it changes is not smooth at {one.value:g}, and has no derivative; "
            "take another value"
        )
    return _beyond_round_off(one, scene, values, best).derivatives


@dataclass(frozen=True, kw_only=True, eq=False)
class _Differences:
    """Derivatives by differences, their relative doubt and relative round-off."""

    step: float
    derivatives: list[Any]
    doubt: float = 0.0
    noise: float = 0.0
    is_exact: bool = False


def _values_beside(
    one: Variation, scene: Scene, values: Values, step: float, places: Iterable[int]
) -> dict[int, list[Any]]:
    beside = {place: one.family(one.value + place * step) for place in places}
    for found in beside.values():
        if (len(found.damping), found.dimension) != (len(scene.damping), scene.dimension):
            raise ValueError(f"{one.name}: beside {one.value:g} the scene is another one")
    return {place: list(values(found, one.value + place * step)) for place, found in beside.items()}


def _central(
    one: Variation,
    scene: Scene,
    values: Values,
    step: float,
    is_straight: bool | None,
    may_be_straight: bool,
) -> _Differences:
    straight = bool(is_straight)
    if may_be_straight:
        low, high = (one.family(one.value + place * step) for place in (-1, 1))
        straight = _is_affine(low, scene, high)
    if straight:
        at = _values_beside(one, scene, values, step, CENTRAL[0])
        return _Differences(step=step, derivatives=_sums(CENTRAL[0], at, step), is_exact=True)
    return _by_stencils(one, scene, values, step, CENTRAL)


def _by_stencils(
    one: Variation, scene: Scene, values: Values, step: float, stencils: Stencils
) -> _Differences:
    at = _values_beside(one, scene, values, step, stencils[1])
    second, fourth = (_sums(stencil, at, step) for stencil in stencils)
    noise = [ROUND_OFF * np.abs(value).max(initial=0.0) / step for value in at[1]]
    sizes = [np.abs(value).max(initial=0.0) for value in fourth]
    doubt = max(_doubt(*three) for three in zip(second, fourth, noise, strict=True))
    shares = [float(a / size) for a, size in zip(noise, sizes, strict=True) if size > 0]
    return _Differences(step=step, derivatives=fourth, doubt=doubt, noise=max(shares, default=0.0))


def _sums(stencil: Mapping[int, float], at: Mapping[int, list[Any]], step: float) -> list[Any]:
    # what does not change has the derivative 0, without round-off of the factors
    return [
        np.asarray(sum(factor * (at[place][k] - base) for place, factor in stencil.items()) / step)
        for k, base in enumerate(at[1])
    ]


def _beyond_round_off(
    one: Variation, scene: Scene, values: Values, found: _Differences
) -> _Differences:
    """Longer differences, on one side where there is but one, while round-off is felt in them.

    A difference relative to a value near 0 is round-off and little else.
    """
    step = found.step
    for _ in range(GROWTHS):
        if found.noise <= FELT:
            break
        step *= 10.0
        for stencils in (CENTRAL, FORWARD):
            try:
                longer = _by_stencils(one, scene, values, step, stencils)
            except ValueError:
                continue
            # the factors on one side are larger
            if longer.noise < found.noise and longer.doubt <= max(AGREEMENT, 20.0 * longer.noise):
                found = longer
            break
    return found


def _doubt(second: Array, fourth: Array, noise: float) -> float:
    """Relative difference of two derivatives, beyond round-off."""
    left = float(np.abs(second - fourth).max(initial=0.0))
    if not np.isfinite(left):
        return 0.0
    size = float(np.abs(fourth).max(initial=0.0))
    return left / size if left > noise else 0.0


def _is_affine(low: Scene, middle: Scene, high: Scene) -> bool:
    """Whether three scenes are linear, and their numbers lie on straight lines."""
    if not middle.is_linear or not _have_same_loads(low, high):
        return False
    if not _have_same_laws(low, high):
        return False
    every = [_numbers(scene) for scene in (low, middle, high)]
    if len({one.size for one in every}) != 1:
        return False
    bend = np.abs(every[0] - 2.0 * every[1] + every[2])
    return bool(np.all(bend <= STRAIGHT * np.abs(every[1])))


def _numbers(scene: Scene) -> Array:
    """Everything that a linear scene is made of, in one row."""
    stiffness = np.zeros(0)
    if isinstance(scene.potential, QuadraticPotential):
        stiffness = entries(scene.potential.form)
    damping = [np.append(entries(term.form), term.order) for term in scene.damping]
    start = (scene.initial_position, scene.initial_velocity)
    return np.concatenate([entries(scene.inertia.form), stiffness, *damping, *start])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rates:
    """Derivatives of effects at the stages of one run."""

    momentum: Array
    force: Array
    damping: Array
    loads: Array
    starts: Array
    orders: Array
    coefficients: Array


def _rates(
    one: Variation, run: LinearisedRun, method: Method, points: tuple[Array, Array, Array]
) -> _Rates:
    scene, steps = run.scene, run.steps
    nothing = np.zeros((steps.n_steps, steps.tables.degree + 1, scene.dimension))
    k, own = run.memory.n_damping, structure_of(scene)
    size = 1e-3 * DIFFERENCE * (abs(one.value) or 1.0)
    try:
        near = one.family(one.value + size)
    except ValueError:
        near = one.family(one.value - size)
    by_formula = structure_of(near) == own

    def values(beside: Scene, _: float) -> list[Array]:
        numbers: list[Array] = []
        if by_formula:
            if structure_of(beside) != own:
                raise ValueError(f"{one.name}: beside {one.value:g} the scene is another one")
            numbers = numbers_of(beside)
            beside = with_formulas_of(beside, scene)
        dynamics = dynamics_of(beside)
        with np.errstate(all="ignore"):
            momentum, force = dynamics.forces(*points)
            start = dynamics.momentum(beside.initial_position, beside.initial_velocity, 0.0)
        law = np.zeros_like(force)
        if not _have_same_laws(beside, scene):
            law = run.law_forces(beside)
        loads = nothing
        if not _have_same_loads(beside, scene):
            loads = loads_of(beside, method, steps)
        starts = np.stack([beside.initial_position, beside.initial_velocity, start])
        orders = np.array([term.order for term in beside.damping][:k])
        coefficients = np.array([term.coefficient for term in beside.damping][:k])
        return [momentum, force, law, loads, starts, orders, coefficients, *numbers]

    found = differentiate(one, scene, values)
    momentum, force, damping, loads, starts, orders, coefficients, *numbers = found
    if by_formula and any(one.any() for one in numbers):
        rates = SceneRates(scene=scene, rates=numbers)
        with np.errstate(all="ignore"):
            of_points = rates.forces(*points)
            of_start = rates.forces(scene.initial_position, scene.initial_velocity, 0.0)
        momentum, force = momentum + of_points[0], force + of_points[1]
        starts = starts + np.stack([np.zeros_like(of_start[0])] * 2 + [of_start[0]])
        if (forcing := rates.forcing()) is not None:
            still = np.zeros(scene.dimension)
            moved = replace(scene, forcing=forcing, initial_position=still, initial_velocity=still)
            loads = loads + loads_of(moved, method, steps)
    return _Rates(
        momentum=momentum,
        force=force,
        damping=damping,
        loads=loads,
        starts=starts,
        orders=orders,
        coefficients=coefficients.reshape(k, scene.dimension, scene.dimension),
    )


def loads_of(scene: Scene, method: Method, steps: RunSteps) -> Array:
    """Load vectors of all steps of a run, ``(n, s + 1, d)``."""
    fresh = np.isin(steps.time[:-1], [0.0, *scene.break_points])
    found = loads_along(StepLoads(scene, method, steps.tables).of_steps, steps, fresh)
    nothing = np.zeros((steps.n_steps, steps.tables.degree + 1, scene.dimension))
    return nothing if found is None else found


def _have_same_laws(one: Scene, other: Scene) -> bool:
    """Whether relaxation laws of two scenes remember the same."""
    return len(one.laws) == len(other.laws) and all(
        a.kernel == b.kernel and a.size == b.size and np.array_equal(a.coefficient, b.coefficient)
        for a, b in zip(one.laws, other.laws, strict=True)
    )


def _have_same_loads(one: Scene, other: Scene) -> bool:
    """Whether known forces of two scenes are certainly the same."""
    if one.derivative != "caputo" and np.any(one.initial_position != 0):
        return False
    if one.forcing is None or other.forcing is None:
        return one.forcing is other.forcing
    pieces = [
        [(piece.until, piece.components) for piece in forcing.pieces]
        for forcing in (one.forcing, other.forcing)
    ]
    return pieces[0] == pieces[1]
