"""The energy law of the Gauss family, to round-off."""

from __future__ import annotations

import numpy as np
import pytest
from spread import spread
from written_out import left_operator_rk

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.runge_kutta import gauss_tableau
from fvi_cli.scenes.named import linear_oscillator


def energy_and_work(
    stages: int, order: float, stiffness: float, v0: float, n_steps: int = 48
) -> tuple[np.ndarray, float, float]:
    """Energies, h sum b V.F with F from the public operator, and the same for a wrong order."""
    scene = linear_oscillator(
        final_time=6.0,
        stiffness=stiffness,
        damping=[FractionalDamping(order=order, coefficient=0.4)],
        initial_position=1.0,
        initial_velocity=v0,
    )
    method, tableau, h = Method(cq="gauss", degree=stages), gauss_tableau(stages), 6.0 / n_steps
    found = integrate(scene, method, n_steps, with_steps=True)
    assert found.steps is not None
    assert found.momentum is not None
    velocity = found.steps.velocity
    shifted = velocity - (v0 if order > 1 else 0.0)
    works = []
    for theta in (order - 1, order - 0.999):
        force = 0.4 * left_operator_rk(tableau, theta, h, shifted)
        works.append(h * float(np.einsum("i,kid,kid->", tableau.b, velocity, force)))
    energy = scene.energy(found.position, found.momentum)
    return energy, works[0], works[1]


@spread(stages=[1, 2, 3], order=[0.3, 0.8, 1.4], stiffness=[1.0, 1e4, 1e8])
def test_energy_is_lost_exactly_as_the_damping_works(
    stages: int, order: float, stiffness: float
) -> None:
    energy, work, wrong = energy_and_work(stages, order, stiffness, v0=0.0)
    assert abs(energy[-1] - energy[0] + work) <= 1e-11 * energy[0]
    assert work >= 0
    if stiffness == 1.0:
        assert abs(energy[-1] - energy[0] + wrong) > 1e-5 * energy[0]


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_balance_with_caputo_above_1_and_a_velocity(stages: int) -> None:
    """Energy may grow at first; the balance holds all the same."""
    energy, work, _ = energy_and_work(stages, 1.5, 2.0, v0=0.7)
    assert abs(energy[-1] - energy[0] + work) <= 1e-11 * energy[0]
