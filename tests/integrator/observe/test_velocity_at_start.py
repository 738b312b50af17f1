r"""Velocities behind the start, where the steps are shorter than round-off of a position: a class.

And momenta and energies at mesh points, of all orders above 1.

The oracle solves the Volterra equation of the acceleration. Beside it stands what follows from the
equation of motion alone: :math:`|v(t) - v_0|` is at most the integral of all forces, and those of
Riemann-Liouville derivatives and of orders below 1 are like powers of t.
"""

import math

import numpy as np
from letters import swing
from numpy.typing import NDArray
from oracles.volterra import VolterraSolution, solve_volterra
from spread import few_of, spread

import fvi_cli as fvi
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.steps import RunSteps

Array = NDArray[np.float64]
Terms = tuple[tuple[float, float], ...]

FINAL_TIME = 1.2
EARLY = np.geomspace(1e-18, 1e-3, 31)
METHODS = ("gauss6-graded", "gauss5-graded", "gauss4-graded")
TIMES = FINAL_TIME * np.concatenate([EARLY, np.linspace(0.01, 1.0, 45)])


def drawn(seed: int) -> tuple[Scene, Terms]:
    """A pendulum with two terms of damping, far from 0 where the derivative permits it."""
    rng = np.random.default_rng([20, seed])
    derivative = ("caputo", "riemann-liouville")[seed % 2]
    (low, lower), (high, higher) = rng.uniform(0.05, 0.95, 2), rng.uniform(1.0, 1.95, 2)
    pairs = ((low, high), (high, 1.0), (low, 1.0), (high, higher), (low, lower))
    pair = pairs[(seed // 2) % 5]
    terms = tuple((float(order), float(rng.uniform(0.02, 0.5))) for order in pair)
    place = 0.0
    if derivative == "caputo" or max(pair) < 1:
        place = float(rng.choice([-1.375, 0.3, 2 * math.pi * 100 + 1.0]))
    speed = float(rng.choice([-1, 1]) * 10.0 ** rng.uniform(-1, 1))
    return swing(*terms, T=FINAL_TIME, x=place, v=speed, derivative=derivative), terms


def oracle(scene: Scene, terms: Terms) -> VolterraSolution:
    """The motion by other means."""
    return solve_volterra(
        1.0,
        terms,
        np.sin,
        lambda x: np.cos(x)[..., None],
        None,
        scene.initial_position,
        scene.initial_velocity,
        FINAL_TIME,
        derivative=scene.derivative,
    )


def largest_change(scene: Scene, terms: Terms, time: Array) -> Array:
    """A bound of |v(t) - v0| for short times: twice the integral of all forces at first."""
    place, speed = abs(scene.initial_position[0]), abs(scene.initial_velocity[0])
    found = time.copy()
    for order, coefficient in terms:
        power = 2 - order if order <= 1 or scene.derivative != "caputo" else 1.0
        found += coefficient * speed * time**power / math.gamma(1 + power)
        if order < 1 and scene.derivative != "caputo":
            found += coefficient * place * time ** (1 - order) / math.gamma(2 - order)
    return 2 * found


def off_by(velocity: Array, scene: Scene, terms: Terms, known: VolterraSolution) -> float:
    """How far velocities at `TIMES` are from the oracle, and from v0 beyond the bound."""
    early = velocity[: EARLY.size]
    change = np.abs(early - scene.initial_velocity)
    excess = change - largest_change(scene, terms, TIMES[: EARLY.size])
    wrong = np.abs(velocity - known.velocity(TIMES)[:, 0])
    return float(max(wrong.max(), excess.max()) / known.scale()[1][0])


def of_extents(scene: Scene, known: VolterraSolution) -> Array:
    """Least, greatest and rms of the velocity on a fine grid."""
    grid = np.concatenate([np.geomspace(1e-18, 1e-3, 200), np.linspace(1e-3, 1.0, 4001)])
    found = np.append(known.velocity(FINAL_TIME * grid)[:, 0], scene.initial_velocity)
    even = known.velocity(np.linspace(1e-12, FINAL_TIME, 4001))[:, 0]
    return np.array([found.min(), found.max(), math.sqrt(np.trapezoid(even**2, dx=1 / 4000))])


def is_rough(scene: Scene, terms: Terms) -> bool:
    """Whether the velocity has a power of t below 1 at the start."""
    return scene.derivative != "caputo" and any(
        order > 1 or scene.initial_position[0] != 0 for order, _ in terms
    )


@few_of(2, 80)
def test_velocities_and_their_extents_from_the_start_on(seed):
    scene, terms = drawn(seed)
    known = oracle(scene, terms)
    run = fvi.integrate(scene, METHODS[seed % 3], 98, output=TIMES, quantities={"v": "vx"})
    # the first step has no better than its polynomial for a power below 1
    most = 1e-4 if is_rough(scene, terms) else 1e-8
    assert off_by(run.observed.quantities["v"], scene, terms, known) < most
    extent = run.observed.extents["v"]
    wrong = np.array([extent.least, extent.greatest, extent.rms]) - of_extents(scene, known)
    # the polynomial of the first step does not begin at v0, where the velocity falls from it
    most = 1e-2 if is_rough(scene, terms) else 1e-6
    assert np.abs(wrong[:2] / known.scale()[1][0]).max() < most
    assert abs(wrong[2] / known.scale()[1][0]) < 1e-4


ORDERS = (1.05, 1.2, 1.4, 1.6, 1.75, 1.9, 1.99)
GRADED = "gauss4-graded"


def scene_of(derivative: str, *terms: tuple[float, float]) -> Scene:
    place = -1.375 if derivative == "caputo" else 0.0
    return swing(*terms, T=FINAL_TIME, x=place, v=0.3, derivative=derivative)


def errors(scene: Scene, terms: tuple[tuple[float, float], ...], run: fvi.Trajectory) -> Array:
    """Of stored momenta and energies, relative, away from the start; shape ``(2,)``."""
    late = run.time > 0.1 * FINAL_TIME
    known = oracle(scene, terms)
    x, v = known.position(run.time[late])[:, 0], known.velocity(run.time[late])[:, 0]
    energy = v**2 / 2 + 1 - np.cos(x)
    momentum = np.abs(run.momentum[late, 0] - v).max() / np.abs(v).max()
    return np.array([momentum, np.abs(run.energy[late] - energy).max() / energy.max()])


@spread(few=1, derivative=["caputo", "riemann-liouville"], order=ORDERS)
def test_stored_momenta_and_energies_are_those_of_the_motion(derivative, order):
    terms = ((order, 0.4), (0.6, 0.1)) if order in ORDERS[::2] else ((order, 0.4),)
    scene = scene_of(derivative, *terms)
    most = 1e-10 if derivative == "caputo" else 3e-8
    assert errors(scene, terms, fvi.integrate(scene, GRADED, 64)).max() < most
    adaptive = fvi.integrate(scene, "gauss4", fvi.AdaptiveSteps(tolerance=1e-9))
    assert errors(scene, terms, adaptive).max() < 1e-7


def test_the_error_is_seen_without(monkeypatch):
    """The control: the momenta of the recursion."""
    monkeypatch.setattr(RunSteps, "momenta_of_polynomials", lambda self, _: self.momentum)
    scene = scene_of("riemann-liouville", (1.9, 0.4))
    run = fvi.integrate(scene, GRADED, 64)
    assert errors(scene, ((1.9, 0.4),), run).max() > 3e-8
