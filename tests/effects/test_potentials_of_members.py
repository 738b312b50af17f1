"""Formulas of potentials at the points of many members at once, with parameters of their own."""

from __future__ import annotations

import numpy as np
import pytest

from fvi_cli.effects.potential import ExpressionPotential
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
        stiffness=np.diag(np.arange(1.0, len(coordinates) + 1)) if "b" in text else None,
    )


@pytest.mark.parametrize(("coordinates", "text"), FORMULAS)
@pytest.mark.parametrize("seed", range(3))
def test_members_have_the_bits_of_each_alone(coordinates, text, seed):
    draw = np.random.default_rng(seed)
    q, n, d = int(draw.integers(2, 40)), int(draw.integers(1, 20)), len(coordinates)
    points = draw.normal(size=(q, n, d)) * 10.0 ** draw.integers(-8, 2, size=(q, 1, d))
    given = {name: draw.uniform(0.1, 3.0, size=(q, 1)) for name in "ab"}
    every = potential(coordinates, text, a=1.0, b=1.0)
    with np.errstate(all="ignore"):
        together = every.derivatives(points, given)
        slopes = every.slopes(points, given)
    assert [one.shape for one in together] == [(q, n), (q, n, d), (q, n, d, d)]
    assert np.array_equal(together[1], slopes)
    for member in range(q):
        a, b = (float(given[name][member, 0]) for name in "ab")
        alone = potential(coordinates, text, a=a, b=b)
        at = points[member]
        for found, own in zip(
            together, (alone.energy(at), alone.gradient(at), alone.hessian(at)), strict=True
        ):
            assert np.array_equal(found[member], own)
    # the control: parameters of another member are seen, where the formula has any
    if "a" in text:
        other = {name: np.roll(values, 1, axis=0) for name, values in given.items()}
        with np.errstate(all="ignore"):
            assert not np.array_equal(every.derivatives(points, other)[0], together[0])


def test_what_is_returned_is_never_the_position_itself():
    every = potential(("x",), "x**2/2")
    points = np.array([[[0.3]], [[0.4]]])
    for found in (every.slopes(points), *every.derivatives(points), every.gradient(points)):
        found += 1.0
    assert np.array_equal(points, [[[0.3]], [[0.4]]])


def test_parameters_that_make_no_number_are_no_error_of_python():
    every = potential(("x",), "1/b + a*x", a=1.0, b=0.0)
    assert np.isinf(every.energy(np.array([[0.5]]))).all()
