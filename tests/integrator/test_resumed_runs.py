"""A run that was stopped, and stopped again, ends in the bits of one that never was."""

import io
from dataclasses import asdict, replace

import numpy as np
import pytest
from letters import spring, swing
from spread import spread

import fvi_cli as fvi
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.observations.asked import observations
from fvi_cli.integrator.observations.observe import integrate_observed
from fvi_cli.integrator.run import march
from fvi_cli.integrator.run.unfinished import UnfinishedRun

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


class InterruptedRunError(Exception):
    """In place of a signal."""


class Kept:
    """A checkpoint in memory; the run is stopped after so many have been written."""

    def __init__(self, stops=()):
        self.stops, self.content, self.written, self.taken_up = list(stops), b"", 0, []
        self.rejected = []

    def load(self):
        if not self.content:
            return None
        found = UnfinishedRun.read(io.BytesIO(self.content), "a run")
        self.taken_up.append(found.checkpoint.done)
        return found

    def reject(self, reason):
        self.rejected.append(reason)

    def is_due(self):
        return True

    def save(self, unfinished):
        stream = io.BytesIO()
        unfinished.write(stream, "a run")
        self.content = stream.getvalue()
        self.written += 1
        if self.stops and self.written >= self.stops[0]:
            self.written = 0
            self.stops.pop(0)
            raise InterruptedRunError


@pytest.fixture(autouse=True)
def short_chunks(monkeypatch):
    monkeypatch.setattr(march, "CHUNK", 32)


def stopped_twice(scene, method, *asked, run=integrate, **options):
    kept = Kept(stops=(3, 4))
    for _ in range(2):
        with pytest.raises(InterruptedRunError):
            run(scene, method, N, *asked, checkpoints=kept, **options)
    found = run(scene, method, N, *asked, checkpoints=kept, **options)
    assert 0 < kept.taken_up[0] < kept.taken_up[1]
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
    straight = integrate_observed(PENDULUM, NONE, N, asked)
    resumed = stopped_twice(PENDULUM, NONE, asked, run=integrate_observed)
    for one, other in zip(resumed, straight, strict=True):
        assert_same(one, other)
    found, expected = resumed[1].observed, straight[1].observed
    assert expected.events["down"].time.size
    assert np.array_equal(found.events["down"].time, expected.events["down"].time)
    assert found.extents == expected.extents
    for name, values in expected.quantities.items():
        assert np.array_equal(found.quantities[name], values)


def test_a_run_that_diverges_behind_a_checkpoint_says_the_same():
    scene = replace(LINEAR, potential=fvi.QuadraticPotential(stiffness=np.array([[-4000.0]])))
    straight = integrate(scene, NONE, N)
    kept = Kept(stops=(1,))
    with pytest.raises(InterruptedRunError):
        integrate(scene, NONE, N, checkpoints=kept)
    assert_same(integrate(scene, NONE, N, checkpoints=kept), straight)


def test_a_checkpoint_of_another_run_is_not_believed():
    kept = Kept(stops=(2,))
    with pytest.raises(InterruptedRunError):
        integrate(PENDULUM, NONE, N, checkpoints=kept)
    other = integrate(PENDULUM, NONE, 2 * N, checkpoints=kept)
    assert kept.rejected == ["it belongs to another run, or to another version of the solver"]
    assert_same(other, integrate(PENDULUM, NONE, 2 * N))


def test_no_flipped_bit_and_no_cut_of_a_checkpoint_is_believed():
    kept = Kept(stops=(2,))
    with pytest.raises(InterruptedRunError):
        integrate(PENDULUM, NONE, N, every=10, checkpoints=kept)
    whole = UnfinishedRun.read(io.BytesIO(kept.content), "a run")
    with pytest.raises(ValueError, match="another run"):
        UnfinishedRun.read(io.BytesIO(kept.content), "another")
    for size in range(0, len(kept.content), 97):
        with pytest.raises(ValueError, match="damaged"):
            UnfinishedRun.read(io.BytesIO(kept.content[:size]), "a run")
    seen = 0
    for place in range(0, len(kept.content), 41):
        content = bytearray(kept.content)
        content[place] ^= 16
        try:
            found = UnfinishedRun.read(io.BytesIO(bytes(content)), "a run")
        except ValueError:
            seen += 1
            continue
        # a bit that says nothing, such as the date of a member of the archive
        assert found.checkpoint.to_bytes() == whole.checkpoint.to_bytes()
        assert all(np.array_equal(found.kept[name], whole.kept[name]) for name in whole.kept)
    assert seen > 100
