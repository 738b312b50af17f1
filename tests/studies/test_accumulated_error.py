"""Errors that steps add up to are estimated along the path, and said where they are large."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from letters import spring
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import fvi_cli as fvi
from fvi_cli.integrator.growth_bound import energy_remarks
from fvi_cli.planning import accumulated_error as module
from fvi_cli.planning.accumulated_error import accumulated_error
from fvi_cli.planning.one_step import exponentials, increments, rate_errors
from fvi_cli.planning.path_resolution import path_remarks, unbounded_remark

NAMES = ("gauss1", "gauss2", "gauss3", "gauss5", "bdf1", "bdf2-nodes", "bdf3", "bdf6")


@pytest.mark.parametrize("name", NAMES)
def test_increments_are_those_of_a_step(name: str) -> None:
    """Of quadratic Lagrangians, whose coordinates are coupled by mass, stiffness and velocity."""
    random = np.random.default_rng([31, *map(ord, name)])
    q, v = random.standard_normal((2, 2))
    step = float(random.uniform(0.2, 2.0))
    scene = fvi.lagrangian_scene(
        coordinates=["x", "y"],
        lagrangian="vx**2 + vx*vy/2 + vy**2 + 0.7*(x*vy - 2*y*vx) - x**2 + 0.3*x*y + y**2/5 + x",
        initial_position=q,
        initial_velocity=v,
        final_time=step,
    )
    at = scene.derivatives(q, v, np.asarray(0.0))
    parts = (v, at.momentum, at.force, at.mass, at.mixed, at.stiffness)
    method = fvi.method_named(name)
    found = increments(method, np.array([step]), *(one[None, None] for one in parts))[0, 0]
    run = fvi.integrate(scene, method, 1)
    assert run.momentum is not None
    assert found[:2] == pytest.approx(run.position[1] - q, rel=1e-9, abs=1e-11)
    assert found[2:] == pytest.approx(run.momentum[1] - run.momentum[0], rel=1e-9, abs=1e-11)


def test_exponentials() -> None:
    random = np.random.default_rng(32)
    matrices = (
        random.standard_normal((4, 3, 5, 5)) * np.array([1e-9, 0.1, 1.0, 9.0])[:, None, None, None]
    )
    for one, found in zip(
        matrices.reshape(-1, 5, 5), exponentials(matrices).reshape(-1, 5, 5), strict=True
    ):
        assert found == pytest.approx(expm(one), rel=1e-9, abs=1e-9 * np.abs(expm(one)).max())


@pytest.mark.few(4)
@pytest.mark.parametrize("name", ["bdf1", "bdf2", "bdf3-nodes", "gauss2"])
@pytest.mark.parametrize("order", [0.3, 1.0, 1.6])
def test_errors_of_damping_in_one_step(name: str, order: float) -> None:
    """A lightly damped oscillation by a method of high degree is off by those of its damping."""
    method = fvi.method_named(name)
    turned, light = 0.4, 1e-3
    shift = rate_errors(method, (order,), np.array([turned]))[:, 0]
    n_steps = 400
    scene = spring((order, light), k=turned**2, T=float(n_steps), x=1.0)
    run, fine = (fvi.integrate(scene, one, n) for one, n in ((method, 400), ("gauss5", 1600)))
    off = run.position[-50:, 0] - fine.position[::4][-50:, 0]
    off_by = n_steps * abs(shift[0] + light * shift[1])
    assert np.abs(off).max() == pytest.approx(off_by, rel=0.5, abs=2e-5) or off_by > 0.5


def saddle(seed: int) -> tuple[fvi.Scene, str, float, np.ndarray]:
    """A motion that leaves, passes or comes back to an unstable state, and its scales."""
    random = np.random.default_rng([33, seed])
    second, length = 10 ** random.uniform(-5, 5, 2)
    rate = float(random.uniform(0.6, 2.0))
    close = float(10 ** random.uniform(-4, -1))
    kind = seed % 4
    potential = ["k*cos(x)", "k*cos(x)", "x**4/4 - k*x**2/2", "k*cos(x)"][kind]
    start = [[close, 0.0], [math.pi, 2 * math.sqrt(rate) * (1 + close)], [close, 0.0], [0.3, 0.2]]
    text = potential.replace("x", "(x/l)")
    scene = fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"vx**2/2 - (l/u)**2*({text})",
        parameters={"k": rate, "l": length, "u": second},
        initial_position=[start[kind][0] * length],
        initial_velocity=[start[kind][1] * length / second],
        final_time=float(random.uniform(8, 25)) * second,
    )
    force = (lambda x: rate * x - x**3) if kind == 2 else (lambda x: rate * math.sin(x))
    name = str(random.choice(["gauss1", "gauss2", "gauss3", "gauss4", "bdf1", "bdf3", "bdf6"]))

    def exact(n_steps: int) -> np.ndarray:
        times = np.linspace(0, scene.final_time / second, n_steps + 1)
        found = solve_ivp(
            lambda t, y: [y[1], force(y[0])],
            (0, times[-1]),
            start[kind],
            method="DOP853",
            rtol=1e-11,
            atol=1e-12,
            t_eval=times,
        )
        return found.y[0] * length

    return scene, name, length, exact


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", range(12))
def test_motions_along_unstable_states(seed: int) -> None:
    scene, name, _, exact = saddle(seed)
    method, said = fvi.method_named(name), {}
    for n_steps in (12, 20, 40, 90, 200, 600):
        run = fvi.integrate(scene, method, n_steps)
        assert run.status == "ok"
        right = exact(n_steps)
        error = float(np.abs(run.position[:, 0] - right).max()) / (0.5 * float(np.ptp(right)))
        known = accumulated_error(scene, method, run, 0.03)
        assert known is not None
        if error > 0.15:
            said["large"] = path_remarks(scene, method, run)
            assert said["large"], (n_steps, error)
        elif 1e-5 < error < 0.02:
            assert error / 5 < known.error.max() < 8 * error
        if error < 0.003:
            said["small"] = path_remarks(scene, method, run)
            assert said["small"] == (), (n_steps, error)
    assert {"large", "small"} & said.keys()


def test_a_motion_that_leaves_the_top_says_how_its_errors_grow() -> None:
    scene = fvi.lagrangian_scene(
        coordinates=["x"],
        lagrangian="vx**2/2 - 2.041*cos(x)",
        initial_position=[1e-4],
        final_time=20.0,
    )
    method = fvi.method_named("gauss2")
    (said,) = path_remarks(scene, method, fvi.integrate(scene, method, 42))
    found = re.search(r"error is some (\S+) % .* from t = (\S+) on, .* (\S+) times larger", said)
    assert found is not None
    percent, since, times = (float(one) for one in found.groups())
    right = fvi.integrate(scene, "gauss5", 840).position[::20]
    error = np.abs(fvi.integrate(scene, method, 42).position - right) / (0.5 * np.ptp(right))
    assert 0.3 < percent / 100 / min(error.max(), 1) < 3
    assert since == pytest.approx(20 / 42 * np.argmax(error > 0.03), abs=1.0)
    # without their growth errors would be as many times smaller: the control
    assert times > 10


@pytest.mark.few(1)
@pytest.mark.parametrize("n_steps", [300, 3000, 30_000])
def test_long_runs_are_looked_at_in_parts(n_steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The phase of a pendulum by Gauss1: the error is that of all steps, the work is not."""
    seen = []
    monkeypatch.setattr(
        "fvi_cli.planning.accumulated_error.increments",
        lambda method, h, *parts: seen.append(h.size) or increments(method, h, *parts),
    )
    scene = fvi.pendulum(initial_position=1.0, final_time=0.1 * n_steps)
    run, fine = (fvi.integrate(scene, one, n_steps) for one in ("gauss1", "gauss4"))
    error = np.abs(run.position - fine.position).max()
    seen.clear()
    known = accumulated_error(scene, fvi.method_named("gauss1"), run, math.inf)
    assert known is not None
    assert min(error, 1) / 2 < known.error.max()
    assert known.error.max() < 3 * error or error > 1
    assert sum(seen) <= 1000


@pytest.mark.few(4)
@pytest.mark.parametrize("name", ["gauss1", "gauss2", "bdf2", "bdf3-nodes"])
@pytest.mark.parametrize("n_steps", [60, 900, 7000])
def test_linear_runs_in_equal_steps_take_one_step(
    name: str, n_steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What one step makes of units says it for all: as if each were looked at by itself."""
    random = np.random.default_rng([35, n_steps, *map(ord, name)])
    d, seen = int(random.integers(1, 4)), []
    factors = random.standard_normal((3, d, d))
    mass, stiffness, form = (np.eye(d) + one @ one.T for one in factors)
    scene = fvi.linear_oscillator(
        mass=mass,
        stiffness=stiffness,
        damping=[
            fvi.FractionalDamping(order=order, coefficient=1e-3 * form) for order in (0.4, 1.5)
        ],
        forcing=fvi.Forcing.from_text(*["sin(t/3)"] * d),
        initial_position=random.standard_normal(d),
        final_time=0.3 * n_steps,
    )
    method = fvi.method_named(name)
    run = fvi.integrate(scene, method, n_steps)
    monkeypatch.setattr(
        module,
        "increments",
        lambda one, h, *parts: seen.append(h.size) or increments(one, h, *parts),
    )
    fast = accumulated_error(scene, method, run, math.inf)
    work, whole = sum(seen), module._with_real_parts
    seen.clear()
    monkeypatch.setattr(
        module,
        "_with_real_parts",
        lambda windows: whole([replace(one, is_regular=False) for one in windows]),
    )
    each = accumulated_error(scene, method, run, math.inf)
    assert fast is not None
    assert each is not None
    assert fast.error == pytest.approx(each.error, rel=1e-6, abs=1e-9)
    assert fast.amplification == pytest.approx(each.amplification, rel=1e-6)
    assert work == 2
    # the control
    assert sum(seen) >= 60


@pytest.mark.parametrize("seed", range(6))
def test_energies_of_lagrangians_that_rise(seed: int) -> None:
    random = np.random.default_rng([34, seed])
    length, second = 10 ** random.uniform(-5, 5, 2)
    damping = [fvi.FractionalDamping(order=0.7, coefficient=0.1)] if seed % 2 else []
    texts = {"": "", "t": " - 1e-3*sin(t/u)*(x/u)**2"}
    scenes = {
        which: fvi.lagrangian_scene(
            coordinates=["x"],
            lagrangian=f"(1 + (x/l)**2)*vx**2/2 - (x/u)**2 - 3*(l/u)**2{more}",
            parameters={"l": length, "u": second},
            damping=damping,
            initial_position=[length],
            final_time=10 * second,
        )
        for which, more in texts.items()
    }
    run = fvi.integrate(scenes[""], "gauss3", 200)
    assert run.energy is not None
    assert run.remarks == ()
    factor = np.where(np.arange(201) > 100, 9.0, 1.0)
    risen = run.energy[0] + (factor - 1.0) * (length / second) ** 2
    (said,) = energy_remarks(scenes[""], run.position, risen, 0.0)
    assert "its energy rises to " in said
    # the controls
    assert energy_remarks(scenes[""], run.position, run.energy, 0.0) == ()
    assert energy_remarks(scenes["t"], run.position, risen, 0.0) == ()


RUNAWAYS = [
    ("vq**2/2 + q**2/2", 26.0, True),
    ("(1 + q**2)*vq**2/2 + q**4", 12.0, True),
    ("vq**2/2 + q*q/2 - q**4/4", 26.0, False),
    ("vq**2/2 - 9.81*q", 1e4, False),
    ("vq**2/2 - 1/q", 1e4, False),
    ("vq**2/2 + cos(q)", 26.0, False),
    ("vq**2/2 + q**2/2", 3.0, False),
]


@pytest.mark.parametrize(("text", "final_time", "is_said"), RUNAWAYS)
def test_runs_that_reach_their_end_far_away_are_asked_about(
    text: str, final_time: float, is_said: bool
) -> None:
    scene = fvi.lagrangian_scene(
        coordinates=["q"], lagrangian=text, initial_position=[1e-3 if "q*q" in text else 1.0],
        final_time=final_time,
    )  # fmt: skip
    run = fvi.integrate(scene, "gauss2", 800)
    assert run.status == "ok"
    said = unbounded_remark(scene, run)
    assert bool(said) == is_said
    assert all("is the sign of V meant?" in one for one in said)


@pytest.mark.parametrize(
    ("text", "is_named"),
    [("vq**2/2 + q**4", False), ("vq**2/2 + cosh(q)", False), ("q**2*vq**2/2 - q**2", True)],
)
def test_a_singular_mass_is_named_where_there_is_one(text: str, is_named: bool) -> None:
    scene = fvi.lagrangian_scene(
        coordinates=["q"], lagrangian=text, initial_position=[1.0], final_time=10.0
    )
    run = fvi.integrate(scene, "gauss2", 400)
    assert run.status == "failed"
    assert ("whether the mass matrix is singular there" in run.message) == is_named
    assert bool(unbounded_remark(scene, run)) != is_named
