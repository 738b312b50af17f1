"""Combinations of the components of a force, without the components that they do not need."""

import numpy as np

from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.sampled import FunctionForce, SampledForce
from fvi_cli.mathematics.expressions import Expression


def test_combinations_are_those_of_the_components_on_every_piece():
    rng, knots = np.random.default_rng(3), np.linspace(0.0, 2.0, 21)
    lines, other = (SampledForce.through(knots, rng.normal(size=21), "linear") for _ in range(2))
    curve = SampledForce.through(knots, rng.normal(size=21), "cubic")
    wave = Expression.parse("sin(3*t)", variables=("t",))
    mixed = (lines, wave, other, curve, FunctionForce(function=np.exp))
    first = ForcingPiece(components=mixed, weights=rng.normal(size=(6, 5)), until=1.05)
    force = Forcing(pieces=(first, ForcingPiece(components=(wave, *[lines] * 5))))
    times, rows = np.append(rng.uniform(0.0, 2.0, 50), 1.05), rng.normal(size=(3, 6))
    rows[1] = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    found = force(times, rows)
    np.testing.assert_allclose(found, force(times) @ rows.T, rtol=0, atol=1e-13)


def test_a_component_without_weight_is_not_evaluated():
    def refuse(time):
        raise AssertionError(time)

    force = Forcing.from_functions(np.cos, refuse)
    found = force(np.array([0.0, 1.0]), np.array([[2.0, 0.0]]))
    np.testing.assert_allclose(found[:, 0], [2.0, 2.0 * np.cos(1.0)], rtol=1e-15)
