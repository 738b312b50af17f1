"""Dampers of Riemann-Liouville derivatives above order 1 with a start velocity, and starts."""

import mpmath
import numpy as np
import pytest
from letters import spring

import fvi_cli as fvi
from fvi_cli.effects.matrices import Factored
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.observations import dampers

TIMES = np.array([0.1, 1.0, 2.5, 5.0])
ORDERS = np.random.default_rng(63).uniform(1.3, 1.97, 4).tolist()


def exact(order, power, times=TIMES):
    """x, its rate (power 0, 1) or derivative of any power, by Laplace inversion."""

    def transform(s):
        return s**power / (s**2 + 0.5 * s**order + 1)

    return np.array([float(mpmath.invertlaplace(transform, t, method="talbot")) for t in times])


def observed(order, derived=("force_1", "work_1"), **changes):
    scene = spring((order, 0.5), T=5.0, v=1.0, derivative="riemann-liouville", **changes)
    return fvi.integrate(
        scene, "gauss4", 160, output=TIMES, quantities={name[0]: name for name in derived}
    )


def wrong(order):
    """Errors of force and work of the one damper."""
    found = observed(order).observed.quantities
    force = 0.5 * exact(order, order)
    work = 0.5 - 0.5 * exact(order, 0) ** 2 - 0.5 * exact(order, 1) ** 2
    return np.abs(found["f"] - force).max(), np.abs(found["w"] - work).max()


@pytest.mark.few(2)
@pytest.mark.parametrize("order", [1.95, *ORDERS])
def test_force_and_work_of_a_damper_above_order_1(order):
    assert max(wrong(order)) < 1e-4


def test_raw_forces_at_the_stages_are_seen(monkeypatch):
    # the control: the memory at the stages in place of the balances
    monkeypatch.setattr(dampers, "rough_dampers", lambda scene: ())
    force, work = wrong(1.95)
    assert force > 1.0
    assert work > 1e-3


def test_an_infinite_start_is_said():
    run = observed(1.95)
    assert any("force_1 is infinite at t = 0" in one for one in run.remarks)
    assert not any("keeps an error" in one for one in run.remarks)


@pytest.mark.parametrize("order", [1.95, 1.8, *ORDERS[:2]])
def test_momenta_and_energies_behind_an_adaptive_start(order):
    scene = spring((order, 0.5), T=5.0, v=1.0, derivative="riemann-liouville")
    steps = AdaptiveSteps(tolerance=1e-8)
    run = fvi.integrate(scene, "gauss12", steps)
    rate, place = (exact(order, power, run.time[1:4]) for power in (1, 0))
    assert run.momentum[1:4, 0] == pytest.approx(rate, abs=2e-3)
    assert run.energy[1:4] == pytest.approx(0.5 * rate**2 + 0.5 * place**2, abs=2e-3)


@pytest.mark.parametrize(("order", "x", "v"), [(1.95, 0.0, 1.0), (1.3, 0.0, 2.0), (0.95, 1.0, 0.0)])
def test_initial_data_of_a_run_of_most_stages(order, x, v):
    """The motion of 12 stages has no second run; its polynomials do not begin at the data."""
    scene = spring((order, 0.5), T=5.0, x=x, v=v, derivative="riemann-liouville")
    steps = AdaptiveSteps(tolerance=1e-8)
    run = fvi.integrate(scene, "gauss12", steps, output=[0.0, 1.0], quantities={"v": "vx"})
    assert run.observed.quantities["v"][0] == v
    assert run.momentum[0, 0] == v
    assert run.energy[0] == pytest.approx(0.5 * (x**2 + v**2), abs=1e-15)
    if v:
        assert run.observed.extents["v"].peak == v


def test_dampers_of_independent_directions():
    """One on x1 alone, one on x2 alone: each has the closed form of one oscillator."""

    def along(row):
        return Factored(rows=np.array([row]), inner=np.array([[0.5]]))

    scene = spring(
        (1.9, along([1.0, 0.0])),
        (1.6, along([0.0, 1.0])),
        T=5.0,
        m=np.eye(2),
        k=np.eye(2),
        x=[0.0, 0.0],
        v=[1.0, 1.0],
        derivative="riemann-liouville",
    )
    names = {"f": "force_1", "g": "force_2"}
    run = fvi.integrate(scene, "gauss4", 160, output=TIMES, quantities=names)
    for name, order in (("f", 1.9), ("g", 1.6)):
        found = run.observed.quantities[name]
        assert found == pytest.approx(0.5 * exact(order, order), abs=1e-6)
