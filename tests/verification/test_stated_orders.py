"""An order that is stated is the one measured, or none is: forces and energies with kinks."""

import math
from dataclasses import replace

import numpy as np
import pytest
from letters import in_pieces, spring
from oracles.ordinary import solve_ordinary
from scipy.special import gamma
from spread import spread

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.planning.expected_order import expected_order
from fvi_cli.planning.unsmooth_forces import has_kinks
from fvi_cli.scenes.lagrangian import lagrangian_scene

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
        Method(cq="radau-iia", degree=2),
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
    stated = expected_order(scene, method, "max", LADDER[-1])
    # a time behind b is known to the last place of b alone
    floor = max(ROUND_OFF, 20 * 2.0 ** (-52 * (1 + power)))
    measured = slopes([error for error in errors if error > floor])
    assert not math.isnan(stated)
    assert (measured > stated - 0.35).all(), (stated, errors)
    if method.start == "none" and power in (0.5, -0.4, 0.1):
        # not lower than it is either
        assert (measured < stated + 0.35).all(), (stated, errors)


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
    assert expected_order(scene, plain, "max", 128) == 1.5


@pytest.mark.few(2)
@pytest.mark.parametrize("dampers", [(), ((0.5, 0.3),), ((1.5, 0.3),)])
@pytest.mark.parametrize("begins", [0.0, 1.0])
def test_starting_weights_mend_no_moments_of_a_singular_force(begins, dampers):
    """They correct derivatives of the motion: the rule of the action errs as without them."""
    force = "1 + sqrt(t)" if begins == 0 else in_pieces("1", begins, f"1 + sqrt(t - {begins})")
    scene = spring(*dampers, T=2.0, x=1.0, forcing=force)
    exact = integrate(scene, Method(cq="gauss", degree=6, start="graded"), 256).position[-1, 0]
    method = Method(cq="bdf3", degree=3, start="weights")
    errors = [abs(integrate(scene, method, n).position[-1, 0] - exact) for n in LADDER]
    assert slopes(errors) == pytest.approx([1.5, 1.5], abs=0.1)
    assert expected_order(scene, method, "max", LADDER[-1]) == 1.5
    # exact moments leave what the weights correct
    control = replace(method, forcing_quadrature="exact")
    assert expected_order(scene, control, "max", LADDER[-1]) > 1.9


@spread(power=[1.5, 2.5, 1.1, 3.0, 3.7], place=[0.0, 0.31, -1.7, 1e-6], scale=[1.0, 1e3, 1e-3])
def test_kinks_of_a_potential(power, place, scale):
    """V = |x - b|^a: a motion through b has no order that follows from the method."""

    def well(inner: str) -> Scene:
        return lagrangian_scene(
            final_time=8.0,
            coordinates=("x",),
            lagrangian=f"vx**2/2 - {inner}",
            initial_position=[scale * (place + 1.0)],
        )

    method = Method(cq="gauss", degree=3)
    kinked = well(f"abs(x/{scale!r} - {place!r})**{power!r}")
    assert math.isnan(expected_order(kinked, method, "max", 64))
    smooth = well(f"(1 + (x/{scale!r} - {place!r})**2)**{power / 2!r}")
    assert expected_order(smooth, method, "max", 64) == 6.0


def test_what_a_kink_costs():
    """The claim of 6 would have been wrong, against Dormand and Prince's method."""
    scene = lagrangian_scene(
        final_time=4.0,
        coordinates=("x",),
        lagrangian="vx**2/2 - abs(x)**1.5",
        initial_position=[1.0],
    )
    exact = solve_ordinary(
        lambda t, x, v, z: -1.5 * np.sign(x) * np.abs(x) ** 0.5, [1.0], [0.0], 4.0
    )
    errors = []
    for n_steps in (64, 1024):
        found = integrate(scene, Method(cq="gauss", degree=3), n_steps)
        errors.append(np.abs(found.position - exact.position(found.time)).max())
    assert math.log2(errors[0] / errors[1]) / 4 < 3


PLANE = {
    "((x - y)**2)**0.75": True,
    "abs(x + 2*y - 0.3)**3": True,
    "cbrt(x - y)**4": True,
    "sign(x)*x**3": True,
    "abs(1 - x**2 - y**2)": True,
    "(sqrt(x**2 + y**2) - 1)**2": False,
    "1/sqrt(x**2 + (y - 2)**2)": False,
    "sqrt(1 + (x - y)**2)": False,
    "abs(1 + x**2)**1.5": False,
    "x**2*y**2 + cosh(x)": False,
}


@pytest.mark.parametrize("energy", PLANE)
@pytest.mark.parametrize("kinetic", ["(vx**2 + vy**2)/2", "-sqrt(1 - vx**2 - vy**2)"])
def test_which_energies_have_kinks(energy, kinetic):
    scene = lagrangian_scene(
        final_time=1.0,
        coordinates=("x", "y"),
        lagrangian=f"{kinetic} - {energy}",
        initial_position=[0.7, 0.1],
        initial_velocity=[0.2, 0.3],
    )
    assert has_kinks(scene) == PLANE[energy]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("abs(t - 1.2345)**1.5", True),
        ("abs(sin(7*t))", True),
        ("sqrt((t - 0.7)**2)", True),
        ("sqrt(t)", False),
        ("abs(1 + t)", False),
        ("t**0.3 + exp(-t)", False),
    ],
)
def test_which_forces_have_kinks(text, expected):
    scene = spring(T=3.0, forcing=text)
    assert has_kinks(scene) == expected
    stated = expected_order(scene, Method(cq="gauss", degree=2), "max", 64)
    assert math.isnan(stated) == expected
    # a number may have a name
    named = Expression.parse(text.replace("7*t", "rate*t"), ("t",), {"rate": 7.0})
    piece = ForcingPiece(components=(named,))
    assert has_kinks(spring(T=3.0, forcing=Forcing(pieces=(piece,)))) == expected
    # a kink at the end of a piece is at the end of a step
    at_break = spring(T=3.0, forcing=in_pieces("abs(t - 1.5)", 1.5, "abs(t - 1.5)"))
    assert not has_kinks(at_break)
