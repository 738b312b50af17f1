"""Forces that are known at samples: values between them, expansions, and what they refuse."""

import numpy as np
import pytest

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.structures import linear_oscillator

TIME = np.array([0.0, 0.3, 1.0, 1.2, 2.0])
VALUES = np.array([1.0, -2.0, 0.5, 4.0, 3.0])


def at(force: SampledForce, time: np.ndarray) -> np.ndarray:
    return np.asarray(force.evaluate({"t": time}))


def test_straight_lines_are_those_of_numpy():
    force = SampledForce.through(TIME, VALUES, "linear")
    time = np.linspace(0.0, 2.0, 501)
    np.testing.assert_allclose(at(force, time), np.interp(time, TIME, VALUES), atol=1e-14)


def test_the_spline_has_two_continuous_derivatives_and_gives_cubics_back():
    force = SampledForce.through(TIME, VALUES, "cubic")
    np.testing.assert_allclose(at(force, TIME), VALUES, atol=1e-13)
    for place in range(1, TIME.size - 1):
        before = np.poly1d(force.coefficients[:, place - 1])
        after = np.poly1d(force.coefficients[:, place])
        width = TIME[place] - TIME[place - 1]
        for times in (1, 2):
            assert before.deriv(times)(width) == pytest.approx(after.deriv(times)(0.0), rel=1e-10)
    # the third one jumps at the knot in the middle
    assert abs(force.coefficients[0, 1] - force.coefficients[0, 2]) > 1.0
    cubic = np.poly1d([1.0, -2.0, 0.5, 3.0])
    time = np.linspace(0.0, 2.0, 101)
    through = SampledForce.through(TIME, cubic(TIME), "cubic")
    np.testing.assert_allclose(at(through, time), cubic(time), atol=1e-13)
    # straight lines through the same samples do not
    lines = SampledForce.through(TIME, cubic(TIME), "linear")
    assert np.abs(at(lines, time) - cubic(time)).max() > 0.1


def test_values_that_hold_until_the_next():
    """One-sided on steps that begin and end at the jumps, and a motion by its own formula."""
    force = SampledForce.through(TIME, VALUES, "previous")
    assert at(force, np.array([0.0, 0.29, 0.3, 0.99, 1.1, 1.9])).tolist() == [1, 1, -2, -2, 0.5, 4]
    forcing = Forcing(pieces=(ForcingPiece(components=(force,)),))
    starts = np.array([0.3, 1.0])
    for start, value in zip(starts, VALUES[1:3], strict=True):
        width = TIME[start < TIME][0] - start
        found = forcing.on_steps(np.array([start]), width, np.array([0.0, 0.5, 1.0]))
        assert found.ravel().tolist() == [value] * 3
    scene = linear_oscillator(stiffness=0.0, final_time=2.0, forcing=forcing)
    run = integrate(scene, Method(cq="gauss", degree=3), 20)
    exact = sum(
        change * np.maximum(run.time - begin, 0.0) ** 2 / 2
        for begin, change in zip(TIME[:-1], np.diff(VALUES[:-1], prepend=0.0), strict=True)
    )
    np.testing.assert_allclose(run.position[:, 0], exact, atol=1e-13)
