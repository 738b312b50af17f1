"""Steps whose iteration leads away from its guess: the solution, or a failure."""

import numpy as np
import pytest
from oracles.ordinary import solve_ordinary
from scipy.integrate import solve_ivp
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.lagrangian import lagrangian_scene

GAUSS4 = Method(cq="gauss", degree=4)
COARSE = 98


def quartic(rng: np.random.Generator, order: float, final_time: float) -> Scene:
    """L = v^2 / 2 + b v^4 - c x^2, whose mass 1 + 12 b v^2 changes from step to step."""
    return lagrangian_scene(
        coordinates=("x",),
        lagrangian="vx**2/2 + b*vx**4 - c*x**2",
        parameters={"b": 10 ** rng.uniform(-2, 1), "c": 10 ** rng.uniform(-1, 1.5)},
        final_time=final_time,
        damping=[FractionalDamping(order=order, coefficient=10 ** rng.uniform(-2, 0) * np.eye(1))],
        initial_position=[rng.uniform(-2, 2)],
        initial_velocity=[rng.uniform(-3, 3)],
    )


def motion(scene: Scene) -> Array:
    """The motion of order 1 at the points of a run of few steps, ``(n + 1,)``."""
    own = scene.lagrangian.parameters
    c, damping = float(own["c"]), float(scene.active_damping[0].matrix[0, 0])

    def acceleration(t, x, v, z):
        return -(2 * c * x + damping * v) / (1 + 12 * float(own["b"]) * v**2)

    start = scene.initial_position, scene.initial_velocity
    exact = solve_ordinary(acceleration, *start, scene.final_time)
    return exact.position(scene.final_time / COARSE * np.arange(COARSE + 1))[:, 0]


@spread(few=1, order=[0.3, 0.5, 1.0, 1.5, 1.8], group=range(10))
def test_kinetic_energies_of_fourth_powers(order, group):
    """Where an iteration has an end it is the solution: finer steps come near."""
    rng = np.random.default_rng([20, group])
    for _ in range(4):
        scene = quartic(rng, order, rng.uniform(5, 30))
        few, many = (integrate(scene, GAUSS4, k * COARSE) for k in (1, 4))
        if few.status == "failed" or many.status == "failed":
            continue
        finer = many.position[::4, 0]
        exact = motion(scene) if order == 1 else finer
        size = np.abs(exact).max()
        assert np.abs(few.position[:, 0] - exact).max() < 0.7 * size
        # .027 in one of 40 scenes, and .0013 with twice as many steps
        assert np.abs(finer - exact).max() < 0.05 * size


INFINITE = {
    "vx**2/2 + k*x**2/2 + a*x**4/4": lambda x, v, k, a: k * x + a * x**3,
    "vx**2/2 - k*x**2/2 + a*x**4/4": lambda x, v, k, a: -k * x + a * x**3,
    "vx**2/2 + a*x**3/3": lambda x, v, k, a: a * x * x,
    "vx**2/2 + k*x**2/2 + a*x**6/6": lambda x, v, k, a: k * x + a * x**5,
    "vx**2/2 + a*exp(k*x)": lambda x, v, k, a: a * k * np.exp(k * x),
    "(1 + x**2)*vx**2/2 + a*x**6/6": lambda x, v, k, a: (a * x**5 - x * v * v) / (1 + x * x),
    "vx**2/2 + k*vx**4/40 + a*x**10/10": lambda x, v, k, a: a * x**9 / (1 + 0.3 * k * v * v),
}


def infinite(rng: np.random.Generator, order: float) -> tuple[Scene, Method, int, float]:
    """A motion that becomes infinite, a method, a number of steps, and its time without damping."""
    kinds = list(INFINITE)
    while True:
        kind = kinds[rng.integers(len(kinds))]
        k, a = 10 ** rng.uniform(-0.5, 1), 10 ** rng.uniform(-1, 1)
        start, until = [rng.uniform(0.3, 2), rng.uniform(-0.5, 2)], 10 ** rng.uniform(0, 1.5)

        def rates(t, y, rate=INFINITE[kind], k=k, a=a):
            return [y[1], rate(y[0], y[1], k, a)]

        def is_far(t, y, bound=40 / k if "exp" in kind else 1e4):
            return abs(y[0]) - bound

        is_far.terminal = True
        free = solve_ivp(rates, (0, until), start, "DOP853", rtol=1e-11, atol=1e-11, events=is_far)
        if free.status == 1 and free.t[-1] < until / 2:
            break
    scene = lagrangian_scene(
        coordinates=("x",),
        lagrangian=kind,
        parameters={"k": k, "a": a},
        final_time=until,
        damping=[FractionalDamping(order=order, coefficient=10 ** rng.uniform(-5, -2) * np.eye(1))],
        initial_position=[start[0]],
        initial_velocity=[start[1]],
        forcing=Forcing.from_text(f"{rng.uniform(-0.003, 0.003)!r}*sin(t)"),
    )
    methods = [Method(cq="gauss", degree=int(rng.integers(1, 7))) for _ in range(3)]
    methods.append(Method(cq="bdf2", degree=int(rng.integers(1, 4))))
    methods.append(Method(cq="lobatto-iiic", degree=int(rng.integers(2, 5))))
    method = methods[rng.integers(len(methods))]
    return scene, method, int(10 ** rng.uniform(1, 3.3)), float(free.t[-1])


@spread(few=1, group=range(6), order=[0.5, 1.0, 1.5])
def test_no_step_leads_over_an_infinite_motion(group, order):
    rng = np.random.default_rng([21, group])
    for _ in range(5):
        scene, method, n_steps, end = infinite(rng, order)
        found = integrate(scene, method, n_steps)
        h = scene.final_time / n_steps
        assert found.status != "ok"
        assert 0.8 * end - 3 * h < found.time[-1] < 1.1 * end + 8 * h


@pytest.mark.parametrize("seed", range(6))
def test_blocks_that_are_led_far_into_a_wall_come_back(seed):
    """The first iteration of a block leaves for 1e9, whose round-off is no scale of the motion."""
    random = np.random.default_rng([seed, 52])
    steep, v0, duration = random.uniform(40, 60), random.uniform(0.9, 1.1), random.uniform(14, 17)
    scene = lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"vx**2/2-exp({steep}*(x-1))-x**2/2",
        initial_position=[0.0],
        initial_velocity=[v0],
        final_time=duration,
    )
    for n_steps in (1026, int(random.integers(1030, 2000))):
        found = integrate(scene, Method(cq="gauss", degree=3), n_steps)
        assert found.status == "ok"
        assert np.ptp(found.energy) < 1e-8
