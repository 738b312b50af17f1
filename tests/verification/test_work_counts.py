"""Only the effects that a scene calls for are simulated: work is counted, never timed.

Every test has a control in which the work does appear.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from letters import spring

import fvi_cli
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.memory.damping import pattern_of
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import engine_for, mesh_for
from fvi_cli.scenes.lagrangian import lagrangian_scene

NODES = Method(cq="bdf2", degree=1, sampling="nodes")
POINTS = Method(cq="bdf4", degree=2, forcing_quadrature="exact")
GAUSS = Method(cq="gauss", degree=2, start="graded")
PLAIN = Method(cq="gauss", degree=2)
METHODS = [NODES, POINTS, GAUSS, PLAIN]


def oscillator(
    *orders: float, forcing: str | None = None, dimension: int = 1, coefficient: float = 0.3
) -> Scene:
    return spring(
        *((order, coefficient * np.eye(dimension)) for order in orders),
        T=6.0,
        m=np.eye(dimension),
        k=np.diag(np.linspace(1.0, 2.0, dimension)),
        x=np.ones(dimension),
        v=np.zeros(dimension),
        forcing=None if forcing is None else Forcing.from_text(*[forcing] * dimension),
    )


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.case)
class TestDamping:
    @pytest.mark.parametrize("scene", [oscillator(), oscillator(0.5, coefficient=0.0)])
    def test_without_it_there_is_no_history(self, method, scene):
        trajectory = integrate(scene, method, 600)
        assert trajectory.status == "ok"
        assert trajectory.history_operations == 0
        assert not pattern_of(scene)
        assert integrate(oscillator(0.5), method, 600).history_operations > 0

    def test_of_first_order_takes_a_stencil_and_others_more(self, method):
        works = [integrate(oscillator(1.0), method, n).history_operations for n in (2048, 4096)]
        assert works[1] <= 2 * works[0] + 4096
        # blocks count what stands in the matrices of their recurrence, whatever N
        assert works[1] <= 4096 * (0 if method.is_runge_kutta else 50)
        works = [integrate(oscillator(0.5), method, n).history_operations for n in (2048, 4096)]
        # not more for a step that has more before it; longer blocks count more in their matrices
        assert works[0] < works[1] < 2.5 * works[0]


def test_the_stencil_of_first_order_is_as_long_as_the_formula():
    for order in (1, 2, 3):
        method = Method(cq=f"bdf{order}", degree=1, sampling="nodes")
        work = integrate(oscillator(1.0), method, 1000).history_operations
        # a step of the past for each of its weights, in the force at both ends of a step
        assert work == 1000 * 2 * order


@pytest.mark.parametrize("method", [NODES, POINTS, PLAIN], ids=lambda method: method.case)
def test_scalar_terms_together_cost_as_much_as_one(method):
    one, two = oscillator(0.5), oscillator(0.5, 1.5)
    works = [integrate(scene, method, 1000).history_operations for scene in (one, two)]
    # states that serve both orders are a few more
    assert works[0] <= works[1] <= works[0] * 1.1
    assert len(pattern_of(two)) == 1
    # the control: different matrices have a sum each
    apart = spring(
        (0.5, np.diag([1.0, 0.5])),
        (1.5, np.diag([0.5, 1.0])),
        T=6.0,
        m=np.eye(2),
        k=np.eye(2),
        x=np.ones(2),
        v=np.zeros(2),
    )
    assert len(pattern_of(apart)) == 2
    assert integrate(apart, method, 300).history_operations > (
        integrate(oscillator(0.5, dimension=2), method, 300).history_operations
    )


@pytest.mark.parametrize("method", [NODES, POINTS], ids=lambda method: method.case)
def test_a_start_velocity_that_is_subtracted_is_one_column_more(method):
    def work(order: float, d: int, velocity: float) -> int:
        forms = {"m": np.diag([1.0, 2.0, 4.0][:d]), "k": np.diag([1.0, 2.0, 3.0][:d])}
        damping, start = (order, np.ones((d, d)) + np.eye(d)), velocity * np.ones(d)
        scene = spring(damping, T=6.0, x=np.zeros(d), v=start, **forms)
        return integrate(scene, method, 300).history_operations

    for d in (1, 3):
        assert d * work(1.5, d, 1.0) == (d + 1) * work(1.5, d, 0.0) > 0
        # the control: below order 1 none is subtracted
        assert work(0.5, d, 1.0) == work(0.5, d, 0.0)


def quadratic(lagrangian: str) -> Scene:
    return lagrangian_scene(
        final_time=6.0,
        coordinates=("x", "y"),
        lagrangian=lagrangian,
        damping=[FractionalDamping(order=0.5, coefficient=0.3 * np.eye(2))],
        initial_position=[1.0, 0.5],
        initial_velocity=[0.0, 0.0],
    )


@pytest.mark.parametrize("method", [NODES, PLAIN], ids=lambda method: method.case)
@pytest.mark.parametrize("n_steps", [10, 1000])
def test_quadratic_potentials_take_no_iterations(method, n_steps):
    formula = "(vx**2 + vy**2)/2 - (x**2 + 2*(y - x)**2)/2"
    scene = quadratic(formula)
    assert isinstance(scene.potential, QuadraticPotential)
    trajectory = integrate(scene, method, n_steps)
    assert trajectory.status == "ok"
    assert trajectory.newton.iterations == 0
    # control: another potential
    other = quadratic(f"{formula} - x**4")
    assert isinstance(other.potential, ExpressionPotential)
    assert integrate(other, method, n_steps).newton.iterations > 0


def test_a_smooth_start_is_not_graded():
    rest = spring((1.0, 0.3), T=6.0, x=1.0)
    assert mesh_for(rest, GAUSS, 100).n_steps == 100
    assert mesh_for(oscillator(0.5), GAUSS, 100).n_steps > 100


def test_uncoupled_degrees_of_freedom_are_a_batch():
    one, four = oscillator(0.5), oscillator(0.5, dimension=4)
    engine = engine_for([four], PLAIN, mesh_for(four, PLAIN, 1000))
    assert (engine.width, engine.e) == (4, 1)
    works = [integrate(scene, PLAIN, 1000).history_operations for scene in (one, four)]
    assert works[1] <= 4 * works[0]
    works = [integrate(scene, POINTS, 1000).history_operations for scene in (one, four)]
    assert works[1] == 4 * works[0]


CHILD = """
import json, sys
from pathlib import Path

WATCHED = ("h5py", "matplotlib", "mpmath", "scipy.special", "sympy", "yaml", "typer")

def note(name):
    seen[name] = [module for module in WATCHED if module in sys.modules]

seen = {}
import numpy as np
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.data import pendulum
from fvi_cli.scenes.structures import linear_oscillator

def oscillate(*orders, **options):
    damping = [FractionalDamping(order=order, coefficient=0.3) for order in orders]
    return linear_oscillator(final_time=6.0, damping=damping, initial_position=1.0, **options)

nodes = Method(cq="bdf2", degree=1, sampling="nodes")
gauss = Method(cq="gauss", degree=2)
graded = Method(cq="gauss", degree=2, start="graded")
integrate(oscillate(), graded, 500); note("undamped")
integrate(oscillate(1.0), graded, 500); note("first order")
integrate(oscillate(0.5), nodes, 5000); note("nodes")
integrate(oscillate(0.5), gauss, 5000); note("equal steps")
swing = pendulum(final_time=6.0, damping=oscillate(0.5).damping, initial_position=1.0)
integrate(swing, gauss, 500); note("pendulum")
integrate(oscillate(0.5), graded, 500); note("graded")
weights = Method(cq="bdf2", degree=1, start="weights", start_exponents=(1.0,))
integrate(oscillate(0.5), weights, 50); note("starting weights")
from fvi_cli.scenes.lagrangian import lagrangian_scene
integrate(lagrangian_scene(final_time=1.0, coordinates=("x",), lagrangian="vx**2 - x**2"), gauss, 9)
note("lagrangian")
hidden = "((cos(x)*vx)**2 + (sin(x)*vx)**2)/2 - x**2"
lagrangian_scene(final_time=1.0, coordinates=("x",), lagrangian=hidden)
note("hidden constant")
print(json.dumps(seen))
"""

COMMANDS = """
import json, sys
from typer.testing import CliRunner
from fvi_cli.cli.app import app
WATCHED = ("h5py", "matplotlib", "mpmath", "sympy", "distributed")
seen = {}
for command in (["run", "a.yaml", "-q"], ["show", "results/a.h5"], ["plot", "a.yaml", "-q"]):
    result = CliRunner().invoke(app(command), command)
    assert result.exit_code == 0, result.output
    seen[" ".join(command)] = [module for module in WATCHED if module in sys.modules]
print(json.dumps(seen))
"""


def seen_by(code, **options):
    # the package that is tested here, from a checkout as well
    package = str(Path(fvi_cli.__file__).parents[1])
    path = os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), package]))
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": path},
        **options,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.processes
def test_modules_that_a_scene_does_not_call_for_are_not_imported():
    seen = seen_by(CHILD)
    for kind in ("undamped", "first order", "nodes", "equal steps", "pendulum"):
        assert seen[kind] == [], kind
    # the controls: what is called for is there
    assert "scipy.special" in seen["starting weights"]
    assert not {"mpmath", "sympy"} & set(seen["graded"])
    assert not {"h5py", "matplotlib"} & set(seen["hidden constant"])


@pytest.mark.processes
def test_modules_that_a_command_does_not_call_for_are_not_imported(tmp_path):
    (tmp_path / "a.yaml").write_text(
        "problem: {kind: frame, damping: [{order: 0.5, coefficient: 0.3}], final_time: 1.0, "
        "exact: none}\nladder: {steps: [8]}\nfigures: [trajectory]\n"
    )
    seen = seen_by(COMMANDS, cwd=tmp_path)
    assert seen["run a.yaml -q"] == seen["show results/a.h5"] == ["h5py"]
    assert set(seen["plot a.yaml -q"]) == {"h5py", "matplotlib"}
