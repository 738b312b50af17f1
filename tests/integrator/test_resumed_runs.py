"""A run that was stopped, and stopped again, ends in the bits of one that never was."""

import io
from dataclasses import asdict, replace

import numpy as np
import pytest
from kept_checkpoints import Kept, StoppedError
from letters import in_pieces, observe_one, spring, swing
from spread import spread

import fvi_cli as fvi
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.observations.request import observations
from fvi_cli.integrator.run import loop
from fvi_cli.integrator.run.checkpoint import OF_ANOTHER_RUN, Checkpoint
from fvi_cli.integrator.run.on_mesh import integrate_scenes, mesh_for
from fvi_cli.scenes.data import duffing
from fvi_cli.studies.tolerance.search import solve

N = 400
LINEAR = spring((0.5, 0.7), T=8.0, k=2.0, x=1.0, v=0.5)
PENDULUM = swing((1.5, 0.7), T=8.0, x=1.0, v=0.5)
GENERAL = fvi.lagrangian_scene(
    final_time=8.0,
    coordinates=("x",),
    lagrangian="(1 + x**2)*vx**2/2 - x**2",
    damping=[fvi.FractionalDamping(order=0.5, coefficient=0.1)],
    initial_position=1.0,
)
SCENES = {"linear": LINEAR, "pendulum": PENDULUM, "general": GENERAL}
NONE = fvi.Method(cq="gauss", degree=2, start="none", history="exponentials")
GRADED = replace(NONE, start="graded")
GAUSS4 = fvi.Method(cq="gauss", degree=4, start="none")


@pytest.fixture(autouse=True)
def short_chunks(monkeypatch):
    monkeypatch.setattr(loop, "CHUNK", 32)


def stopped_twice(scene, method, *asked, run=integrate, steps=N, stops=(3, 4), pause=1, **options):
    kept = Kept(stops=stops, pause=pause)
    for _ in range(2):
        with pytest.raises(StoppedError):
            run(scene, method, steps, *asked, checkpoints=kept, **options)
    found = run(scene, method, steps, *asked, checkpoints=kept, **options)
    assert 0 < kept.taken_up[0] < kept.taken_up[1]
    assert not kept.rejected
    return found


def assert_same(one, other):
    for name in ("time", "position", "momentum", "energy"):
        assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True), name
    assert (one.status, one.message) == (other.status, other.message)
    assert asdict(one.newton) == asdict(other.newton)
    assert one.history_operations == other.history_operations


@spread(every=[1, 7, 100], method=[NONE, GRADED], name=SCENES)
def test_a_run_stopped_twice_ends_in_the_same_bits(name, method, every):
    straight = integrate(SCENES[name], method, N, every=every)
    assert straight.status == "ok"
    assert_same(stopped_twice(SCENES[name], method, every=every), straight)


def test_diagnostics_and_polynomials_of_a_run_that_was_stopped_are_the_same():
    asked = fvi.DiagnosticsRequest(energy_balance=True)
    options = {"diagnostics": asked, "with_steps": True}
    straight = integrate(PENDULUM, NONE, N, **options)
    resumed = stopped_twice(PENDULUM, NONE, **options)
    assert_same(resumed, straight)
    balance = [one.diagnostics.energy_defect for one in (resumed, straight)]
    assert np.array_equal(*balance)
    assert np.array_equal(resumed.steps.velocity, straight.steps.velocity)


def test_what_is_observed_of_a_run_that_was_stopped_is_the_same():
    asked = observations(
        ("x",),
        quantities={"force": "dx", "speed": "abs(vx)"},
        events={"down": {"when": "x", "direction": "falling"}},
    )
    straight = observe_one(PENDULUM, NONE, N, asked)
    resumed = stopped_twice(PENDULUM, NONE, asked, run=observe_one)
    for one, other in zip(resumed, straight, strict=True):
        assert_same(one, other)
    found, expected = resumed[1].observed, straight[1].observed
    assert expected.events["down"].time.size
    assert np.array_equal(found.events["down"].time, expected.events["down"].time)
    assert found.extents == expected.extents
    for name, values in expected.quantities.items():
        assert np.array_equal(found.quantities[name], values)


KINKED = fvi.lagrangian_scene(
    final_time=3.0,
    coordinates=("x",),
    lagrangian="vx**2/2 - x**2 - abs(x)",
    damping=[fvi.FractionalDamping(order=0.5, coefficient=0.1)],
    initial_position=1.0,
)


@spread(few=1, scene=[LINEAR, PENDULUM, KINKED], stops=[(1, 1), (6, 7)])
def test_steps_that_are_found_on_the_way_go_on_in_the_same_bits(scene, stops):
    steps = AdaptiveSteps(tolerance=1e-9)
    straight = integrate(scene, GAUSS4, steps, with_steps=True)
    resumed = stopped_twice(scene, GAUSS4, steps=steps, stops=stops, with_steps=True)
    assert_same(resumed, straight)
    assert (resumed.rejected, resumed.doubts) == (straight.rejected, straight.doubts)
    assert np.array_equal(resumed.steps.velocity, straight.steps.velocity)


BALL = spring((0.5, 0.2), T=1.5, k=0.0, x=0.2, forcing=in_pieces("-10", 0.5, "-9"))
FEW = 32
WALLS = {
    "floor": {"when": "x", "restitution": 0.9},
    "table": {"when": "x - 0.1*sin(2*t)", "restitution": 0.8},
}


def test_a_motion_that_comes_to_rest_does_so_behind_a_checkpoint():
    asked = observations(("x",), impacts={"floor": {"when": "x", "restitution": 0.5}})
    straight = observe_one(BALL, NONE, FEW, asked)
    assert any("at rest on floor" in one for one in straight[0].remarks)
    resumed = stopped_twice(BALL, NONE, asked, run=observe_one, steps=FEW, stops=(3, 3), pause=17)
    assert_same(resumed[0], straight[0])
    assert resumed[0].remarks == straight[0].remarks


def test_the_run_between_the_points_goes_on_too():
    asked = observations(("x",), quantities={"force": "dx"})
    straight = observe_one(PENDULUM, NONE, N, asked)
    kept = Kept(stops=(20,))
    with pytest.raises(StoppedError):
        observe_one(PENDULUM, NONE, N, asked, checkpoints=kept)
    assert set(kept.contents) == {"a run", "a run between the points"}
    resumed = observe_one(PENDULUM, NONE, N, asked, checkpoints=kept)
    assert kept.taken_up == [384, 256]
    assert np.array_equal(*(one[1].observed.quantities["force"] for one in (resumed, straight)))


def computed_steps(monkeypatch):
    """Numbers of steps that are solved, by any run."""
    real, solved = Engine.solve, []

    def solve(self, state, h, count, *arguments, **options):
        solved.append(count)
        return real(self, state, h, count, *arguments, **options)

    monkeypatch.setattr(Engine, "solve", solve)
    return solved


@pytest.mark.parametrize("stop", [5, 13, 20])
def test_a_search_for_a_tolerance_computes_no_run_again(monkeypatch, stop):
    solved = computed_steps(monkeypatch)
    straight = solve(PENDULUM, tolerance=1e-8)
    total = sum(solved)
    assert total > 0
    kept = Kept(stops=(stop,))
    solved.clear()
    with pytest.raises(StoppedError):
        solve(PENDULUM, tolerance=1e-8, checkpoints=kept)
    resumed = solve(PENDULUM, tolerance=1e-8, checkpoints=kept)
    assert_same(resumed, straight)
    assert asdict(resumed.assessment) == asdict(straight.assessment)
    assert sum(solved) == total


def test_a_run_that_diverges_behind_a_checkpoint_says_the_same():
    scene = replace(LINEAR, potential=fvi.QuadraticPotential(stiffness=np.array([[-4000.0]])))
    straight = integrate(scene, NONE, N)
    kept = Kept(stops=(1,))
    with pytest.raises(StoppedError):
        integrate(scene, NONE, N, checkpoints=kept)
    assert_same(integrate(scene, NONE, N, checkpoints=kept), straight)


def test_a_checkpoint_of_other_adaptive_steps_or_of_other_flights_is_not_believed():
    walls = observations(("x",), impacts=WALLS)
    for run, scene, asked, other in [
        (integrate, PENDULUM, (AdaptiveSteps(tolerance=1e-6),), (AdaptiveSteps(tolerance=1e-7),)),
        (observe_one, BALL, (FEW, walls), (FEW // 2, walls)),
    ]:
        kept = Kept(stops=(1,), pause=9)
        with pytest.raises(StoppedError):
            run(scene, GAUSS4, *asked, checkpoints=kept)
        found, expected = run(scene, GAUSS4, *other, checkpoints=kept), run(scene, GAUSS4, *other)
        assert kept.rejected == [OF_ANOTHER_RUN]
        pairs = [(found, expected)] if run is integrate else zip(found, expected, strict=True)
        for one, straight in pairs:
            assert_same(one, straight)


def test_no_flipped_bit_and_no_cut_of_a_checkpoint_is_believed():
    kept = Kept(stops=(2,))
    with pytest.raises(StoppedError):
        integrate(PENDULUM, NONE, N, every=10, checkpoints=kept)
    whole = Checkpoint.read(io.BytesIO(kept.content), "a run")
    with pytest.raises(ValueError, match="another run"):
        Checkpoint.read(io.BytesIO(kept.content), "another")
    for size in range(0, len(kept.content), 97):
        with pytest.raises(ValueError, match="damaged"):
            Checkpoint.read(io.BytesIO(kept.content[:size]), "a run")
    seen = 0
    for place in range(0, len(kept.content), 41):
        content = bytearray(kept.content)
        content[place] ^= 16
        try:
            found = Checkpoint.read(io.BytesIO(bytes(content)), "a run")
        except ValueError:
            seen += 1
            continue
        # a bit that says nothing, such as the date of a member of the archive
        assert found.to_bytes() == whole.to_bytes()
        assert all(np.array_equal(found.kept[name], whole.kept[name]) for name in whole.kept)
    assert seen > 100


def test_a_batch_goes_on_with_members_that_have_stopped():
    """Some of the motions run away in a finite time, before and behind the checkpoints."""
    scenes = [
        duffing(
            cubic_stiffness=-0.4,
            final_time=8.0,
            damping=[fvi.FractionalDamping(order=0.5, coefficient=0.1)],
            initial_position=0.1 + 0.3 * place,
        )
        for place in range(9)
    ]
    mesh = mesh_for(scenes[0], NONE, N)

    def batch(_, method, steps, **options):
        return integrate_scenes(scenes, method, steps, every=7, **options)

    straight = batch(None, NONE, mesh)
    assert {one.status for one in straight} > {"ok"}
    resumed = stopped_twice(None, NONE, run=batch, steps=mesh)
    for one, other in zip(resumed, straight, strict=True):
        assert_same(one, other)
        assert one.failure == other.failure


@pytest.mark.parametrize("steps", [20, AdaptiveSteps(tolerance=1e-6)], ids=["mesh", "adaptive"])
def test_a_run_that_fails_at_once_keeps_its_start_and_says_why(steps):
    scene = fvi.lagrangian_scene(
        final_time=1.0,
        coordinates=("x",),
        lagrangian="vx**2/2 - 1e200*exp(x)",
        initial_position=1.0,
    )
    found = integrate(scene, GAUSS4, steps)
    assert found.status != "ok"
    assert found.failure is not None
    assert found.failure.step == 0
    assert found.time.tolist() == [0.0]
