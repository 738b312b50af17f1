"""Scenes whose numbers are drawn, by a seed: of every kind that the engine steps."""

import numpy as np

import fvi_cli.api as fvi
from fvi_cli.effects.scene import Scene
from fvi_cli.scenes.lagrangian import double_pendulum

RNG = np.random.default_rng


def oscillator(seed: int, orders: tuple[float, ...], **more: object) -> Scene:
    rng = RNG(seed)
    size = 10.0 ** rng.uniform(-3, 3)
    omega = rng.uniform(0.3, 3.0)
    given = {
        "stiffness": omega**2,
        "initial_position": size * rng.uniform(0.5, 1.0),
        "initial_velocity": size * rng.uniform(-1.0, 1.0),
        "final_time": 8.0,
        "damping": tuple(
            fvi.FractionalDamping(order=one, coefficient=rng.uniform(0.1, 0.7)) for one in orders
        ),
    }
    return fvi.linear_oscillator(**{**given, **more})


def pendulum(seed: int, orders: tuple[float, ...] = (0.5,)) -> Scene:
    rng = RNG(seed)
    return fvi.pendulum(
        omega=rng.uniform(0.5, 2.0),
        damping=tuple(
            fvi.FractionalDamping(order=one, coefficient=rng.uniform(0.1, 0.5)) for one in orders
        ),
        initial_position=rng.uniform(-2.5, 2.5),
        initial_velocity=rng.uniform(-1.0, 1.0),
        final_time=20.0,
    )


def chain(seed: int, d: int, *, decouples: bool, orders: tuple[float, ...] = (0.5, 1.5)) -> Scene:
    rng = RNG(seed)
    laplace = 2 * np.eye(d) - np.eye(d, k=1) - np.eye(d, k=-1)
    rows = rng.normal(size=(d, d))
    damping = (laplace, laplace) if decouples else (laplace, rows @ rows.T / d)
    return fvi.linear_oscillator(
        mass=np.eye(d) if decouples else np.diag(rng.uniform(0.5, 2.0, d)),
        stiffness=10 * laplace,
        damping=tuple(
            fvi.FractionalDamping(order=order, coefficient=0.1 * matrix)
            for order, matrix in zip(orders, damping, strict=True)
        ),
        initial_position=rng.normal(size=d),
        initial_velocity=rng.normal(size=d),
        final_time=10.0,
    )


def two_joints(seed: int, order: float = 0.5) -> Scene:
    rng = RNG(seed)
    matrix = rng.uniform(0.1, 0.3) * np.array([[2.0, -1.0], [-1.0, 1.0]])
    return double_pendulum(
        initial_position=rng.uniform(-1.0, 1.0, 2),
        initial_velocity=rng.uniform(-0.3, 0.3, 2),
        final_time=4.0,
        damping=(fvi.FractionalDamping(order=order, coefficient=matrix),),
    )
