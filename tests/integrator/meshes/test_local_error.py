"""What a step is believed for: forces that its stages do not see."""

import numpy as np
from letters import spring, swing
from oracles.volterra import solve_volterra
from spread import spread

import fvi_cli as fvi
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import ForceComponent, Forcing, ForcingPiece
from fvi_cli.effects.sampled import FunctionForce, SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes import looks
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.expressions import Expression


def run(scene: Scene, tolerance: float, m: int = 6) -> Trajectory:
    found = integrate(
        scene, Method(cq="gauss", degree=m), AdaptiveSteps(tolerance=tolerance), with_steps=True
    )
    assert found.status == "ok"
    return found


def one_coordinate(lagrangian: str, position: float, velocity: float, T: float, **more) -> Scene:
    return fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian=lagrangian,
        initial_position=[position],
        initial_velocity=[velocity],
        final_time=T,
        **more,
    )


def test_no_more_steps_on_smooth_scenes():
    """Steps that the Legendre tail alone took."""
    scene = swing((0.5, np.array([[0.3]])), T=20.0, x=1.0)
    assert [run(scene, tol).n_steps for tol in (1e-4, 1e-6, 1e-8)] <= [25, 41, 68]


def test_what_a_pulse_moves_is_met_and_not_without_the_looks(monkeypatch):
    middle, width, tolerance = 2.879, 0.000306, 6.8e-6
    force = f"2*(1 - tanh((t - {middle})/{width})**2)"
    scene = spring((1.648, 0.86), k=1.0, T=8.0, forcing=force)
    found = fvi.solve(scene, tolerance=tolerance)
    # at rest before: the same motion, later
    lead = 20 * width
    known = solve_volterra(
        1.0,
        [(1.648, 0.86)],
        lambda x: x,
        lambda x: np.ones((len(x), 1, 1)),
        lambda t: 2.0 / np.cosh(np.clip((t - lead) / width, -300.0, 300.0))[:, None] ** 2,
        [0.0],
        [0.0],
        8.0 - middle + lead,
        tolerance=1e-12,
    )
    times = np.linspace(middle - lead, 8.0, 300)
    right = known.position(times - times[0])
    assert np.abs(right).max() > 2e-4
    assert found.met
    assert np.abs(found(times) - right).max() <= tolerance
    monkeypatch.setattr(looks.Looks, "missed", lambda *arguments: np.zeros(1))
    blind = fvi.solve(scene, tolerance=tolerance)
    assert blind.met
    assert np.abs(blind.position).max() < 0.01 * 2e-4


def line(kind: str, slope: float, T: float) -> ForceComponent:
    """A straight line that begins at 1."""
    if kind == "samples":
        times = np.linspace(0.0, T, 25)
        return SampledForce.through(times, 1.0 + slope * times, "linear")
    if kind == "function":
        return FunctionForce(function=lambda t: 1.0 + slope * t)
    return Expression.parse(f"1 + {slope!r}*t", variables=("t",))


@spread(few=1, kind=("samples", "function"), what=["pulse", "wall"])
def test_a_tolerance_holds_beside_samples_and_functions(kind, what):
    T, tolerance = 6.0, 1e-6
    more = {
        "pulse": "x*3*exp(-((t - 2.87)/4e-3)**2)",
        "wall": "1e-3*tanh((x - 0.9123)/1e-2)",
    }[what]

    def solve(kind: str, more: str, tolerance: float) -> Trajectory:
        force = Forcing(pieces=(ForcingPiece(components=(line(kind, 0.2, T),)),))
        damping = [FractionalDamping(order=0.5, coefficient=0.2)]
        scene = one_coordinate(
            f"vx**2/2 - x**2/2 - x**4/4 + {more}", 0.0, 0.0, T, damping=damping, forcing=force
        )
        return fvi.solve(scene, tolerance=tolerance)

    found, exact = solve(kind, more, tolerance), solve("formula", more, 1e-3 * tolerance)
    assert found.met
    assert exact.met
    times = np.linspace(0.0, T, 200)
    assert np.abs(found(times) - exact(times)).max() <= tolerance
    # the control: it moves the system by far more than the tolerance
    assert np.abs(solve(kind, "0*x", tolerance)(times) - exact(times)).max() > 100 * tolerance
