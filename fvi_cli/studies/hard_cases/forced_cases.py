"""Forces that jump, and starts that contain every singular power."""

from __future__ import annotations

import math

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.named import linear_oscillator
from fvi_cli.studies.hard_cases.case import HardCase, Setting
from fvi_cli.studies.hard_cases.judging import LAPLACE, accurate

HALF_PERIOD = 2.0
HALF_PERIODS = 20


def square_wave() -> Forcing:
    """The force 1, -1, 1, ... with a jump after every half period."""
    up, down = (Expression.parse(text, variables=("t",)) for text in ("1", "-1"))
    return Forcing(
        pieces=tuple(
            ForcingPiece(
                components=(down if index % 2 else up,),
                until=HALF_PERIOD * (index + 1) if index < HALF_PERIODS - 1 else math.inf,
            )
            for index in range(HALF_PERIODS)
        )
    )


def jumps_at_every_period() -> HardCase:
    """A square wave."""

    def setting(order: float) -> Setting:
        scene = linear_oscillator(
            final_time=HALF_PERIOD * HALF_PERIODS,
            damping=[FractionalDamping(order=order, coefficient=0.3)],
            forcing=square_wave(),
        )
        return Setting(scene, 800)

    return HardCase(
        name="jumps-at-every-period",
        title="a force that jumps at every half period",
        description="x'' + 0.3 D^g x + x = 1, -1, 1, ... changing 19 times, from rest; "
        "800 steps on [0, 40]",
        reference=LAPLACE,
        claims=tuple(
            accurate(f"relative error, g = {order:g}", 1e-9, setting(order))
            for order in (0.5, 1.0, 1.5)
        ),
    )


def every_singular_power() -> HardCase:
    """Several orders, both start values and a singular force at once."""

    def scene(orders: tuple[float, ...]) -> Scene:
        return linear_oscillator(
            final_time=8.0,
            stiffness=2.0,
            damping=[FractionalDamping(order=order, coefficient=0.3) for order in orders],
            forcing=Forcing.from_text("sqrt(t) + t**(1/3)"),
            initial_position=1.0,
            initial_velocity=0.7,
        )

    claims = []
    for orders in ((0.5, 1.5), (0.3, 0.7, 1.4), (0.1, 0.9, 1.1, 1.9)):
        listed = ", ".join(f"{order:g}" for order in orders)
        claims.append(accurate(f"relative error, g = {listed}", 1e-9, Setting(scene(orders), 256)))
    return HardCase(
        name="every-singular-power",
        title="a start that excites every singular power",
        description="x'' + 0.3 sum D^g x + 2 x = t^(1/2) + t^(1/3), x(0) = 1, x'(0) = 0.7; "
        "256 steps on [0, 8]",
        reference=LAPLACE,
        claims=tuple(claims),
    )
