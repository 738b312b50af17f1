"""Long runs: the algebraic tail, a million steps without damping, resonance and beats."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.transforms.characteristic import CharacteristicSum, characteristic_zeros
from fvi_cli.scenes.linear_response import linear_response
from fvi_cli.scenes.named import linear_oscillator
from fvi_cli.scenes.relaxation import LinearResponse, product
from fvi_cli.studies.hard_cases.case import Claim, HardCase, Setting
from fvi_cli.studies.hard_cases.judging import LAPLACE, accurate, against, largest_ratio
from fvi_cli.studies.hard_cases.linear_cases import oscillator

TAIL_AT_1000 = {0.5: 0.0178323072601, 1.5: -8.92055356e-6}
"""x(1000) of x'' + D^g x + x = 0, x(0) = 1: characteristic roots, checked by 150-digit Talbot."""


def algebraic_tail() -> HardCase:
    """The power of t that remains when the oscillation is gone."""
    claims: list[Claim] = []
    for order, value in TAIL_AT_1000.items():
        setting = Setting(oscillator(order, 1.0, 1e4, position=1.0), 40000)
        claims += [
            Claim(
                f"relative error at t = 1000, g = {order:g}",
                1e-6,
                (setting,),
                _relative_error_at(1000.0, value),
            ),
            Claim(
                f"relative error at t = 10000, g = {order:g}",
                1e-6,
                (setting,),
                _relative_error_at(1e4, _tail(order, 1e4)),
            ),
        ]
    return HardCase(
        name="algebraic-tail",
        title="algebraic tail up to t = 10^4",
        description="x'' + D^g x + x = 0, x(0) = 1; x ~ t^-g / Gamma(1 - g), negative for g = 1.5; "
        "40,000 steps on [0, 10^4]",
        reference=f"{LAPLACE}; at t = 1000 by Talbot's contour too",
        claims=tuple(claims),
    )


def _tail(order: float, time: float) -> float:
    response = linear_response(mass=1.0, stiffness=1.0, damping=((order, 1.0),), position=1.0)
    return float(response(np.array([time]))[0])


def _relative_error_at(time: float, exact: float) -> Callable[[Trajectory], float]:
    def judge(trajectory: Trajectory) -> float:
        index = round(time / trajectory.step_size)
        return abs(float(trajectory.position[index, 0]) / exact - 1.0)

    return judge


def million_steps() -> HardCase:
    """Nothing is lost and nothing is gained without damping."""
    setting = Setting(linear_oscillator(final_time=5e4, initial_position=1.0), 1_000_000)

    def energy_drift(trajectory: Trajectory) -> float:
        if trajectory.energy is None:
            return math.nan
        return largest_ratio(trajectory.energy - trajectory.energy[0], trajectory.energy[:1])

    return HardCase(
        name="million-steps",
        title="10^6 steps without damping",
        description="x'' + x = 0, x(0) = 1; 10^6 steps of 0.05",
        reference="cos t",
        claims=(
            Claim("largest change of the energy", 1e-10, (setting,), energy_drift),
            against("error of the position", 1e-6, setting, np.cos),
        ),
    )


def resonance() -> HardCase:
    """A force at the frequency at which the oscillator answers most."""
    n_steps, final_time = 1600, 200.0
    scene = linear_oscillator(
        final_time=final_time, forcing=Forcing.from_text("cos(t)"), initial_position=0.0
    )
    claims = [
        against(
            "relative error without damping",
            1e-7,
            Setting(scene, n_steps),
            lambda t: t * np.sin(t) / 2.0,
        )
    ]
    for order, frequency in ((0.5, 1.0177), (1.5, 0.9823)):
        scene = linear_oscillator(
            final_time=final_time,
            damping=[FractionalDamping(order=order, coefficient=0.05)],
            forcing=Forcing.from_text(f"cos({frequency!r}*t)"),
        )
        claims.append(
            against(
                f"relative error, g = {order:g}",
                1e-7,
                Setting(scene, n_steps),
                functools.partial(_harmonic, order, 0.05, frequency),
                parts=8,
            )
        )
    return HardCase(
        name="resonance",
        title="resonance",
        description="x'' + mu D^g x + x = cos(w t) from rest: mu = 0, w = 1; mu = 0.05, g = 0.5, "
        "w = 1.0177; g = 1.5, w = 0.9823; 1600 steps on [0, 200]",
        reference=f"t sin(t)/2; {LAPLACE}, at 8 times",
        claims=tuple(claims),
    )


def _harmonic(order: float, coefficient: float, frequency: float, time: Array) -> Array:
    return harmonic_response(order, coefficient, frequency)(time)


@functools.lru_cache(maxsize=16)
def harmonic_response(order: float, coefficient: float, frequency: float) -> LinearResponse:
    r"""Solution of :math:`x'' + \mu D^\gamma x + x = \cos \omega t` from rest.

    Its transform :math:`s / ((s^2 + \omega^2) (s^2 + \mu s^\gamma + 1))` is a quotient of sums of
    powers.
    """
    damped = {2.0: 1.0, order: coefficient, 0.0: 1.0}
    below = product(damped, {2.0: 1.0, 0.0: frequency**2})
    whole = CharacteristicSum(terms=tuple(sorted(below.items(), reverse=True)))
    zeros = characteristic_zeros(whole)
    return LinearResponse(characteristic=whole, inputs=((0.0, {1.0: 1.0}),), zeros=zeros)


def beats() -> HardCase:
    """Weakly coupled oscillators that hand their energy to and fro; a force beside resonance."""
    pair = Setting(_weakly_coupled(0.5), 2048)
    above = Setting(_weakly_coupled(1.5), 2048)
    forced = Setting(
        linear_oscillator(final_time=256.0, forcing=Forcing.from_text("cos(0.95*t)")), 2048
    )
    return HardCase(
        name="beats",
        title="beats",
        description="two oscillators, x'' + D^g x/1000 + x + (x - y)/20 = 0 and the same for y, "
        "x(0) = 1, y(0) = 0, g = 0.5, 1.5; x'' + x = cos(0.95 t) from rest; 2048 steps on [0, 256]",
        reference=f"{LAPLACE}; elementary functions",
        claims=(
            accurate("relative error, g = 0.5", 1e-7, pair),
            accurate("relative error, g = 1.5", 1e-7, above),
            against(
                "relative error, forced",
                1e-7,
                forced,
                lambda t: (np.cos(0.95 * t) - np.cos(t)) / (1.0 - 0.95**2),
            ),
        ),
    )


def _weakly_coupled(order: float) -> Scene:
    return linear_oscillator(
        final_time=256.0,
        mass=np.eye(2),
        stiffness=np.array([[1.05, -0.05], [-0.05, 1.05]]),
        damping=[FractionalDamping(order=order, coefficient=1e-3 * np.eye(2))],
        initial_position=[1.0, 0.0],
        initial_velocity=[0.0, 0.0],
    )
