"""A formula that is added to samples or a function is looked at as one that stands by itself.

Samples of a straight line are the same force as its formula, so each scene is there twice.
"""

from dataclasses import replace

import numpy as np
import pytest
from letters import spring
from spread import spread

import fvi_cli as fvi
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece
from fvi_cli.effects.sampled import FunctionForce, SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.local_error.forces import SceneForces
from fvi_cli.integrator.local_error.pulses import find_pulses
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.intervals.functions import Interval

KINDS = ("samples", "function")
TEXTS = {
    "pulse": "exp(-((t - {at})/{width})**2)",
    "train": "1/cosh(sin(3*(t - {at}))/{width})",
    "waves": "cos(t/{width})",
    "kink": "abs(t - {at})",
    "power": "{part}*max(t - {half}, 0)**0.5",
    "pole": "(t - {at})**(-2)",
    "gentle": "cos(t - {at})",
}


def line(kind: str, slope: float, T: float) -> ForceComponent:
    """A straight line that begins at 1."""
    if kind == "samples":
        times = np.linspace(0.0, T, 25)
        return SampledForce.through(times, 1.0 + slope * times, "linear")
    if kind == "function":
        return FunctionForce(function=lambda t: 1.0 + slope * t)
    return Expression.parse(f"1 + {slope!r}*t", variables=("t",))


def pair(kind: str, formula: str, rng: np.random.Generator, T: float) -> tuple[Forcing, Forcing]:
    """A formula beside a line that is none, and both as a formula, in two pieces."""
    slope = float(rng.uniform(-3.0, 3.0))
    own = Expression.parse(formula, variables=("t",))
    components = [(line(one, slope, T).plus(own),) for one in (kind, "formula")]
    pieces = [
        (ForcingPiece(components=one, until=0.5 * T), ForcingPiece(components=one))
        for one in components
    ]
    return Forcing(pieces=pieces[0]), Forcing(pieces=pieces[1])


def seen(forcing: Forcing, T: float) -> list[object]:
    """What is known of a force before a run."""
    scene = spring((0.5, 0.1), k=1.0, T=T, x=1.0)
    if objection := forcing.objection(T):
        return [objection]
    scene = replace(scene, forcing=forcing)
    low = np.linspace(0.0, 0.4 * T, 7)
    boxes = SceneForces(scene).enclosed([], [], Interval(low, low + 0.05 * T), 0.3 * T)
    return [
        find_pulses(forcing, T, 1e-9 * T).points,
        start_power(scene, at_start=False),
        [np.round([box.low, box.high], 9).tolist() for _, box in boxes],
    ]


@pytest.mark.few(8)
@spread(few=2, seed=range(6))
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", list(TEXTS))
def test_it_is_seen_as_a_formula_by_itself(seed, kind, name):
    rng = np.random.default_rng([seed, len(kind), len(name)])
    T = float(rng.uniform(3.0, 9.0))
    given = {
        "at": float(rng.uniform(0.1, 0.9)) * T,
        "width": T * 10 ** float(rng.uniform(-5, -2.5)),
        "half": 0.5 * T,
        "part": 1.0,
    }
    beside, alone = pair(kind, TEXTS[name].format(**given), rng, T)
    assert seen(beside, T) == seen(alone, T)
    # the control: without the formula less is seen
    without, _ = pair(kind, "0", rng, T)
    assert seen(without, T) != seen(beside, T)


def bound_to(kind: str, slope: float, more: str, T: float) -> Scene:
    """A nonlinear oscillator whose Lagrangian has formulas of t and x beside a force."""
    force = Forcing(pieces=(ForcingPiece(components=(line(kind, slope, T),)),))
    return fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"vx**2/2 - x**2/2 - x**4/4 + {more}",
        initial_position=[0.0],
        initial_velocity=[0.0],
        damping=[FractionalDamping(order=0.5, coefficient=0.2)],
        forcing=force,
        final_time=T,
    )


@spread(few=1, kind=KINDS, what=["pulse", "wall"])
def test_a_tolerance_holds_with_it(kind, what):
    T, tolerance = 6.0, 1e-6
    shapes = {
        "pulse": "x*3*exp(-((t - {at})/1e-3)**2)",
        "wall": "1e-3*tanh((x - {at})/1e-5)",
    }
    more = shapes[what].format(at=2.87 if what == "pulse" else 0.9123)
    run = fvi.solve(bound_to(kind, 0.2, more, T), tolerance=tolerance)
    exact = fvi.solve(bound_to("formula", 0.2, more, T), tolerance=1e-3 * tolerance)
    assert run.outcome == exact.outcome == "met"
    times = np.linspace(0.0, T, 200)
    assert np.abs(run(times) - exact(times)).max() <= tolerance
    # the control: it moves the system by far more than the tolerance
    without = fvi.solve(bound_to(kind, 0.2, "0*x", T), tolerance=tolerance)
    assert np.abs(without(times) - exact(times)).max() > 100 * tolerance
