"""Works and energy balance: exact where promised, of the method's order elsewhere.

With none nothing of it is computed.
"""

import dataclasses

import numpy as np
import pytest
from letters import in_pieces, spring, swing
from oracles.linear_response import match_scene
from spread import spread

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.registry import build_problem

GAUSS2 = Method(cq="gauss", degree=2, start="none")
GAUSS2_GRADED = Method(cq="gauss", degree=2, start="graded")
GAUSS3_GRADED = Method(cq="gauss", degree=3, start="graded")
MIDPOINT_NODES = Method(cq="bdf2", degree=1, sampling="nodes")
NODES = Method(cq="bdf3", degree=2, sampling="nodes")
POINTS = Method(cq="bdf4", degree=2, sampling="points", start="none")


def scene_of(**specification):
    return build_problem(specification).scene


def oscillator(order, forcing="cos(t)"):
    return spring((order, 0.7), T=8.0, k=2.0, x=1.0, v=0.5, forcing=forcing)


def two_masses(derivative="caputo"):
    return scene_of(
        kind="bagley-torvik",
        mass=[[2.0, 0.5], [0.5, 1.0]],
        stiffness=[[2.0, -1.0], [-1.0, 2.0]],
        damping=[
            {"order": 0.5, "coefficient": [[0.7, 0.2], [0.2, 0.3]]},
            {"order": 0.8, "coefficient": 0.1},
        ],
        derivative=derivative,
        forcing={"pieces": [{"until": 1.0, "value": ["8", "t"]}, {"value": ["0", "1"]}]},
        initial={"position": [1.0, 0.0], "velocity": [0.0, 0.5]},
        final_time=4.0,
    )


def struck_plate():
    return spring((1.5, 0.7), T=4.0, x=1.0, v=0.5, forcing=in_pieces("8", 1.0, "0"))


def kepler(mu):
    return scene_of(
        kind="kepler",
        damping=[{"order": 0.5, "coefficient": mu}] if mu else [],
        initial={"position": [1.0, 0.0], "velocity": [0.0, 0.8]},
        final_time=8.0,
    )


def double_pendulum():
    return scene_of(
        kind="double-pendulum",
        joints=[{"order": 0.5, "coefficient": 0.2}],
        initial={"position": [1.0, -0.5], "velocity": 0.0},
        final_time=4.0,
    )


def changing_lagrangian():
    return scene_of(
        kind="lagrangian",
        coordinates=["x"],
        parameters={},
        lagrangian="(1 + x**2)*vx**2/2*(1 + t/10) - x**2*(2 + sin(t))",
        damping=[{"order": 0.5, "coefficient": 0.3}],
        initial={"position": 1.0, "velocity": 0.0},
        final_time=4.0,
    )


def pendulum():
    return swing((0.5, 0.3), T=10.0, x=1.0)


def diagnosed(scene, method, n_steps):
    asked = True
    return integrate(scene, method, n_steps, diagnostics=asked).diagnostics


@spread(method=[GAUSS2, MIDPOINT_NODES, NODES, POINTS], order=[0.5, 1.0, 1.5])
def test_energy_balance_is_exact_on_linear_scenes(method, order):
    found = diagnosed(oscillator(order), method, 64)
    assert np.abs(found.energy_defect).max() < 1e-14
    # the works themselves are large, and leaving one out does not balance
    assert found.dissipated_work[-1] > 0.5
    without = found.energy_defect - found.dissipated_work
    assert np.abs(without).max() > 0.5


def test_energy_balance_of_kicks_is_exact_beyond_one_mass_one_term_and_jumps():
    scene = two_masses()
    for method in (
        MIDPOINT_NODES,
        dataclasses.replace(NODES, start="weights", start_exponents=(1.0,)),
    ):
        found = diagnosed(scene, method, 64)
        assert np.abs(found.energy_defect).max() < 5e-14 * np.abs(found.forcing_work).max()


@spread(
    method=[GAUSS2_GRADED, GAUSS3_GRADED],
    scene=[
        oscillator(0.5),
        oscillator(1.5),
        two_masses(),
        struck_plate(),
        oscillator(0.5, forcing="sqrt(t)"),
    ],
)
def test_energy_balance_is_exact_on_graded_meshes(scene, method):
    found = diagnosed(scene, method, 64)
    assert np.abs(found.energy_defect).max() < 1e-13 * max(1.0, np.abs(found.forcing_work).max())
    assert found.dissipated_work[-1] > 1e-3


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("name", "scene", "method", "steps", "order"),
    [
        ("pendulum", pendulum(), GAUSS2_GRADED, 128, 4),
        ("pendulum", pendulum(), GAUSS3_GRADED, 64, 6),
        ("pendulum", pendulum(), MIDPOINT_NODES, 64, 2),
        ("double pendulum", double_pendulum(), GAUSS2_GRADED, 64, 4),
        ("double pendulum", double_pendulum(), GAUSS3_GRADED, 64, 6),
        ("double pendulum", double_pendulum(), MIDPOINT_NODES, 64, 2),
        ("dL/dt", changing_lagrangian(), GAUSS2_GRADED, 64, 4),
        ("dL/dt", changing_lagrangian(), GAUSS3_GRADED, 64, 6),
        ("kepler", kepler(0.05), GAUSS3_GRADED, 256, 6),
    ],
    ids=lambda value: getattr(value, "case", str(value))[:40] if value is not None else "",
)
def test_energy_defect_falls_with_the_order_of_the_method(name, scene, method, steps, order):
    coarse, fine = (
        np.abs(diagnosed(scene, method, n).energy_defect).max() for n in (steps, 2 * steps)
    )
    assert abs(np.log2(coarse / fine) - order) < 0.2, name


@pytest.mark.parametrize("order", [0.5, 1.5])
def test_works_are_those_of_the_exact_motion(order):
    """Against the closed form: W_f by quadrature of x' f, W_d from the exact energy."""
    specification = {
        "kind": "damped-oscillator",
        "stiffness": 2.0,
        "damping": [{"order": order, "coefficient": 0.7}],
        "forcing": "t - t**2/10",
        "initial": {"position": 1.0, "velocity": 0.5},
        "final_time": 8.0,
    }
    problem = build_problem(specification)
    # x' by integration by parts: W_f = [x f] - int x f'
    time = np.linspace(0.0, 8.0, 4097)
    position = match_scene(problem.scene).position(time)[:, 0]
    pulled = position * (1 - time / 5)
    simpson = (time[1] / 3) * (
        pulled[0] + pulled[-1] + 4 * pulled[1:-1:2].sum() + 2 * pulled[2:-1:2].sum()
    )
    exact_work = position[-1] * 1.6 - simpson
    asked = True
    trajectory = integrate(problem.scene, GAUSS3_GRADED, 256, diagnostics=asked)
    found = trajectory.diagnostics
    assert found.forcing_work[-1] == pytest.approx(exact_work, abs=1e-9)
    energies = trajectory.energy
    assert found.dissipated_work[-1] == pytest.approx(
        exact_work + energies[0] - energies[-1], abs=1e-9
    )


def test_asking_changes_the_motion_by_round_off_only_and_is_thinned_with_it():
    scene, asked = oscillator(0.5), True
    plain = integrate(scene, GAUSS3_GRADED, 256)
    with_more = integrate(scene, GAUSS3_GRADED, 256, diagnostics=asked)
    assert np.abs(plain.position - with_more.position).max() < 1e-13
    thin = integrate(scene, GAUSS3_GRADED, 256, every=100, diagnostics=asked)
    assert thin.time.size == thin.diagnostics.energy_defect.size == 4
    assert thin.diagnostics.dissipated_work[-1] == with_more.diagnostics.dissipated_work[-1]


@spread(
    method=[GAUSS2, POINTS], **{"derivative, slope": [("riemann-liouville", 0.8), ("caputo", None)]}
)
def test_the_work_of_an_unbounded_force_without_a_series(method, derivative, slope):
    """A force t^-0.6 from an initial position: the defect falls like h^(2 - 1.2)."""
    scene = spring((0.6, 0.7), T=2.0, x=1.0, v=0.5, derivative=derivative)
    defects = []
    for n_steps in (64, 128):
        found = integrate(scene, method, n_steps, diagnostics=True)
        defects.append(abs(found.diagnostics.energy_defect[-1]))
    if slope is None:
        assert max(defects) < 1e-12
    else:
        assert np.log2(defects[0] / defects[1]) == pytest.approx(slope, abs=0.05)
