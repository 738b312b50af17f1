"""The memory-free history against the sum written out, against FFT, and across interruptions."""

from __future__ import annotations

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.checkpoint import Checkpoint
from fvi_cli.integrator.exponential_history import ExponentialHistory, exponential_kernel
from fvi_cli.integrator.exponential_run import Part, integrate_part
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.memory import build_channels
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.named import linear_oscillator, pendulum
from fvi_cli.scenes.nonlinear import duffing

GAUSS2 = Method(cq="gauss", degree=2, history="exponentials")
FIELDS = ("time", "position", "momentum", "energy")


def damping(*orders: float, size: int = 1) -> list[FractionalDamping]:
    return [FractionalDamping(order=g, coefficient=0.7 * np.eye(size)) for g in orders]


def oscillator(*orders: float, forced: bool = True) -> Scene:
    return linear_oscillator(
        final_time=8.0,
        damping=damping(*orders),
        stiffness=2.0,
        initial_position=1.0,
        initial_velocity=0.5,
        forcing=Forcing.from_text("cos(t) + sqrt(t)") if forced else None,
    )


def coupled(*, diagonal: bool) -> Scene:
    rng = np.random.default_rng(5)
    random = rng.normal(size=(3, 3))
    general = random @ random.T + np.eye(3)
    return Scene(
        inertia=Inertia(mass=np.diag([1.0, 2.0, 3.0])),
        potential=QuadraticPotential(stiffness=np.diag([1.0, 4.0, 2.0]) if diagonal else general),
        damping=(
            FractionalDamping(order=0.5, coefficient=np.eye(3)),
            FractionalDamping(order=1.5, coefficient=0.3 * np.diag([1.0, 2.0, 0.5])),
            FractionalDamping(order=0.8, coefficient=0.2 * np.diag([1.0, 2.0, 0.5])),
        ),
        initial_position=np.array([1.0, -0.5, 0.2]),
        initial_velocity=np.array([0.0, 0.4, 1.0]),
        final_time=5.0,
    )


def largest_difference(scene: Scene, method: Method, n_steps: int) -> float:
    """Between the two histories, relative, over all that a trajectory holds."""
    usual = integrate(scene, replace(method, history="fft"), n_steps)
    free = integrate(scene, replace(method, history="exponentials"), n_steps)
    return max(
        float(np.abs(getattr(usual, name) - getattr(free, name)).max())
        / float(np.abs(getattr(usual, name)).max())
        for name in FIELDS
    )


@pytest.mark.parametrize("cq", ["gauss", "radau-iia", "lobatto-iiic"])
@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("orders", [(0.5,), (1.5,), (1.0,), (0.5, 1.5, 1.0), ()])
def test_the_same_as_by_fft(cq: str, degree: int, orders: tuple[float, ...]) -> None:
    for n_steps, start in ((5, "none"), (64, "series"), (4500, "none")):
        method = Method(cq=cq, degree=degree, start=start)
        assert largest_difference(oscillator(*orders), method, n_steps) < 1e-12


@pytest.mark.parametrize("quadrature", ["exact", "projected"])
def test_moments_chunk_by_chunk(quadrature: str) -> None:
    """Forces with a break at a chunk's edge, inside a chunk, and none at all."""
    scene = oscillator(1.5)
    pieces = (
        replace(Forcing.from_text("8").pieces[0], until=4096 * 8.0 / 8192),
        replace(Forcing.from_text("sqrt(t)").pieces[0], until=5000 * 8.0 / 8192),
        Forcing.from_text("0").pieces[0],
    )
    method = Method(cq="gauss", degree=2, forcing_quadrature=quadrature, start="series")
    for forcing in (Forcing(pieces=pieces), Forcing.from_text("sqrt(t)"), None):
        assert largest_difference(replace(scene, forcing=forcing), method, 8192) < 1e-12


@pytest.mark.parametrize("diagonal", [True, False])
def test_several_degrees_of_freedom(diagonal: bool) -> None:
    assert largest_difference(coupled(diagonal=diagonal), GAUSS2, 700) < 1e-12


def test_riemann_liouville_with_a_jump() -> None:
    scene = replace(oscillator(0.5), derivative="riemann-liouville")
    assert largest_difference(scene, GAUSS2, 4200) < 1e-12


@pytest.mark.parametrize("start", ["none", "series"])
def test_nonlinear_scenes(start: str) -> None:
    scene = pendulum(
        final_time=20.0, damping=damping(0.5, 1.5), initial_position=1.0, initial_velocity=0.3
    )
    method = Method(cq="gauss", degree=2, start=start)
    assert largest_difference(scene, method, 400) < 1e-12


@pytest.mark.parametrize(("order", "degree"), [(1.5, 2), (1.5, 3), (0.5, 2), (0.5, 3)])
def test_the_floor_does_not_grow(order: float, degree: int) -> None:
    """x = t^4, whose damping force is a power, with many steps."""
    factor = math.gamma(5.0) / math.gamma(5.0 - order)
    force = f"12*t**2 + {factor!r}*t**{4.0 - order!r} + t**4"
    scene = linear_oscillator(
        final_time=1.0,
        damping=[FractionalDamping(order=order, coefficient=1.0)],
        forcing=Forcing.from_text(force),
    )
    n_steps = 2**16
    method = Method(cq="gauss", degree=degree, history="exponentials")
    trajectory = integrate(scene, method, n_steps, every=64)
    assert np.abs(trajectory.position[:, 0] - trajectory.time**4).max() < 1e-12


@pytest.mark.parametrize("block", [2, 16])
def test_the_states_against_the_sum_written_out(block: int) -> None:
    """And the control: one state changed is seen."""
    n_steps, h, m = 96, 0.1, 2
    terms = tuple(damping(0.4, 1.3))
    channels = build_channels(GAUSS2, h, n_steps, terms, n_steps)
    kernel = exponential_kernel(GAUSS2, h, n_steps, terms, channels)
    assert kernel is not None
    rng = np.random.default_rng(3)
    samples = rng.normal(size=(n_steps, m))
    weights = channels[0].weights
    history = ExponentialHistory(kernel, (channels[0].direction[None],), block)
    for first in range(0, n_steps, block):
        known = history.known()[0, :, :, 0]
        for row in range(block):
            expected = sum(
                (weights[first + row - k] @ samples[k] for k in range(first)), start=np.zeros(m)
            )
            assert np.abs(known[row] - expected).max() < 1e-12
        history.push(samples[first : first + block].reshape(1, block, m, 1))
    states = history.states
    changed = states.values.copy()
    changed[np.abs(kernel.columns[0][:, :1] * changed).argmax()] *= 1.0 + 1e-6
    other = ExponentialHistory(
        kernel, (channels[0].direction[None],), block, replace(states, values=changed)
    )
    assert np.abs(other.known() - history.known()).max() > 1e-9


def joined(parts: list[Part], name: str) -> np.ndarray:
    return np.concatenate([getattr(part.trajectory, name) for part in parts])


SCENES = {
    "free": oscillator(0.5, forced=False),
    "forced": oscillator(0.5, 1.5),
    "coupled": coupled(diagonal=False),
    "modes": coupled(diagonal=True),
    "undamped": oscillator(),
    "pendulum": pendulum(final_time=2.0, damping=damping(0.5), initial_position=1.0),
}


@pytest.mark.parametrize("name", sorted(SCENES))
@pytest.mark.parametrize("start", ["none", "series"])
def test_an_interrupted_run_goes_on_bit_for_bit(name: str, start: str) -> None:
    scene = SCENES[name]
    n_steps = 700 if name == "pendulum" else 9000
    method = replace(GAUSS2, start=start)
    whole = integrate(scene, method, n_steps)
    for until in (1, n_steps // 3, n_steps // 2, n_steps - 70):
        parts = [integrate_part(scene, method, n_steps, until=until)]
        checkpoint = parts[0].checkpoint
        assert checkpoint is not None
        assert until <= checkpoint.step < until + 64
        loaded = Checkpoint.from_bytes(checkpoint.to_bytes())
        # once more in between
        following = integrate_part(scene, method, n_steps, until=loaded.step + 1, checkpoint=loaded)
        parts.append(following)
        if following.checkpoint is not None:
            again = Checkpoint.from_bytes(following.checkpoint.to_bytes())
            parts.append(integrate_part(scene, method, n_steps, checkpoint=again))
        assert parts[-1].checkpoint is None
        for field in FIELDS:
            assert np.array_equal(joined(parts, field), getattr(whole, field)), (until, field)


@pytest.mark.parametrize("field", ["states", "position_and_momentum", "lost", "states_lost"])
def test_everything_in_a_checkpoint_matters(field: str) -> None:
    """The control: with any part of it set to zero the run goes on differently."""
    scene, n_steps = SCENES["forced"], 9000
    whole = integrate(scene, GAUSS2, n_steps)
    checkpoint = integrate_part(scene, GAUSS2, n_steps, until=4500).checkpoint
    assert checkpoint is not None
    assert np.abs(getattr(checkpoint, field)).max() > 0
    broken = replace(checkpoint, **{field: np.zeros_like(getattr(checkpoint, field))})
    rest = integrate_part(scene, GAUSS2, n_steps, checkpoint=broken).trajectory
    assert not np.array_equal(rest.position, whole.position[checkpoint.step + 1 :])


def test_a_checkpoint_is_small_and_belongs_to_one_run() -> None:
    scene, n_steps = SCENES["free"], 640
    checkpoint = integrate_part(scene, GAUSS2, n_steps, until=100).checkpoint
    assert checkpoint is not None
    assert len(checkpoint.to_bytes()) < 12_000
    longer = integrate_part(scene, GAUSS2, 64_000, until=6400).checkpoint
    assert longer is not None
    assert len(longer.to_bytes()) < 12_000
    for other, steps in ((GAUSS2, 641), (replace(GAUSS2, degree=3, quadrature=None), n_steps)):
        with pytest.raises(ValueError, match="checkpoint: it belongs to the run"):
            integrate_part(scene, other, steps, checkpoint=checkpoint)
    with pytest.raises(ValueError, match="checkpoint: the bytes hold none"):
        Checkpoint.from_bytes(b"not a checkpoint")
    with pytest.raises(ValueError, match="checkpoint: the bytes hold none"):
        Checkpoint.from_bytes(checkpoint.to_bytes()[:-200])
    with pytest.raises(ValueError, match="until: 64 is not allowed; it must be 129 to 640"):
        integrate_part(scene, GAUSS2, n_steps, until=64, checkpoint=checkpoint)


@pytest.mark.parametrize("every", [1, 3, 64, 100, 10_000])
@pytest.mark.parametrize("history", ["auto", "exponentials"])
def test_thinned(every: int, history: str) -> None:
    scene, n_steps = SCENES["forced"], 5000
    method = replace(GAUSS2, history=history)
    whole = integrate(scene, method, n_steps)
    thin = integrate(scene, method, n_steps, every=every)
    kept = sorted({*range(0, n_steps + 1, every), n_steps})
    assert thin.every == every
    for field in FIELDS:
        assert np.array_equal(getattr(thin, field), getattr(whole, field)[kept])


def test_memory_does_not_grow_with_the_number_of_steps() -> None:
    def peak(method: Method, n_steps: int) -> int:
        tracemalloc.start()
        integrate(SCENES["forced"], method, n_steps, every=512)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    peak(GAUSS2, 4096)
    assert peak(GAUSS2, 2**15) < 1.1 * peak(GAUSS2, 2**13)
    # control: the other history keeps every sample
    usual = replace(GAUSS2, history="fft")
    assert peak(usual, 2**15) > 2.0 * peak(usual, 2**13)


def test_what_is_refused() -> None:
    with pytest.raises(ValueError, match="history: exponentials is for gauss, radau-iia"):
        Method(cq="bdf2", degree=1, history="exponentials")
    with pytest.raises(ValueError, match="every: 0 is not allowed"):
        integrate(SCENES["free"], GAUSS2, 8, every=0)
    assert GAUSS2.case == "gauss-s2-none-exponentials"


def test_trouble_is_told() -> None:
    """A failure ends the run with what was finished."""
    scene = linear_oscillator(final_time=100.0, damping=[], stiffness=-1000.0, initial_position=1.0)
    trajectory = integrate(scene, GAUSS2, 2000)
    assert trajectory.status == "diverged"
    assert "not finite after step" in trajectory.message
    assert 1 < trajectory.time.size < 1001


@pytest.mark.parametrize("n_steps", [300, 9000])
def test_a_run_that_leaves_its_bound_stops(n_steps: int) -> None:
    """A repelling potential: with every history at the same step."""
    scene = duffing(
        stiffness=-1.0,
        cubic_stiffness=-1.0,
        final_time=30.0,
        damping=damping(0.5),
        initial_position=0.5,
        forcing=Forcing.from_text("sin(t)"),
    )
    found = integrate(scene, GAUSS2, n_steps)
    usual = integrate(scene, replace(GAUSS2, history="auto"), n_steps)
    assert found.status == usual.status != "ok"
    assert found.time.size == usual.time.size < n_steps // 2
    assert found.message.split()[:1] == usual.message.split()[:1]


def test_a_linear_run_that_leaves_its_bound_stops() -> None:
    method = Method(cq="lobatto-iiic", degree=2, history="exponentials")
    scene = linear_oscillator(
        final_time=500.0, damping=damping(1.9), stiffness=1e6, initial_position=1.0
    )
    found = integrate(scene, method, 9000)
    usual = integrate(scene, replace(method, history="auto"), 9000)
    assert found.status == usual.status
    assert found.time.size == usual.time.size
    assert found.message[:20] == usual.message[:20]


def test_nonlinear_blocks_take_few_iterations() -> None:
    """Counted: blocks of steps share their iterations, with this history as with the other."""
    scene = pendulum(final_time=20.0, damping=damping(0.5), initial_position=1.0)
    by_block = integrate(scene, GAUSS2, 2048).newton.iterations
    one_by_one = integrate(scene, replace(GAUSS2, history="direct"), 2048).newton.iterations
    assert 10 * by_block < one_by_one


def test_wild_motion_goes_on_bit_for_bit() -> None:
    """Blocks that do not contract, single steps and new linear responses lie where they lay."""
    scene = pendulum(
        final_time=300.0, damping=damping(0.5), initial_position=2.9, initial_velocity=2.0
    )
    for start in ("none", "series"):
        method = replace(GAUSS2, start=start)
        whole = integrate(scene, method, 1500)
        assert whole.newton.largest > 4
        for until in (64, 640, 1400):
            first = integrate_part(scene, method, 1500, until=until)
            assert first.checkpoint is not None
            loaded = Checkpoint.from_bytes(first.checkpoint.to_bytes())
            rest = integrate_part(scene, method, 1500, checkpoint=loaded)
            for field in FIELDS:
                assert np.array_equal(joined([first, rest], field), getattr(whole, field))
