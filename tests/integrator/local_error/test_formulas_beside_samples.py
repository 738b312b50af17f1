"""A tolerance holds where a formula of the motion stands beside samples or a function."""

import numpy as np
from spread import spread

import fvi_cli as fvi
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece
from fvi_cli.effects.sampled import FunctionForce, SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.expressions import Expression

KINDS = ("samples", "function")


def line(kind: str, slope: float, T: float) -> ForceComponent:
    """A straight line that begins at 1."""
    if kind == "samples":
        times = np.linspace(0.0, T, 25)
        return SampledForce.through(times, 1.0 + slope * times, "linear")
    if kind == "function":
        return FunctionForce(function=lambda t: 1.0 + slope * t)
    return Expression.parse(f"1 + {slope!r}*t", variables=("t",))


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
        "pulse": "x*3*exp(-((t - {at})/4e-3)**2)",
        "wall": "1e-3*tanh((x - {at})/1e-2)",
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
