"""Forces that would be taken beyond their samples, or through an infinite impulse, are refused."""

import random

import numpy as np
import pytest

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.mathematics.expressions import Expression, slopes_of
from fvi_cli.mathematics.intervals.singularities import pole_inside
from fvi_cli.scenes.data import linear_oscillator


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_samples_must_reach_to_the_end(scale):
    time = scale * np.linspace(0.0, 2.0, 9)
    refused = Forcing.from_samples(time, np.cos(time / scale))
    with pytest.raises(ValueError, match=r"forcing: component 1 has samples from 0 to .*beyond="):
        linear_oscillator(final_time=2.5 * scale, forcing=refused)
    late = Forcing.from_samples(time + scale, np.cos(time / scale))
    with pytest.raises(ValueError, match="acts from 0 to"):
        linear_oscillator(final_time=2.0 * scale, forcing=late)
    # the controls
    linear_oscillator(final_time=2.0 * scale * (1 + 1e-12), forcing=refused)
    ended = Forcing.from_samples(time, np.cos(time / scale), beyond="zero")
    linear_oscillator(final_time=2.5 * scale, forcing=ended)


@pytest.mark.few(6)
@pytest.mark.parametrize("seed", range(20))
def test_poles_inside_are_found_and_pulses_are_none(seed):
    chance = random.Random(seed)
    end = 10.0 ** chance.uniform(-6, 6)
    place = end * chance.uniform(0.01, 1.0)
    power = chance.choice([1, 1.5, 2, 3])
    at, w = repr(place), repr(end * 10.0 ** chance.uniform(-6, -2))
    poles = [
        f"1/abs(t - {at})**{power}",
        f"cos(t)/(t - {at})**2 + sin(t)",
        f"(3 + sin(t/{at}))/(sin(t/{end!r}) - sin({at}/{end!r}))",
        f"tan((t - {at})/{end!r} + pi/2)",
    ]
    for text in poles:
        found = pole_inside(Expression.parse(text, ("t",)), 0.0, end)
        assert found is not None, text
        assert found[0] == pytest.approx(place, rel=1e-12)
        with pytest.raises(ValueError, match=r"forcing: it grows like \|t - .*integral is inf"):
            linear_oscillator(final_time=end, forcing=Forcing.from_text(text))
    for text in [
        f"1/({w}**2 + (t - {at})**2)",
        f"1/sqrt(abs(t - {at}))",
        f"sin(t - {at})/(t - {at})",
        f"log(abs(t - {at}))",
        f"exp(-((t - {at})/{w})**2)/(1 + t*t)",
        f"1/(t + {w})**3 + 1/t**0.5",
        f"1/(t - {1.01 * end!r})**2",
    ]:
        assert pole_inside(Expression.parse(text, ("t",)), 0.0, end) is None, text


def test_a_pole_outside_of_its_piece_does_no_harm():
    pole, one = Expression.parse("1/(t - 2)**2", ("t",)), Expression.parse("1", ("t",))
    pieces = (ForcingPiece(components=(pole,), until=1.0), ForcingPiece(components=(one,)))
    linear_oscillator(final_time=4.0, forcing=Forcing(pieces=pieces))
    with pytest.raises(ValueError, match="integral is infinite"):
        linear_oscillator(
            final_time=4.0,
            forcing=Forcing(
                pieces=(
                    ForcingPiece(components=(one,), until=1.0), ForcingPiece(components=(pole,))
                )
            ),
        )  # fmt: skip


@pytest.mark.parametrize("name", ["e", "omega", "t0"])
def test_constants_of_formulas_beside_samples_are_kept(name):
    samples = SampledForce.through([0.0, 1.0, 2.0], [1.0, 2.0, 4.0], "linear")
    force = samples.plus(Expression.parse(f"{name}*t", ("t",), {name: 5.0}))
    other = Expression.parse(f"{name} + 0*t", ("t",), {name: -1.0})
    time = np.array([0.5, 1.5])
    with_both = force.scaled(-2.0).plus(other)
    piece = ForcingPiece(components=(with_both,))
    expected = -2.0 * (np.array([1.5, 3.0]) + 5.0 * time) - 1.0
    np.testing.assert_allclose(piece.evaluate(time)[:, 0], expected, rtol=1e-15)


@pytest.mark.parametrize(
    "text", ["x**0.5", "log(x)", "arcsin(x - 1)", "(x**3)**0.25", "arccosh(x)"]
)
def test_where_there_is_no_value_there_is_no_slope(text):
    at = {"x": np.array([-1.0, 1.5])}
    found = slopes_of(Expression.parse(text, ("x",)), at, ["x"])["x"]
    assert np.isnan(found[0])
    assert np.isfinite(found[1])
