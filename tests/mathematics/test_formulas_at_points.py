"""Formulas at the points of many members at once, with parameters of their own."""

from __future__ import annotations

import numpy as np
import pytest

from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.mathematics.algebra.formulas import PointFormulas
from fvi_cli.mathematics.expressions import Expression

FORMULAS = (
    (("x",), "a*(1 - cos(x)) + b*x**4"),
    (("x",), "a*x"),
    (("x",), "x**2/2"),
    (("x",), "3"),
    (("x", "y"), "a*x**2*y + cos(b*y) + max(x, y)"),
    (("x", "y", "z"), "exp(a*x) + b*y**2"),
)


def potential(coordinates: tuple[str, ...], text: str, **values: float) -> ExpressionPotential:
    return ExpressionPotential(
        coordinates=coordinates,
        energy_expression=Expression.parse(text, variables=(*coordinates, "a", "b")),
        parameters=values,
    )


@pytest.mark.parametrize(("coordinates", "text"), FORMULAS)
@pytest.mark.parametrize("seed", range(3))
def test_members_have_the_bits_of_each_alone(coordinates, text, seed):
    draw = np.random.default_rng(seed)
    q, n, d = int(draw.integers(2, 40)), int(draw.integers(1, 20)), len(coordinates)
    points = draw.normal(size=(q, n, d)) * 10.0 ** draw.integers(-8, 2, size=(q, 1, d))
    given = {name: draw.uniform(0.1, 3.0, size=(q, 1)) for name in "ab"}
    every = potential(coordinates, text, a=1.0, b=1.0)
    systems = (every.energy_expression.system, every.gradient_system, every.derivatives_system)
    programs = [PointFormulas(one, coordinates, given) for one in systems]
    with np.errstate(all="ignore"):
        together = [one(points) for one in programs]
        # points that lie apart in memory, and in two arrays
        apart = [one(np.repeat(points, 2, axis=2)[..., ::2]) for one in programs]
        halves = [one(points[..., :1], points[..., 1:]) for one in programs]
    assert [one.shape for one in together] == [(q, n, 1), (q, n, d), (q, n, d + d * d)]
    for others in (apart, halves):
        assert all(map(np.array_equal, together, others))
    for member in range(q):
        a, b = (float(given[name][member, 0]) for name in "ab")
        alone = potential(coordinates, text, a=a, b=b)
        at = points[member]
        slopes = alone.gradient(at), alone.hessian(at).reshape(n, -1)
        own = (alone.energy(at)[:, None], slopes[0], np.hstack(slopes))
        for found, value in zip(together, own, strict=True):
            assert np.array_equal(found[member], value)
    # the control: parameters of another member are seen, where the formula has any
    if "a" in text:
        other = {name: np.roll(values, 1, axis=0) for name, values in given.items()}
        with np.errstate(all="ignore"):
            moved = PointFormulas(systems[0], coordinates, other)(points)
        assert not np.array_equal(moved, together[0])


def test_what_is_returned_is_never_the_position_itself():
    every = potential(("x",), "x**2/2")
    points = np.array([[[0.3]], [[0.4]]])
    for found in (every.energy(points), every.gradient(points)):
        found += 1.0
    assert np.array_equal(points, [[[0.3]], [[0.4]]])
