"""Forces that would be taken beyond their samples are refused."""

import numpy as np
import pytest

from fvi_cli.effects.forcing import Forcing
from fvi_cli.mathematics.expressions import Expression, slopes_of
from fvi_cli.scenes.structures import linear_oscillator


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


@pytest.mark.parametrize(
    "text", ["x**0.5", "log(x)", "arcsin(x - 1)", "(x**3)**0.25", "arccosh(x)"]
)
def test_where_there_is_no_value_there_is_no_slope(text):
    at = {"x": np.array([-1.0, 1.5])}
    found = slopes_of(Expression.parse(text, ("x",)), at, ["x"])["x"]
    assert np.isnan(found[0])
    assert np.isfinite(found[1])
