"""Scenes by name: their matrices and forces against the equations written out."""

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.registry import build_problem
from fvi_cli.scenes.structures import pluck_amplitudes

GAUSS3 = Method(cq="gauss", degree=3)


def scene_of(kind: str, **keys: object) -> Scene:
    problem = build_problem({"kind": kind, "final_time": 2.0, **keys})
    return problem.scene


def test_a_chain_is_its_equation_written_out():
    scene = scene_of("chain", masses=4, mass=2.0, stiffness=3.0, ends="left")
    x = np.array([0.3, -0.2, 0.5, 0.7])
    left = np.concatenate([[0.0], x[:-1]])
    right = np.append(x[1:], x[-1])  # the free end is not pulled
    assert scene.potential.gradient(x) == pytest.approx(3 * (2 * x - left - right), abs=1e-15)
    assert scene.inertia.mass.tolist() == (2 * np.eye(4)).tolist()


def test_a_chain_by_dampers_is_a_chain_by_directions():
    start = {"position": [1.0, 0.0, 0.5], "velocity": 0.0}
    by_key = scene_of(
        "chain", masses=3, dampers=[{"order": 0.5, "coefficient": 0.2}], initial=start
    )
    forms = ["x1", "x2 - x1", "x3 - x2", "x3"]
    by_direction = scene_of(
        "damped-oscillator",
        stiffness=[[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]],
        damping=[{"order": 0.5, "coefficient": 0.2, "acts_on": forms}],
        initial=start,
    )
    a = integrate(by_key, GAUSS3, 32).position
    b = integrate(by_direction, GAUSS3, 32).position
    assert np.abs(a - b).max() < 1e-14
    # control: without one of the dampers the motion is another
    fewer = scene_of(
        "damped-oscillator",
        stiffness=[[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]],
        damping=[{"order": 0.5, "coefficient": 0.2, "acts_on": forms[:3]}],
        initial=start,
    )
    assert np.abs(integrate(fewer, GAUSS3, 32).position - a).max() > 1e-3


def test_a_free_chain_keeps_its_momentum_with_dampers_inside():
    scene = scene_of(
        "chain",
        masses=5,
        ends="none",
        dampers=[{"order": 0.5, "coefficient": 0.4}],
        initial={"position": 0.0, "velocity": [1.0, 0.0, 0.0, 0.0, -0.3]},
    )
    momentum = integrate(scene, GAUSS3, 32).momentum
    assert momentum.sum(axis=1) == pytest.approx(np.full(33, 0.7), abs=1e-13)


def test_a_frame_is_its_equation_written_out():
    scene = scene_of(
        "frame",
        storeys=3,
        mass=[1.2, 1.0, 0.8],
        stiffness=[12.0, 10.0, 8.0],
        dampers=[{"order": 0.5, "coefficient": 0.5}],
        ground_acceleration="sin(t)",
    )
    x = np.array([0.1, 0.3, -0.2])
    shear = np.array([12.0, 10.0, 8.0]) * np.diff(x, prepend=0.0)
    assert scene.potential.gradient(x) == pytest.approx(shear - np.append(shear[1:], 0.0))
    assert scene.forcing is not None
    assert scene.forcing(np.array(0.7)) == pytest.approx(-np.array([1.2, 1.0, 0.8]) * np.sin(0.7))
    drag = 0.5 * np.diff(x, prepend=0.0)
    assert scene.damping[0].matrix @ x == pytest.approx(drag - np.append(drag[1:], 0.0))


def test_a_frame_seen_from_outside_of_the_ground():
    # a = g'' with g = t^4: y = x + g obeys m y'' + k (y - g) = 0
    scene = scene_of("frame", storeys=1, stiffness=4.0, ground_acceleration="12*t**2")
    other = scene_of("damped-oscillator", stiffness=4.0, forcing="4*t**4")
    x = integrate(scene, GAUSS3, 64)
    y = integrate(other, GAUSS3, 64)
    assert x.position[:, 0] + x.time**4 == pytest.approx(y.position[:, 0], abs=1e-8)


def test_a_plucked_string_is_the_triangle():
    q = pluck_amplitudes(4000, 0.3, 0.1)
    s = np.array([0.1, 0.3, 0.6, 0.9])
    shape = q @ np.sin(np.outer(np.arange(1, 4001) * np.pi, s))
    assert shape == pytest.approx([0.1 / 3, 0.1, 0.4 / 7, 0.1 / 7], abs=2e-5)


def test_a_string_has_the_frequencies_of_its_equation():
    scene = scene_of(
        "string",
        modes=3,
        wave_speed=2.0,
        length=0.5,
        damping=[{"order": 1.0, "coefficient": 0.1}],
        internal_damping=[{"order": 0.5, "coefficient": 0.01}],
    )
    waves = np.array([1, 2, 3]) * np.pi / 0.5
    assert scene.potential.gradient(np.ones(3)) == pytest.approx((2 * waves) ** 2)
    assert np.diag(scene.damping[1].matrix) == pytest.approx(0.01 * waves**2)
    assert np.diag(scene.damping[0].matrix) == pytest.approx(0.1 * np.ones(3))


@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        ("duffing", {"stiffness": -1.0, "cubic_stiffness": 0.7, "mass": 2.0}),
        ("kepler", {"attraction": 1.3, "initial": {"position": [1.0, 0.0], "velocity": 0.0}}),
    ],
)
def test_gradient_and_hessian_are_derivatives_of_the_energy(kind, keys):
    scene = scene_of(kind, **keys)
    potential = scene.potential
    d = scene.dimension
    q = np.array([0.7, -0.4])[:d]
    step = 1e-5
    for i, unit in enumerate(np.eye(d)):
        up, down = q + step * unit, q - step * unit
        slope = (potential.energy(up) - potential.energy(down)) / (2 * step)
        assert potential.gradient(q)[i] == pytest.approx(slope, rel=1e-8)
        curvature = (potential.gradient(up) - potential.gradient(down)) / (2 * step)
        assert potential.hessian(q)[i] == pytest.approx(curvature, rel=1e-8)


def test_a_pattern_of_the_ground_is_that_of_every_node():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(6, 6))
    keys = {"mass": root @ root.T + np.eye(6), "stiffness": 9.0 * np.eye(6), "final_time": 1.0}
    keys["ground_acceleration"] = "sin(3*t)"
    times = np.linspace(0.0, 1.0, 5)
    alike = [fvi.structure(**keys, ground_direction=r) for r in ([1, 0], [1, 0, 1, 0, 1, 0])]
    found, known = (scene.forcing(times) for scene in alike)
    assert np.array_equal(found, known)
    other = fvi.structure(**keys, ground_direction=1.0).forcing(times)
    assert np.abs(other - found).max() > 0.1
    with pytest.raises(ValueError, match="ground_direction: 4 entries for 6 degrees"):
        fvi.structure(**keys, ground_direction=[1, 0, 0, 1])
