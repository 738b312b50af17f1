"""A double pendulum through chaos: its path cannot be predicted, its energy balance can."""

from __future__ import annotations

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.memory_work import fractional_integral, work_along
from fvi_cli.scenes.lagrangian import double_pendulum
from fvi_cli.studies.hard_cases.case import Claim, HardCase, Setting

ORDER, COEFFICIENT = 0.5, 0.005
N_STEPS, FINAL_TIME = 2000, 50.0
HANGING_ENERGY = -3.0
"""Of two unit masses on unit rods at rest; energies are measured from here."""

MOVED = 1e-6


def chaotic_double_pendulum() -> HardCase:
    """Two rods that turn over, with weakly damped joints."""
    first, second = _setting(0.0), _setting(MOVED)

    def defect(trajectory: Trajectory) -> float:
        return energy_defect(first.scene, trajectory)

    return HardCase(
        name="chaotic-double-pendulum",
        title="a double pendulum through chaos",
        description="unit masses and rods, joints 0.005 D^0.5, released at angles 2 and 2.5; "
        "2000 steps on [0, 50]",
        reference="work of the joints by quintic splines of the velocities, fractional integrals "
        "of their pieces exact",
        claims=(
            Claim("defect of the energy balance", 1e-6, (first,), defect, is_comparable=False),
            Claim(
                "angle between two paths that start 1e-6 apart",
                0.1,
                (first, second),
                _separation,
                sense="at least",
                is_comparable=False,
            ),
        ),
    )


def energy_defect(scene: Scene, trajectory: Trajectory) -> float:
    r"""Largest :math:`|E(t) + W(t) - E(0)|` over the energy at the start, above hanging at rest.

    Parameters
    ----------
    scene
        A general Lagrangian with damping of orders below 1.
    trajectory
        Its motion.
    """
    lagrangian = scene.lagrangian
    momentum, energy = trajectory.momentum, trajectory.energy
    if lagrangian is None or momentum is None or energy is None:
        raise ValueError("hard case: an energy balance needs a Lagrangian, momenta and energies")
    velocity = lagrangian.velocity(trajectory.position, momentum, trajectory.time)
    force = np.zeros_like(velocity)
    for term in scene.active_damping:
        memory = fractional_integral(1.0 - term.order, trajectory.step_size, velocity)
        force += memory @ term.coefficient
    work = work_along(force, velocity, trajectory.step_size)
    return float(np.abs(energy + work - energy[0]).max() / (energy[0] - HANGING_ENERGY))


def _setting(moved: float) -> Setting:
    scene = double_pendulum(
        final_time=FINAL_TIME,
        joints=[(ORDER, COEFFICIENT)],
        initial_position=[2.0, 2.5 + moved],
    )
    return Setting(scene, N_STEPS)


def _separation(first: Trajectory, second: Trajectory) -> float:
    return float(np.abs(first.position - second.position).max())
