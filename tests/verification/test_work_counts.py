"""Only the effects that a scene calls for are simulated: work is counted, never timed.

Every row of the plan's table has a test here, and a control in which the work does appear.
"""

import itertools
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from letters import spring, swing

import fvi_cli
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine import law
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.operator import Operator
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.loads import panels
from fvi_cli.integrator.loop import loop
from fvi_cli.integrator.memory import backward_differences, lags
from fvi_cli.integrator.memory import exponentials as states
from fvi_cli.integrator.method import Method
from fvi_cli.planning.plan import plan_run
from fvi_cli.scenes.lagrangian import lagrangian_scene

NODES = Method(cq="bdf2", degree=1, sampling="nodes")
POINTS = Method(cq="bdf4", degree=2, forcing_quadrature="exact")
GAUSS = Method(cq="gauss", degree=2, start="graded")
PLAIN = Method(cq="gauss", degree=2)
METHODS = [NODES, POINTS, GAUSS, PLAIN]


class CalledError(Exception):
    """What was not to be done is done."""


def forbid(monkeypatch, owner, name):
    def refuse(*arguments, **options):
        raise CalledError(name)

    monkeypatch.setattr(owner, name, refuse)


def watch(monkeypatch, seen, owner, name):
    original = getattr(owner, name)

    def watched(*arguments, **keywords):
        seen.append(arguments)
        return original(*arguments, **keywords)

    monkeypatch.setattr(owner, name, watched)


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
class TestWithoutDamping:
    @pytest.mark.parametrize("scene", [oscillator(), oscillator(0.5, coefficient=0.0)])
    def test_no_weights_and_no_history(self, monkeypatch, method, scene):
        forbid(monkeypatch, lags, "difference_weights")
        forbid(monkeypatch, states, "power_kernel")
        trajectory = integrate(scene, method, 600)
        assert trajectory.status == "ok"
        assert trajectory.history_operations == 0
        assert plan_run(scene, method, 600).n_directions == 0

    def test_with_damping_there_are_weights_or_states(self, monkeypatch, method):
        # never both
        needed, other = (lags, "difference_weights"), (states, "power_kernel")
        if method.is_runge_kutta:
            needed, other = other, needed
        with monkeypatch.context() as context:
            forbid(context, *other)
            assert integrate(oscillator(0.5), method, 600).history_operations > 0
        forbid(monkeypatch, *needed)
        with pytest.raises(CalledError):
            integrate(oscillator(0.5), method, 600)


@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.case)
class TestFirstOrder:
    def test_the_history_takes_a_stencil_and_no_exponentials(self, monkeypatch, method):
        forbid(monkeypatch, backward_differences, "power_kernel")
        forbid(monkeypatch, states, "power_kernel")
        works = [integrate(oscillator(1.0), method, n).history_operations for n in (2048, 4096)]
        assert works[1] <= 2 * works[0] + 4096
        # blocks count what stands in the matrices of their recurrence, whatever N
        assert works[1] <= 4096 * (0 if method.is_runge_kutta else 50)

    def test_other_orders_take_more(self, monkeypatch, method):
        works = [integrate(oscillator(0.5), method, n).history_operations for n in (2048, 4096)]
        # not more for a step that has more before it; longer blocks count more in their matrices
        assert works[0] < works[1] < 2.5 * works[0]
        owner = states if method.is_runge_kutta else backward_differences
        forbid(monkeypatch, owner, "power_kernel")
        with pytest.raises(CalledError):
            integrate(oscillator(0.5), method, 4096)


def test_the_stencil_of_first_order_is_as_long_as_the_formula():
    for order in (1, 2, 3):
        method = Method(cq=f"bdf{order}", degree=1, sampling="nodes", history="direct")
        work = integrate(oscillator(1.0), method, 1000).history_operations
        # a step of the past for each of its weights, in the force at both ends of a step
        assert work == 1000 * 2 * order


@pytest.mark.parametrize("method", [NODES, POINTS, PLAIN], ids=lambda method: method.case)
def test_scalar_terms_together_cost_as_much_as_one(method):
    one, two = oscillator(0.5), oscillator(0.5, 1.5)
    works = [integrate(scene, method, 1000).history_operations for scene in (one, two)]
    # states that serve both orders are a few more
    assert works[0] <= works[1] <= works[0] * 1.1
    assert plan_run(two, method, 1000).n_directions == 1
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
    assert plan_run(apart, method, 1000).n_directions == 2
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


class TestQuadraticPotential:
    FORMULA = "(vx**2 + vy**2)/2 - (x**2 + 2*(y - x)**2)/2"

    @pytest.mark.parametrize("method", [NODES, PLAIN], ids=lambda method: method.case)
    @pytest.mark.parametrize("n_steps", [10, 1000])
    def test_it_is_never_evaluated(self, monkeypatch, method, n_steps):
        for potential in (QuadraticPotential, ExpressionPotential):
            forbid(monkeypatch, potential, "hessian")
        forbid(monkeypatch, ExpressionPotential, "gradient")
        forbid(monkeypatch, law.Potential, "remainder")
        scene = quadratic(self.FORMULA)
        assert isinstance(scene.potential, QuadraticPotential)
        calls = []
        original = QuadraticPotential.gradient

        def counted(self, position):
            calls.append(position.shape)
            return original(self, position)

        monkeypatch.setattr(QuadraticPotential, "gradient", counted)
        trajectory = integrate(scene, method, n_steps)
        assert trajectory.status == "ok"
        if n_steps > 100:
            # the energies of the finished trajectory, all at once
            assert len(calls) <= 2
        assert trajectory.newton.iterations == 0

    def test_another_potential_is_evaluated(self, monkeypatch):
        scene = quadratic(f"{self.FORMULA} - x**4")
        assert isinstance(scene.potential, ExpressionPotential)
        forbid(monkeypatch, law.Potential, "remainder")
        with pytest.raises(CalledError):
            integrate(scene, PLAIN, 1000)


@pytest.mark.parametrize("dimension", [1, 4])
@pytest.mark.parametrize("n_steps", [3, 100, 2000])
@pytest.mark.parametrize("method", [NODES, POINTS, PLAIN], ids=lambda method: method.case)
def test_without_forcing_there_are_no_load_vectors(monkeypatch, method, dimension, n_steps):
    """Neither by blocks nor in the recurrence of one system."""
    seen: list[object] = []
    solve, recur = Engine.solve, loop.Recurrence.run

    def solved(self, state, h, count, loads, *more, **options):
        # the recurrence asks for its own columns
        if not options:
            seen.append(loads)
        return solve(self, state, h, count, loads, *more, **options)

    def recurred(self, state, blocks, loads, **options):
        seen.append(loads)
        return recur(self, state, blocks, loads, **options)

    monkeypatch.setattr(Engine, "solve", solved)
    monkeypatch.setattr(loop.Recurrence, "run", recurred)
    for text, is_driven in ((None, False), ("sin(t)", True)):
        scene = oscillator(0.5, forcing=text, dimension=dimension)
        assert integrate(scene, method, n_steps).status == "ok"
        assert seen
        assert all((one is not None) == is_driven for one in seen)
        seen.clear()


def test_a_smooth_start_is_not_graded():
    rest = spring((1.0, 0.3), T=6.0, x=1.0)
    assert "100 steps in all" in plan_run(rest, GAUSS, 100).start
    assert "100 steps in all" not in plan_run(oscillator(0.5), GAUSS, 100).start


def test_uncoupled_degrees_of_freedom_are_a_batch(monkeypatch):
    made: list[tuple[Operator, object]] = []
    watch(monkeypatch, made, Operator, "_by_impulses")
    one, four = oscillator(0.5), oscillator(0.5, dimension=4)
    plan = plan_run(four, PLAIN, 1000)
    assert (plan.systems, plan.mesh.coupled) == (4, 1)
    works = [integrate(scene, PLAIN, 1000).history_operations for scene in (one, four)]
    assert [one.at.mass.shape for one, _ in made] == [(1, 1, 1), (4, 1, 1)]
    assert works[1] <= 4 * works[0]
    works = [integrate(scene, POINTS, 1000).history_operations for scene in (one, four)]
    assert works[1] == 4 * works[0]


class TestNewton:
    def test_changes_of_single_steps_fall_quickly(self):
        """Second derivatives are made anew where they do not fall to a quarter."""
        scene = swing((0.5, 0.3), T=6.0, x=2.0)
        changes = integrate(scene, Method(cq="gauss", degree=2), 6).newton.worst_residuals
        large = [one for one in changes if one > 1e-12]
        assert len(large) >= 3
        assert all(after <= 0.3 * before for before, after in itertools.pairwise(large))

    @pytest.mark.parametrize("method", [PLAIN, POINTS], ids=["states", "increments"])
    def test_matrices_are_made_a_few_times_and_not_for_every_step(self, monkeypatch, method):
        made: list[object] = []
        watch(monkeypatch, made, Operator, "_by_impulses")
        scene = swing((0.5, 0.3), T=6.0, x=1.0)
        trajectory = integrate(scene, method, 4096)
        assert 1 <= len(made) <= 8
        assert trajectory.newton.iterations < 4096


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
from fvi_cli.scenes.named import linear_oscillator, pendulum

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
weights = Method(cq="bdf2", degree=1, start="weights")
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
    assert seen["starting weights"] == ["scipy.special"]
    assert not {"mpmath", "sympy"} & set(seen["graded"])
    assert "mpmath" not in seen["lagrangian"]
    assert "mpmath" in seen["hidden constant"]
    assert not {"h5py", "matplotlib"} & set(seen["lagrangian"])


@pytest.mark.processes
def test_modules_that_a_command_does_not_call_for_are_not_imported(tmp_path):
    (tmp_path / "a.yaml").write_text(
        "problem: {kind: frame, damping: [{order: 0.5, coefficient: 0.3}], final_time: 1.0, "
        "exact: none}\nladder: {steps: [8]}\nfigures: [trajectory]\n"
    )
    seen = seen_by(COMMANDS, cwd=tmp_path)
    assert seen["run a.yaml -q"] == seen["show results/a.h5"] == ["h5py"]
    assert set(seen["plot a.yaml -q"]) == {"h5py", "matplotlib"}


class TestGradedStarts:
    """Many sizes of steps, each for a few: what is made for a size must pay at once."""

    def test_few_blocks_take_no_recurrence(self, monkeypatch):
        made: list[int] = []
        watch(monkeypatch, made, loop.Recurrence, "run")
        integrate(oscillator(0.5, forcing="sin(t)"), GAUSS, 64)
        assert not made
        # the control: many equal steps behind the window
        integrate(oscillator(0.5, forcing="sin(t)"), GAUSS, 8192)
        assert made

    def test_points_of_the_loads_are_made_once(self, monkeypatch):
        made: list[int] = []
        panels.tested_rule.cache_clear()
        watch(monkeypatch, made, panels, "graded_edges")
        exact = Method(cq="gauss", degree=2, start="graded", forcing_quadrature="exact")
        for n_steps in (64, 128):
            integrate(oscillator(0.5, forcing="sin(t)"), exact, n_steps)
        assert len(made) == 1
