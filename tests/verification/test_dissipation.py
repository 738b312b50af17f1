"""The energy law of the Gauss family, to round-off."""

from __future__ import annotations

import numpy as np
import pytest

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.integrator.integrate import prepare
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stepping import run_steps
from fvi_cli.mathematics.lagrange import LagrangeBasis
from fvi_cli.mathematics.runge_kutta import gauss_tableau
from fvi_cli.mathematics.runge_kutta_weights import left_operator_rk
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
    stepped = run_steps(prepare(scene, Method(cq="gauss", degree=stages), n_steps).problem)
    h, tableau = 6.0 / n_steps, gauss_tableau(stages)
    # velocities at the Gauss points, from the polynomial through the left end and those points
    basis = LagrangeBasis(control_points=np.concatenate([[0.0], tableau.c]))
    inner = stepped.samples - (stepped.position[:-1] - stepped.position[0])[:, None]
    velocity = np.einsum("ni,knd->kid", basis.derivatives(tableau.c)[1:], inner) / h
    shifted = velocity - (v0 if order > 1 else 0.0)
    works = []
    for theta in (order - 1, order - 0.999):
        force = 0.4 * left_operator_rk(tableau, theta, h, shifted)
        works.append(h * float(np.einsum("i,kid,kid->", tableau.b, velocity, force)))
    energy = scene.energy(stepped.position, stepped.momentum)
    return energy, works[0], works[1]


@pytest.mark.parametrize("stages", [1, 2, 3])
@pytest.mark.parametrize("order", [0.3, 0.8, 1.4])
@pytest.mark.parametrize("stiffness", [1.0, 1e4, 1e8])
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
