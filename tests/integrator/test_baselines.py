"""Baselines: their orders on known solutions, the work they count, and what they refuse."""

import math

import numpy as np
import pytest
from letters import in_pieces, spring, swing
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator import baselines
from fvi_cli.integrator.baselines import trapezoidal_weights
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Baseline, Method

GRUENWALD = Baseline(name="gruenwald-letnikov")
PRODUCT = Baseline(name="product-integration")
FINE = Method(cq="gauss", degree=4, start="graded")
COUNTS = (100, 200, 400, 800)


def damping(order: float, coefficient: object = 0.7) -> FractionalDamping:
    return FractionalDamping(order=order, coefficient=np.asarray(coefficient, dtype=float))


def free(order: float) -> Scene:
    return spring(T=4.0, k=2.0, x=1.0, v=0.5, damping=[damping(order)])


SCENES = {
    **{f"gamma = {order}": free(order) for order in (0.3, 0.5, 1.0, 1.5, 1.9)},
    "three terms": spring(
        T=4.0, x=1.0, v=0.5, damping=[damping(0.5), damping(1.25, 0.2), damping(1.0, 0.1)]
    ),
    "two masses": spring(
        T=4.0,
        m=[[2, 0.3], [0.3, 1]],
        k=[[2, -1], [-1, 2]],
        x=[1.0, -0.3],
        v=[0.5, 0.1],
        damping=[damping(0.5, [[0.5, -0.2], [-0.2, 0.4]])],
    ),
    "pendulum": swing(T=4.0, x=1.0, damping=[damping(0.5, 0.3)]),
    "pendulum, gamma = 1.5": swing(T=4.0, x=1.0, v=0.4, damping=[damping(1.5, 0.3)]),
    "step": spring(T=4.0, damping=[damping(1.5, 0.5)], forcing=in_pieces("8", 1.0, "0")),
    "no damping": swing(T=4.0, x=1.0, v=0.4),
}


def slope(scene: Scene, method: Baseline, counts: tuple[int, ...] = COUNTS) -> float:
    finest = 2 * max(counts)
    reference = integrate(scene, FINE, finest).position
    errors = [
        np.abs(integrate(scene, method, n).position - reference[:: finest // n]).max()
        for n in counts
    ]
    fit, residual = np.polyfit(np.log(counts), np.log(errors), 1, full=True)[:2]
    assert math.sqrt(float(residual[0]) / len(counts)) < 0.05
    return -float(fit[0])


@pytest.mark.few(2)
@spread(few=5, method=[GRUENWALD, PRODUCT], name=SCENES)
def test_orders_are_as_stated(name, method):
    scene = SCENES[name]
    expected = 2.0 if name == "no damping" else method.order
    assert slope(scene, method) == pytest.approx(expected, abs=0.1)


def test_one_wrong_weight_costs_the_order(monkeypatch):
    def wrong(order, step_size, n_weights):
        weights = trapezoidal_weights(order, step_size, n_weights)
        weights[1] *= 1.01
        return weights

    monkeypatch.setattr(baselines, "trapezoidal_weights", wrong)
    with pytest.raises(AssertionError):
        assert slope(SCENES["gamma = 1.5"], PRODUCT) == pytest.approx(2.0, abs=0.1)


def test_gruenwald_letnikov_is_the_textbook_scheme():
    scene = SCENES["gamma = 1.5"]
    n_steps, h = 16, 0.25
    weights = [1.0]
    for n in range(1, n_steps + 1):
        weights.append(weights[-1] * (n - 1 - 1.5) / n)
    x = [1.0, 1.0 + 0.5 * h - h * h / 2 * 2.0]
    for k in range(1, n_steps):
        derivative = h**-1.5 * sum(
            weights[n] * (x[k - n] - 1.0 - 0.5 * h * (k - n)) for n in range(k + 1)
        )
        x.append(2 * x[k] - x[k - 1] - h * h * (0.7 * derivative + 2.0 * x[k]))
    assert integrate(scene, GRUENWALD, n_steps).position[:, 0] == pytest.approx(x, abs=1e-12)


@spread(name=["explicit-euler", "implicit-euler"], order=[0.5, 1.0, 1.5])
def test_euler_is_of_order_1(name, order):
    scene = spring((order, 0.5), T=2.0, x=1.0, v=0.3)
    fine = integrate(scene, Method(cq="gauss", degree=3, start="graded"), 128).position[-1, 0]
    errors = [
        abs(integrate(scene, Baseline(name=name), n).position[-1, 0] - fine)
        for n in (400, 800, 1600)
    ]
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(1.0, abs=0.1)


def test_euler_with_classical_damping_is_the_textbook_scheme():
    scene = spring((1.0, 0.2), T=1.0, v=1.0)
    h, x, v = 0.125, 0.0, 1.0
    y, w = 0.0, 1.0
    for _ in range(8):
        x, v = x + h * v, v + h * (-x - 0.2 * v)
        w = (w - h * y) / (1 + 0.2 * h + h * h)
        y = y + h * w
    explicit = integrate(scene, Baseline(name="explicit-euler"), 8)
    implicit = integrate(scene, Baseline(name="implicit-euler"), 8)
    assert explicit.position[-1, 0] == pytest.approx(x, abs=1e-14)
    assert implicit.position[-1, 0] == pytest.approx(y, abs=1e-14)
