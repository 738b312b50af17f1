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
    assert trajectory.newton_iterations == 0
    # control: another potential
    other = quadratic(f"{formula} - x**4")
    assert isinstance(other.potential, ExpressionPotential)
    assert integrate(other, method, n_steps).newton_iterations > 0


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


@pytest.mark.processes
def test_modules_that_a_command_does_not_call_for_are_not_imported(tmp_path):
    (tmp_path / "a.yaml").write_text(
        "problem: {kind: frame, damping: [{order: 0.5, coefficient: 0.3}], final_time: 1.0, "
        "exact: none}\nladder: {steps: [8]}\nfigures: [trajectory]\n"
    )
    # the package that is tested here, from a checkout as well
    path = os.pathsep.join(
        [str(Path(fvi_cli.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    )
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS],
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
    )
    seen = json.loads(done.stdout.splitlines()[-1])
    assert seen["run a.yaml -q"] == seen["show results/a.h5"] == ["h5py"]
    assert set(seen["plot a.yaml -q"]) == {"h5py", "matplotlib"}
