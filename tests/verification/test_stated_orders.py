"""An order that is stated is the one measured, or none is: forces with powers behind a break."""

import math

import numpy as np
import pytest
from letters import in_pieces, spring
from scipy.special import gamma
from spread import spread

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.graded import order_on
from fvi_cli.integrator.method import Method

LADDER = (256, 512, 1024)
ROUND_OFF = 5e-13


def slopes(errors: list[float]) -> np.ndarray:
    return np.log2(np.array(errors[:-1]) / errors[1:])


def late(power: float, begin: float, final_time: float) -> Scene:
    """x'' + x = (t - b)^a behind b, from rest."""
    force = in_pieces("0", begin, f"(t - {begin!r})**{power!r}")
    return spring(T=final_time, forcing=force)


def late_motion(power: float, begin: float, times: np.ndarray) -> np.ndarray:
    r"""Its motion, :math:`\Gamma(a + 1) \tau^{a + 2} E_{2, a + 3}(-\tau^2)`."""
    behind = np.maximum(times - begin, 0.0)
    terms = [
        (-1) ** k * gamma(power + 1) * behind ** (power + 2 + 2 * k) / gamma(power + 3 + 2 * k)
        for k in range(40)
    ]
    return np.sum(terms, axis=0)


@spread(
    power=[0.5, -0.4, 1.5, 0.1, 2.7, 1.0, 0.0],
    place=[0.25, 0.5, 0.75],
    final_time=[4.0, 1.37],
    method=[
        Method(cq="gauss", degree=3),
        Method(cq="gauss", degree=3, start="graded"),
        Method(cq="gauss", degree=2, start="graded", forcing_quadrature="exact"),
        Method(cq="gauss", degree=2, forcing_quadrature="exact"),
    ],
)
def test_powers_of_a_force_behind_a_break(power, place, final_time, method):
    begin = place * final_time
    scene = late(power, begin, final_time)
    errors = []
    for n_steps in LADDER:
        found = integrate(scene, method, n_steps)
        exact = late_motion(power, begin, found.time)
        errors.append(np.abs(found.position[:, 0] - exact).max() + 1e-300)
    stated = order_on(scene, method)
    # a time behind b is known to the last place of b alone
    floor = max(ROUND_OFF, 20 * 2.0 ** (-52 * (1 + power)))
    measured = slopes([error for error in errors if error > floor])
    if method.start == "graded" or power == int(power):
        assert (measured > stated - 0.35).all(), (stated, errors)
    elif power < 1:
        # none is stated where it is lost
        assert math.isnan(stated)
        assert (measured < method.order - 0.35).all(), errors


def test_without_the_power_the_order_is_lost():
    """The control: the mesh that only knows of jumps."""
    scene = late(0.5, 1.0, 4.0)
    plain = Method(cq="gauss", degree=3)
    errors = [
        np.abs(
            integrate(scene, plain, n).position[:, 0]
            - late_motion(0.5, 1.0, np.linspace(0, 4, n + 1))
        ).max()
        for n in LADDER
    ]
    assert slopes(errors) == pytest.approx([1.5, 1.5], abs=0.1)
    assert math.isnan(order_on(scene, plain))
