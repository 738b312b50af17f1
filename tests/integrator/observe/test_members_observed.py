"""What is observed of a member does not depend on the batch it is in."""

import numpy as np
from letters import observe_one, spring, swing
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate_members
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.request import Observations, observations
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.data import duffing

FINAL_TIME, COUNT = 6.0, 18
METHODS = {
    "gauss2": Method(cq="gauss", degree=2),
    "gauss3-graded": Method(cq="gauss", degree=3, start="graded"),
}


def member(kind: str, rng: np.random.Generator) -> tuple[Scene, float]:
    """A scene with a stiffness that its formulas know."""
    order, size, k = rng.uniform(0.2, 0.9), rng.uniform(0.1, 0.6), rng.uniform(0.5, 4.0)
    start = {"T": FINAL_TIME, "x": rng.uniform(0.2, 1.5), "v": rng.uniform(-1.0, 1.0)}
    if kind == "spring":
        return spring((0.5, size), k=k, **start), k
    if kind == "swing":
        return swing((order, size), **start), 1.0
    damping = [FractionalDamping(order=order, coefficient=[[size]])]
    place, speed = [start["x"]], [start["v"]]
    scene = duffing(
        stiffness=k,
        damping=damping,
        initial_position=place,
        initial_velocity=speed,
        final_time=FINAL_TIME,
    )
    return scene, k


def wanted(k: float) -> Observations:
    return observations(
        ("x",),
        output=np.linspace(0.0, FINAL_TIME, 23),
        quantities={"energy": "vx**2/2 + k*x**2/2", "force": "dx + ax", "work": "work_1"},
        events={
            "zero": "x",
            "fast": "sin(40*t)*vx - k/100",
            "low": {"when": "x + 0.7", "direction": "falling", "stop": True},
        },
        parameters={"k": k},
        further=("work_1",),
    )


def numbers(reported: Trajectory) -> dict[str, np.ndarray]:
    """All numbers of a member."""
    on_mesh, observed = reported.on_mesh, reported.observed
    found = {"mesh": on_mesh.time, "time": reported.time, "x": reported.position}
    found |= {"p": reported.momentum, "energy": reported.energy, **observed.quantities}
    for name, one in observed.extents.items():
        found[f"extent {name}"] = np.array([one.peak, one.least, one.greatest, one.rms])
    for name, one in observed.events.items():
        found |= {f"{name} t": one.time, f"{name} x": one.position, f"{name} v": one.velocity}
    return found


@spread(few=1, kind=["duffing", "spring", "swing"], name=list(METHODS))
def test_the_same_bits_in_any_batch_and_what_it_is_individually(kind, name):
    method, rng = METHODS[name], np.random.default_rng([len(kind), len(name)])
    scenes, asked = [], []
    for _ in range(COUNT):
        scene, k = member(kind, rng)
        scenes.append(scene)
        asked.append(wanted(k))
    whole = integrate_members(scenes, method, 60, observe=asked)
    chosen = [*range(COUNT - 1, 0, -1)]
    part = integrate_members(
        [scenes[k] for k in chosen], method, 60, observe=[asked[k] for k in chosen]
    )
    for place, index in enumerate(chosen):
        expected, found = numbers(whole[index]), numbers(part[place])
        assert expected.keys() == found.keys()
        for key, one in expected.items():
            np.testing.assert_allclose(one, found[key], rtol=1e-11, atol=1e-12, err_msg=key)
    for index in (0, 5, COUNT - 1):
        alone = numbers(observe_one(scenes[index], method, 60, asked[index]))
        for key, one in numbers(whole[index]).items():
            assert one.shape == alone[key].shape, key
            scale = np.abs(alone[key]).max(initial=1.0)
            assert np.abs(one - alone[key]).max(initial=0.0) < 1e-9 * scale, key
    # the control: members differ
    first, second = numbers(whole[1]), numbers(whole[2])
    assert np.abs(first["x"][:3] - second["x"][:3]).max() > 1e-3
