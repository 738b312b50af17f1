"""Modes and harmonic responses against closed forms, long runs, and each other."""

import math
import tracemalloc
from dataclasses import replace

import h5py
import numpy as np
import pytest
from command_line import configuration, fvi, rows_of
from oracles.sandwich_beam import SIZES, beam_matrices, sandwich_beam
from scipy.io import mmwrite
from scipy.sparse import coo_array

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.laws import Law, prony
from fvi_cli.effects.matrices import Form
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness
from fvi_cli.studies.vibration.modes import ModeTable, count_modes, find_modes
from fvi_cli.studies.vibration.response import harmonic_response


def linear_scene(
    mass: Form, stiffness: Form, *forces: FractionalDamping | Law, time: float = 1.0
) -> Scene:
    d = mass.shape[0]
    return Scene(
        inertia=Inertia(mass=mass),
        potential=QuadraticPotential(stiffness=stiffness),
        damping=tuple(one for one in forces if isinstance(one, FractionalDamping)),
        laws=tuple(one for one in forces if isinstance(one, Law)),
        initial_position=np.zeros(d),
        initial_velocity=np.zeros(d),
        final_time=time,
    )


def sandwich(elements: int) -> Scene:
    return sandwich_beam(elements, final_time=0.1)


@pytest.fixture(scope="module")
def beam_modes() -> ModeTable:
    return find_modes(sandwich(42), 10)


def test_ten_modes_of_a_sandwich_beam(beam_modes):
    assert len(beam_modes.coordinates) == 168
    assert len(beam_modes.modes) == beam_modes.inside == beam_modes.counted == 10
    assert max(mode.residual for mode in beam_modes.modes) < 1e-12
    first = beam_modes.modes[0]
    # at the loss factor that the half-power bandwidth of a light damper tells
    assert first.hertz == pytest.approx(66.37, abs=0.02)
    assert first.loss_factor == pytest.approx(0.2017, abs=1e-3)
    # the matrix times the shape, written out once more
    scene = sandwich(42)
    s = first.frequency
    (law,) = scene.laws
    left = s**2 * scene.inertia.mass + scene.potential.stiffness + law.symbol(s) * law.matrix
    assert np.abs(left @ first.shape).max() < 1e-13 * np.abs(left).max()


def test_a_mode_that_is_left_out_is_missed_by_the_count(beam_modes):
    stiffness, whole = DynamicStiffness(sandwich(42)), beam_modes.region
    sizes = [abs(mode.frequency) for mode in beam_modes.modes]
    for index in (1, 4, 8):
        between = math.sqrt(sizes[index - 1] * sizes[index])
        assert count_modes(stiffness, replace(whole, largest=between)) == index


def test_modes_near_a_frequency_are_those_in_the_middle(beam_modes):
    wanted = beam_modes.modes[4]
    table = find_modes(sandwich(42), 2, near=abs(wanted.frequency) / (2 * math.pi))
    assert table.is_complete
    assert min(abs(m.frequency - wanted.frequency) for m in table.modes) < 1e-8 * abs(
        wanted.frequency
    )


MASS2, STIFFNESS2 = np.diag([1.0, 0.7]), np.array([[3.0, -1.0], [-1.0, 2.0]])
DAMPING2 = np.array([[0.6, -0.2], [-0.2, 0.5]])


@pytest.mark.parametrize(
    ("forces", "periods"),
    [
        # what a start from rest leaves behind falls like t**(-5/2)
        ((FractionalDamping(order=1.5, coefficient=DAMPING2),), 400),
        ((prony(moduli=[1.0, 0.5], times=[0.3, 1.0], relaxed=0.5, coefficient=DAMPING2),), 80),
    ],
    ids=["springpot", "prony"],
)
def test_a_steady_response_is_what_a_long_run_ends_in(forces, periods):
    omega, per_period = 1.3, 16
    final = periods * 2 * math.pi / omega
    resting = linear_scene(MASS2, STIFFNESS2, *forces, time=final)
    scene = replace(resting, forcing=Forcing.from_text(f"cos({omega!r}*t)", "0"))
    trajectory = integrate(
        scene, Method(cq="gauss", degree=4, start="graded"), periods * per_period
    )
    table = harmonic_response(
        resting,
        np.array([1.0, 0.0]),
        np.array([0.5, 1.0, 1.5]) * omega / (2 * math.pi),
        outputs=("x1", "x2"),
        rows=np.eye(2),
    )
    late = trajectory.time > 0.99 * final
    expected = (np.exp(1j * omega * trajectory.time[late])[:, None] * table.values[1]).real
    assert np.abs(trajectory.position[late] - expected).max() < 1e-8


@pytest.mark.parametrize("order", [1.0, 0.6])
def test_a_steady_response_is_the_sum_over_modes_of_proportional_damping(order):
    rng = np.random.default_rng(4)
    root = rng.standard_normal((5, 5))
    mass, stiffness = np.diag(rng.uniform(1.0, 2.0, 5)), root @ root.T + 5 * np.eye(5)
    damping = 0.1 * mass + 0.02 * stiffness
    scene = linear_scene(mass, stiffness, FractionalDamping(order=order, coefficient=damping))
    load, hertz = rng.standard_normal(5), np.linspace(0.05, 1.0, 40)
    table = harmonic_response(
        scene, load, hertz, outputs=[f"x{i}" for i in range(1, 6)], rows=np.eye(5)
    )
    lower = np.linalg.inv(np.linalg.cholesky(mass))
    squares, vectors = np.linalg.eigh(lower @ stiffness @ lower.T)
    shapes = lower.T @ vectors
    omega = 2 * np.pi * hertz[:, None]
    gains = (load @ shapes) / (squares - omega**2 + (1j * omega) ** order * (0.1 + 0.02 * squares))
    assert np.abs(table.values - gains @ shapes.T).max() < 1e-12


@pytest.mark.slow
def test_nothing_of_size_d_by_d_is_made_for_modes_and_responses():
    def work(scene: Scene) -> None:
        assert find_modes(scene, 2).is_complete
        load = np.eye(1, scene.dimension, scene.dimension - 4)
        hertz = np.array([60.0, 66.0, 70.0])
        harmonic_response(scene, load[0], hertz, outputs=["w"], rows=load)

    work(sandwich(20))
    scene, d = sandwich(560), 2240
    tracemalloc.start()
    try:
        work(scene)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 0.3 * 8 * d * d


def test_the_commands_from_three_exported_files(tmp_path):
    mass, faces, core = beam_matrices(4, **SIZES)
    for name, form in (("M", mass), ("K", faces), ("C", core)):
        mmwrite(tmp_path / f"{name}.mtx", coo_array(form), symmetry="symmetric", precision=17)
    config = tmp_path / "beam.yaml"
    problem = (
        "kind: structure, mass: {file: M.mtx}, stiffness: {file: K.mtx}, "
        "damping: [{order: 0.6, coefficient: {file: C.mtx}}], final_time: 0.01, exact: none"
    )
    config.write_text(configuration(problem, name="beam", steps="16"))
    output = tmp_path / "out"
    told = fvi("modes", config, "--count", "4", "-o", output, code=0).stdout
    assert "None is missing" in told
    rows = rows_of(output / "tables" / "beam-modes.csv")
    columns = "experiment,mode,real,imaginary,frequency_hz,damping_ratio,loss_factor,residual"
    assert ",".join(rows[0]) == columns
    assert len(rows) == 4
    with h5py.File(output / "beam-modes.h5") as stored:
        group = stored["beam"]
        assert group["shape_real"].shape == (4, 16)
        assert group["frequency_hz"][0] == pytest.approx(float(rows[0]["frequency_hz"]))
        assert group["shape_real"].dims[1][0].name == "/beam/dof"
    assert (output / "figures" / "beam-modes.png").stat().st_size > 1000
    fvi("modes", config, "--count", "4", "-o", output, "--check", code=0)
    frequency = f"{0.5 * float(rows[0]['frequency_hz'])}:{float(rows[1]['frequency_hz'])}:20"
    asked = ("response", config, "--frequency", frequency, "--force", "x13", "-o", output)
    told = fvi(*asked, code=0).stdout
    assert "Load: x13" in told
    assert (output / "tables" / "beam-response.csv").is_file()
    assert (output / "figures" / "beam-response.png").stat().st_size > 1000
