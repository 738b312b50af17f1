"""Checkpoints of runs in parts, and runs that leave their bound.

That the parts are the whole run to the last bit is in :mod:`test_every_route`.
"""

import io
import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from letters import spring, swing
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run import loop
from fvi_cli.integrator.run.checkpoint import Checkpoint
from fvi_cli.integrator.run.parts import integrate_part
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.data import duffing

GAUSS2 = Method(cq="gauss", degree=2)
N = 1125
CHUNK = 512


@pytest.fixture
def short_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that N steps are several."""
    monkeypatch.setattr(loop, "CHUNK", CHUNK)


def damping(*orders: float, size: int = 1) -> list[FractionalDamping]:
    return [FractionalDamping(order=g, coefficient=0.7 * np.eye(size)) for g in orders]


def oscillator(*orders: float, forcing: Forcing | None = None, **more) -> Scene:
    return spring(T=8.0, k=2.0, x=1.0, v=0.5, damping=damping(*orders), forcing=forcing, **more)


SCENES = {
    "free": oscillator(0.5),
    "pendulum": swing(T=11.25, x=2.9, damping=damping(0.5)),
}


@pytest.mark.parametrize("field", ["z", "x", "p", "p_lost"])
@pytest.mark.usefixtures("short_chunks")
def test_everything_in_a_checkpoint_matters(field, monkeypatch):
    """The control: with any part of it set to zero the run goes on differently."""
    monkeypatch.setattr(loop, "CHUNK", 64)
    scene, n_steps = SCENES["pendulum"], N
    whole = integrate(scene, GAUSS2, n_steps)
    found = (
        integrate_part(scene, GAUSS2, n_steps, until=until).checkpoint
        for until in range(100, 700, 64)
    )
    # sums lose nothing in some steps
    checkpoint = next(one for one in found if np.abs(one.arrays[field]).max() > 0)
    arrays = checkpoint.arrays
    broken = replace(checkpoint, arrays={**arrays, field: np.zeros_like(arrays[field])})
    rest = integrate_part(scene, GAUSS2, n_steps, checkpoint=broken).trajectory
    assert not np.array_equal(rest.position, whole.position[checkpoint.reported + 1 :])


@pytest.mark.usefixtures("short_chunks")
def test_a_checkpoint_is_small_and_lies_before_the_next_one():
    scene, n_steps = SCENES["free"], N
    checkpoint = integrate_part(scene, GAUSS2, n_steps, until=100).checkpoint
    assert checkpoint.done == checkpoint.reported == CHUNK
    assert len(checkpoint.to_bytes()) < 12_000
    longer = integrate_part(scene, GAUSS2, 10 * N, until=1000).checkpoint
    assert len(longer.to_bytes()) < 12_000
    for until in (64, CHUNK, N + 1):
        with pytest.raises(ValueError, match=f"{until} is not allowed; it must be {CHUNK + 1}"):
            integrate_part(scene, GAUSS2, n_steps, until=until, checkpoint=checkpoint)
    with pytest.raises(ValueError, match="every: 0 is not allowed"):
        integrate_part(scene, GAUSS2, n_steps, every=0)


def as_before(data: bytes) -> bytes:
    """A checkpoint as versions wrote it that kept no checksum."""
    stream = io.BytesIO()
    with np.load(io.BytesIO(data)) as found:
        names = set(found.files) - {"digest", "label", "seconds"}
        np.savez(stream, **{name: found[name] for name in names})
    return stream.getvalue()


def with_another_digit(data: bytes) -> bytes:
    place = data.index(b"state x.npy") + 200
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


@pytest.mark.parametrize(
    "spoil",
    [
        lambda b: b"no checkpoint",
        lambda b: b[:-200],
        lambda b: b"",
        as_before,
        with_another_digit,
    ],
)
@pytest.mark.usefixtures("short_chunks")
def test_bytes_that_hold_no_checkpoint_are_refused(spoil):
    checkpoint = integrate_part(SCENES["free"], GAUSS2, N, until=100).checkpoint
    data = checkpoint.to_bytes()
    Checkpoint.from_bytes(data)
    with pytest.raises(ValueError, match="checkpoint: these bytes are not a checkpoint"):
        Checkpoint.from_bytes(spoil(data))


@pytest.mark.usefixtures("short_chunks")
def test_memory_does_not_grow_with_the_number_of_steps():
    scene = oscillator(0.5, 1.5, forcing=Forcing.from_text("cos(t)"))

    def peak(method: Method, n_steps: int) -> int:
        tracemalloc.start()
        integrate(scene, method, n_steps, every=256)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(GAUSS2, 1024)
    # blocks have their full length; the states grow like the logarithm
    assert peak(GAUSS2, 2**14) < 1.2 * peak(GAUSS2, 2**12)
    usual = Method(cq="bdf2", degree=2)
    assert peak(usual, 2**14) < 1.2 * peak(usual, 2**12)
    # control: every sum over the past is written out
    written_out = replace(usual, history="direct")
    assert peak(written_out, 2**10) > 2.0 * peak(written_out, 2**8)


@spread(order=[0.5, 1.5], degree=[2, 3])
def test_the_floor_does_not_grow(order, degree):
    """x = t^4, whose damping force is a power, with many steps."""
    factor = math.gamma(5.0) / math.gamma(5.0 - order)
    scene = spring((order, 1.0), T=1.0, forcing=f"12*t**2 + {factor!r}*t**{4.0 - order!r} + t**4")
    found = integrate(scene, Method(cq="gauss", degree=degree), 2**16, every=64)
    assert np.abs(found.position[:, 0] - found.time**4).max() < 1e-12


def same_end(scene: Scene, method: Method, n_steps: int) -> tuple[Trajectory, Trajectory]:
    """By blocks of steps, and one after the other on a mesh of given points."""
    times = scene.final_time / n_steps * np.arange(n_steps + 1)
    times[-1] = scene.final_time
    return integrate(scene, method, n_steps), integrate(scene, method, mesh_of(times))


@pytest.mark.parametrize("n_steps", [300, 4500])
def test_a_run_that_leaves_its_bound_stops(n_steps):
    """A repelling potential: the motion is infinite at t = 2.1586, no step behind that is true.

    `oracles.volterra` has x = 49.4 at t = 2.13, where x (2.1586 - t) is the square root of 2.
    """
    scene = duffing(
        stiffness=-1.0,
        cubic_stiffness=-1.0,
        final_time=30.0,
        damping=damping(0.5),
        initial_position=0.5,
        forcing=Forcing.from_text("sin(t)"),
    )
    found, usual = same_end(scene, GAUSS2, n_steps)
    assert found.status == usual.status != "ok"
    assert found.message.startswith("step ")
    assert found.time.size < n_steps // 2
    assert 2.05 < found.time[-1] < 2.16 + 30.0 / n_steps
    same = int((found.time < 2.0).sum())
    assert np.abs(found.position[:same] - usual.position[:same]).max() < 1e-11


def test_a_linear_run_that_leaves_its_bound_stops():
    scene = spring(T=500.0, k=1e6, x=1.0, damping=damping(1.9))
    found, usual = same_end(scene, Method(cq="lobatto-iiic", degree=2), 9000)
    assert found.status == usual.status
    assert abs(found.time.size - usual.time.size) <= 1
    assert found.message[:20] == usual.message[:20]


def test_growth_beyond_all_numbers_is_told():
    scene = spring(T=100.0, k=-1000.0, x=1.0)
    found = integrate(scene, GAUSS2, 2000)
    assert found.status == "diverged"
    assert "not finite after step" in found.message
    assert 1 < found.time.size < 1001


def test_nonlinear_blocks_take_few_iterations():
    """Counted: blocks of steps share their iterations."""
    scene = swing(T=20.0, x=1.0, damping=damping(0.5))
    by_block = integrate(scene, GAUSS2, 2048).newton.iterations
    times = 20.0 / 2048 * np.arange(2049)
    one_by_one = integrate(scene, GAUSS2, mesh_of(times)).newton.iterations
    assert 10 * by_block < one_by_one
