r"""What a parameter does to the effects of a scene, with the motion held fixed.

Effects are smooth in their numbers and mostly linear, so fourth-order central differences of them
are exact to about :math:`10^{-13}` (for linear ones by construction). What the parameter does to
the motion is left to the linearised run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.matrices import entries
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.adjoint.linearised import Disturbance, LinearisedRun
from fvi_cli.integrator.balances.mesh_balance import loads_along
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.steps_of_run import RunSteps
from fvi_cli.integrator.steps.dynamics import dynamics_of
from fvi_cli.mathematics.arrays import Array

DIFFERENCE = 1e-3
"""Difference of a parameter, relative to its size."""
ATTEMPTS = 4
"""Differences that are tried, each a tenth of the one before, where a value may not be left far."""
STRAIGHT = 1e-14
"""Round-off of numbers on a straight line, relative."""
FACTORS = {1: 2.0 / 3.0, -1: -2.0 / 3.0, 2: -1.0 / 12.0, -2: 1.0 / 12.0}


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
        total = _Rates(run, method, points)
        for scene, factor, _ in differences(one, run.scene):
            total.add(scene, factor)
        momentum[..., column], damping[..., column] = total.momentum, total.damping
        loads[..., column] = total.loads
        starts[..., column] = total.starts
        if np.any(total.orders) or np.any(total.coefficients):
            if forces is None:
                forces = run.damping_forces
            k = run.memory.n_damping
            plain, slopes = forces[0][:k], forces[1][:k]
            damping[..., column] += np.einsum("knia,kab->nib", plain, total.coefficients)
            damping[..., column] += np.einsum(
                "k,knia,kab->nib", total.orders, slopes, run.memory.matrices[:k]
            )
        force[..., column] = total.force - damping[..., column]
    return Disturbance(
        momentum=momentum,
        force=force,
        damping=damping,
        loads=loads if np.any(loads) else None,
        position=starts[0],
        velocity=starts[1],
        start_momentum=starts[2],
    )


def differences(
    one: Variation, scene: Scene, *, is_straight: bool | None = None
) -> list[tuple[Scene, float, float]]:
    """Scenes beside a value, their factors in the derivative by it, and the values.

    Parameters
    ----------
    one, scene
        The parameter, and the scene at its value.
    is_straight
        Whether what is differentiated is linear in the parameter; None: if the numbers of the
        scene are.

    Raises
    ------
    ValueError
        If the scene is not there, or another one, close beside the value.
    """
    step = DIFFERENCE * (abs(one.value) or 1.0)
    for attempt in range(ATTEMPTS):
        try:
            near = {place: one.family(one.value + place * step) for place in (1, -1)}
            if is_straight is None and _is_affine(near[-1], scene, near[1]):
                factors = {1: 0.5, -1: -0.5}
                beside = near
            else:
                factors = FACTORS
                far = {place: one.family(one.value + place * step) for place in (2, -2)}
                beside = {**near, **far}
            break
        except ValueError:
            # an order beside 0 or 2
            if attempt == ATTEMPTS - 1:
                raise
            step *= 0.1
    for found in beside.values():
        if (len(found.damping), found.dimension) != (len(scene.damping), scene.dimension):
            raise ValueError(f"{one.name}: beside {one.value:g} the scene is another one")
    return [
        (beside[place], factor / step, one.value + place * step)
        for place, factor in factors.items()
    ]


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


class _Rates:
    """Sums of the effects of scenes at the stages of one run."""

    def __init__(
        self, run: LinearisedRun, method: Method, points: tuple[Array, Array, Array]
    ) -> None:
        steps, d = run.steps, run.scene.dimension
        self._run, self._method, self._points = run, method, points
        n, r = steps.velocity.shape[:2]
        self.momentum, self.force, self.damping = np.zeros((3, n, r, d))
        self.loads = np.zeros((n, steps.tables.degree + 1, d))
        self.starts = np.zeros((3, d))
        self.orders = np.zeros(run.memory.n_damping)
        self.coefficients = np.zeros((run.memory.n_damping, d, d))

    def add(self, scene: Scene, factor: float) -> None:
        """Add what a scene has at the stages, times a factor."""
        dynamics = dynamics_of(scene)
        with np.errstate(all="ignore"):
            momentum, force = dynamics.forces(*self._points)
            start = dynamics.momentum(scene.initial_position, scene.initial_velocity, 0.0)
        self.momentum += factor * momentum
        self.force += factor * force
        self.starts[0] += factor * scene.initial_position
        self.starts[1] += factor * scene.initial_velocity
        self.starts[2] += factor * start
        for index, term in enumerate(scene.damping):
            self.orders[index] += factor * term.order
            self.coefficients[index] += factor * term.coefficient
        if not _have_same_laws(scene, self._run.scene):
            self.damping += factor * self._run.law_forces(scene)
        if not _have_same_loads(scene, self._run.scene):
            self.loads += factor * loads_of(scene, self._method, self._run.steps)


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
