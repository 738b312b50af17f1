r"""Scenes by the letters of :math:`m x'' + \sum_j c_j D^{g_j} x + k x = f(t)`, up to t = T."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate_members
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.data import pendulum
from fvi_cli.scenes.structures import linear_oscillator

WORDS = {
    "T": "final_time",
    "m": "mass",
    "k": "stiffness",
    "x": "initial_position",
    "v": "initial_velocity",
}


def spring(*damping: tuple[float, Any], **data: Any) -> Scene:
    """An oscillator with terms of damping as pairs (g, c); `x`, `v` are those at the start."""
    return linear_oscillator(**in_words(damping, data))


def oscillator(
    final_time: float = 100.0,
    *,
    mass: Any = 1.0,
    stiffness: Any = 1.0,
    damping: tuple[tuple[float, Any], ...] = ((1.5, 1.0),),
    **more: Any,
) -> Scene:
    """All components from 1, at rest; of the equation whose solution the paper sees blow up."""
    mass = np.atleast_2d(mass)
    d = mass.shape[0]
    return spring(*damping, T=final_time, m=mass, k=stiffness, x=np.ones(d), v=np.zeros(d), **more)


def swing(*damping: tuple[float, Any], **data: Any) -> Scene:
    """The same with omega^2 sin x in the place of k x."""
    return pendulum(**in_words(damping, data))


def in_pieces(*parts: str | float) -> Forcing:
    """A force of texts and the times between them: 8 up to t = 1, then 0 is ("8", 1.0, "0")."""
    ends = (*parts[1::2], math.inf)
    return Forcing(
        pieces=tuple(
            replace(Forcing.from_text(text).pieces[0], until=end)
            for text, end in zip(parts[::2], ends, strict=True)
        )
    )


def observe_one(
    scene: Scene, method: AnyMethod, n_steps: AnySteps, request: Observations, **options: Any
) -> Trajectory:
    """One scene integrated and observed."""
    (found,) = integrate_members([scene], method, n_steps, observe=[request], **options)
    return found


def in_words(damping: tuple[tuple[float, Any], ...], data: dict[str, Any]) -> dict[str, Any]:
    """The data of a scene; a force may be a text."""
    terms = [FractionalDamping(order=order, coefficient=value) for order, value in damping]
    found = {"damping": terms, **{WORDS.get(key, key): value for key, value in data.items()}}
    if isinstance(found.get("forcing"), str):
        found["forcing"] = Forcing.from_text(found["forcing"])
    return found
