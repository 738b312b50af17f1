"""Many scenes by backward differences give what each of them gives alone.

Those by Runge-Kutta methods are in :mod:`test_side_by_side`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from unittest.mock import patch

import numpy as np
import pytest
from letters import in_pieces, spring, swing
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator import members as members_module
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import companions, integrate_batch, integrate_members
from fvi_cli.integrator.meshes.mesh import Mesh, Stretch
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.trajectory import Trajectory

TOLERANCE = 1e-12
BDF2 = Method(cq="bdf2", degree=1)
METHODS = [
    BDF2,
    Method(cq="bdf1", sampling="nodes", degree=1),
    Method(cq="bdf2", sampling="nodes", degree=1),
    Method(cq="bdf4", degree=2, forcing_quadrature="exact"),
    Method(cq="bdf6", degree=3),
]


def difference(batch: Trajectory, alone: Trajectory) -> float:
    """Largest relative difference of positions, momenta and energies."""
    assert (batch.status, batch.message, batch.remarks) == (
        alone.status,
        alone.message,
        alone.remarks,
    )
    assert asdict(batch.newton) == asdict(alone.newton)
    assert np.array_equal(batch.time, alone.time)
    worst = 0.0
    for name in ("position", "momentum", "energy"):
        a, b = getattr(batch, name), getattr(alone, name)
        assert a.shape == b.shape
        worst = max(worst, float(np.abs(a - b).max() / np.abs(b).max()))
    return worst


def agree(scenes: Sequence[Scene], method: AnyMethod, n_steps: int) -> None:
    batch = integrate_members(scenes, method, n_steps)
    assert len(batch) == len(scenes)
    for scene, one in zip(scenes, batch, strict=True):
        assert difference(one, integrate(scene, method, n_steps)) <= TOLERANCE


def oscillators(
    count: int, orders: tuple[float, ...] = (0.5,), forcing: str | None = None
) -> list[Scene]:
    rng = np.random.default_rng(11)
    draw = rng.uniform
    return [
        spring(
            T=5.0,
            m=draw(0.5, 2.0),
            k=draw(0.5, 4.0),
            damping=[FractionalDamping(order=o, coefficient=draw(0.05, 0.3)) for o in orders],
            x=rng.normal(),
            v=rng.normal(),
            forcing=None if forcing is None else Forcing.from_text(f"{rng.normal()!r}*{forcing}"),
        )
        for _ in range(count)
    ]


def positive(rng: np.random.Generator, d: int) -> np.ndarray:
    matrix = rng.normal(size=(d, d))
    return matrix @ matrix.T / d + np.eye(d)


def coupled(kind: str, seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    mass, stiffness = positive(rng, 3), positive(rng, 3)
    if kind == "uncoupled":
        mass, stiffness = np.diag(np.diagonal(mass)), np.diag(np.diagonal(stiffness))
    damping = positive(rng, 3) if kind == "general" else stiffness
    terms = ((0.5, 0.2 * damping), (1.5, 0.1 * mass))
    start = {"x": rng.normal(size=3), "v": rng.normal(size=3)}
    forcing = Forcing.from_text("cos(t)", "0", f"{seed}*t")
    return spring(*terms, T=3.0, m=mass, k=stiffness, forcing=forcing, **start)


@spread(method=METHODS, forcing=[None, "cos(2*t)"])
def test_each_member_is_what_it_is_alone(method, forcing):
    agree(oscillators(5, forcing=forcing), method, 300)


KINDS: dict[str, tuple[list[Scene], int]] = {
    **{
        f"orders {orders}": (oscillators(4, orders), 200)
        for orders in ((), (1.0,), (1.4,), (0.3, 1.5), (0.5, 1.0, 0.5))
    },
    "Riemann-Liouville": (
        [replace(scene, derivative="riemann-liouville") for scene in oscillators(4, (0.3, 0.8))],
        100,
    ),
    "with and without modes": (
        [coupled(kind, seed) for seed in range(4) for kind in ("modal", "general", "uncoupled")],
        80,
    ),
    "break points": (
        [replace(scene, forcing=in_pieces("8", 2.5, "0")) for scene in oscillators(4)],
        100,
    ),
}


@spread(name=KINDS, method=[BDF2, METHODS[2], METHODS[3]])
def test_members_of_every_kind(name, method):
    scenes, n_steps = KINDS[name]
    assert min(companions(scenes, method, n_steps)) == 4
    agree(scenes, method, n_steps)


@spread(kind=["modal", "general", "uncoupled"], method=METHODS[:-1])
def test_several_degrees_of_freedom(kind, method):
    agree([coupled(kind, seed) for seed in range(4)], method, 150)


def pendulums(*orders: float) -> list[Scene]:
    return [
        swing(
            T=4.0,
            omega=0.5 + 0.1 * place,
            x=1.0,
            v=0.2 + 0.2 * place,
            damping=[FractionalDamping(order=order, coefficient=0.3) for order in orders],
        )
        for place in range(16)
    ]


@pytest.mark.parametrize("orders", [(0.5,), (1.0, 1.5)])
def test_nonlinear_members(orders):
    for method in METHODS[1:4]:
        assert companions(pendulums(*orders), method, 40) == [16] * 16
        runs = integrate_members(pendulums(*orders), method, 40)
        for scene, run in list(zip(pendulums(*orders), runs, strict=True))[::5]:
            alone = integrate(scene, method, 40)
            assert np.abs(run.position - alone.position).max() < TOLERANCE
            assert np.abs(run.momentum - alone.momentum).max() < TOLERANCE


def first_orders_and_jumps() -> list[Scene]:
    return [replace(scene, derivative="riemann-liouville") for scene in oscillators(6, (0.4, 0.9))]


COMPANY = {
    "a column": lambda: oscillators(6, (0.5, 1.0, 1.5), "cos(t)"),
    "jumps": first_orders_and_jumps,
    "modes": lambda: [coupled("modal", seed) for seed in range(6)],
    "coupled": lambda: [coupled("general", seed) for seed in range(6)],
    "pendulums": lambda: pendulums(0.5)[:6],
}


@spread(name=COMPANY, method=METHODS)
def test_who_stands_beside_changes_nothing(name, method):
    """To the last bit, in any company; the sums of bdf6 are the longest."""
    scenes, n_steps = COMPANY[name](), 300 if method.cq == "bdf6" else 60
    together = integrate_batch(scenes, method, n_steps)
    for places in ([3], [5, 0, 4], [*range(6)] * 5):
        packed = integrate_batch([scenes[place] for place in places], method, n_steps)
        for place, one in zip(places, packed, strict=True):
            assert np.array_equal(one.position, together[place].position)
            assert np.array_equal(one.momentum, together[place].momentum)


def test_more_than_are_stepped_together():
    scenes = oscillators(20)
    runs = integrate_members(scenes, BDF2, 64)
    with patch.object(members_module, "MOST_TOGETHER", 8):
        parts = integrate_members(scenes, BDF2, 64)
    assert all(
        np.array_equal(one.position, other.position) for one, other in zip(runs, parts, strict=True)
    )


def counted(call: Callable[[], object]) -> tuple[int, int]:
    """How many batches were run, and how many scenes were integrated one by one."""
    together = members_module.integrate_batch
    with (
        patch.object(members_module, "integrate_batch", wraps=together) as batches,
        patch.object(members_module, "integrate", wraps=members_module.integrate) as alone,
    ):
        call()
    return batches.call_count, alone.call_count


def test_those_that_fit_together_are_one_batch():
    scenes = oscillators(4)
    assert counted(lambda: integrate_members(scenes, BDF2, 64)) == (1, 0)
    mixed = [*scenes, *oscillators(5, (0.7,)), replace(scenes[0], final_time=4.0)]
    assert counted(lambda: integrate_members(mixed, BDF2, 64)) == (2, 1)
    assert counted(lambda: integrate_members(scenes[:3], BDF2, 64)) == (0, 3)
    other = [*scenes[:3], replace(scenes[3], derivative="riemann-liouville")]
    assert counted(lambda: integrate_members(other, BDF2, 64)) == (0, 4)
    assert counted(lambda: integrate_members(scenes, replace(BDF2, history="direct"), 64)) == (0, 4)
    assert counted(lambda: integrate_members(scenes, BDF2, 8)) == (0, 4)
    agree(mixed, BDF2, 64)


@pytest.mark.parametrize(
    "method",
    [
        replace(BDF2, history="direct"),
        Method(cq="bdf2", degree=1, start="weights"),
        Baseline(name="implicit-euler"),
    ],
    ids=lambda method: method.case,
)
def test_methods_that_take_members_one_by_one(method):
    batch = integrate_members(oscillators(4), method, 40)
    for scene, one in zip(oscillators(4), batch, strict=True):
        assert np.array_equal(one.position, integrate(scene, method, 40).position)


def test_a_member_that_diverges_does_not_spoil_the_others():
    method = Method(cq="bdf2", sampling="nodes", degree=1)
    scenes = oscillators(5, (1.5,))
    # explicit in the damping: unstable for a large coefficient
    wild = FractionalDamping(order=1.5, coefficient=400.0)
    scenes[1] = replace(scenes[1], damping=(wild,))
    batch = integrate_members(scenes, method, 3000)
    assert [one.status for one in batch] == ["ok", "diverged", "ok", "ok", "ok"]
    for scene, one in zip(scenes, batch, strict=True):
        assert difference(one, integrate(scene, method, 3000)) <= 1e-9
    undisturbed = integrate_members([scenes[0], *scenes[2:]], method, 3000)
    for one, other in zip([batch[0], *batch[2:]], undisturbed, strict=True):
        assert np.array_equal(one.position, other.position)


def test_thinned():
    scenes = oscillators(4)
    batch = integrate_members(scenes, BDF2, 50, every=7)
    for scene, one in zip(scenes, batch, strict=True):
        alone = integrate(scene, BDF2, 50, every=7)
        assert one.every == 7
        assert difference(one, alone) <= TOLERANCE


def test_wrong_numbers_are_refused():
    with pytest.raises(ValueError, match="n_steps: 0 is not allowed"):
        integrate_members(oscillators(2), BDF2, 0)
    with pytest.raises(ValueError, match="every: 0 is not allowed"):
        integrate_members(oscillators(2), BDF2, 8, every=0)
    assert integrate_members([], BDF2, 8) == []


def test_a_wrong_member_would_be_seen():
    """The control: one weight of ten thousand in one coefficient."""
    scenes = oscillators(4)
    batch = integrate_members(scenes, BDF2, 100)
    term = scenes[1].damping[0]
    moved = FractionalDamping(order=term.order, coefficient=1.0001 * term.coefficient)
    alone = integrate(replace(scenes[1], damping=(moved,)), BDF2, 100)
    assert difference(batch[1], alone) > 1e3 * TOLERANCE


@pytest.mark.parametrize("n_steps", [3, 32, 33])
def test_singular_steps_end_a_run_wherever_they_begin(n_steps):
    """On a mesh of its own, singly and in blocks: what was done before them is kept."""
    scene = spring(T=1.0 + 0.25 * n_steps, k=-64.0, x=1.0)
    mesh = Mesh(
        stretches=(
            Stretch(begin=0.0, end=1.0, n_steps=10, step_size=0.1),
            Stretch(begin=1.0, end=scene.final_time, n_steps=n_steps, step_size=0.25),
        )
    )
    run = integrate(scene, Method(cq="gauss", degree=1), mesh)
    assert run.status == "failed"
    assert "the equations of a step of length 0.25 have no unique solution" in run.message
    assert run.time == pytest.approx(0.1 * np.arange(11))
    assert run.energy.size == 11


def test_a_singular_frozen_response_is_no_failure():
    """A pendulum that begins upside down: its linear scene there has no unique step, it has."""
    turned = swing(T=128.0, x=math.pi, v=1e-3)
    run = integrate(turned, Method(cq="gauss", degree=1), 64)
    assert run.status in ("ok", "failed")
    assert "unique" not in run.message


def test_a_baseline_step_without_a_solution():
    scene = spring(T=2.0, k=-1.0, x=1.0)
    assert integrate(scene, Baseline(name="implicit-euler"), 2).status == "failed"
    assert integrate(scene, Baseline(name="implicit-euler"), 4).status == "ok"
