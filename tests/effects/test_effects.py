"""Effects check themselves."""

import math

import numpy as np
import pytest

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.expressions import Expression


def scene(**keywords: object) -> Scene:
    values = {
        "inertia": Inertia(mass=np.eye(2)),
        "initial_position": np.zeros(2),
        "initial_velocity": np.zeros(2),
        "final_time": 1.0,
        **keywords,
    }
    return Scene(**values)


@pytest.mark.parametrize("order", [0.0, 2.0, -0.5, 3.0, math.nan])
def test_orders_lie_between_0_and_2(order):
    with pytest.raises(ValueError, match="order"):
        FractionalDamping(order=order, coefficient=np.eye(1))


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        ([[1.0, 2.0], [0.0, 1.0]], "symmetric"),
        ([[1.0, 0.0]], "shape"),
        ([[math.inf]], "finite"),
        ([[1.0, 2.0], [2.0, 1.0]], "positive definite"),
        ([[0.0]], "positive definite"),
    ],
)
def test_masses_are_positive_definite(matrix, message):
    with pytest.raises(ValueError, match=message):
        Inertia(mass=np.array(matrix))


def test_values_cannot_be_changed_afterwards():
    inertia = Inertia(mass=np.eye(2))
    with pytest.raises(ValueError, match="read-only"):
        inertia.mass[0, 0] = 2.0


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"initial_position": np.zeros(3)}, "initial_position"),
        ({"initial_velocity": np.array([0.0, math.nan])}, "initial_velocity"),
        ({"final_time": 0.0}, "final_time"),
        ({"final_time": math.inf}, "final_time"),
        ({"potential": QuadraticPotential(stiffness=np.eye(3))}, "3 components, the mass 2"),
        ({"forcing": Forcing.from_text("t")}, "1 components, the mass 2"),
        ({"derivative": "weyl"}, "caputo, riemann-liouville"),
    ],
)
def test_scenes_refuse_what_does_not_fit(keywords, message):
    with pytest.raises(ValueError, match=message):
        scene(**keywords)


def test_expression_potentials_agree_with_their_own_derivatives():
    names = ("x", "y", "k")
    texts = {
        "energy": "k*x**2*y + cos(y)",
        "gradient": ("2*k*x*y", "k*x**2 - sin(y)"),
        "hessian": (("2*k*y", "2*k*x"), ("2*k*x", "-cos(y)")),
    }

    def parse(text: str) -> Expression:
        return Expression.parse(text, variables=names)

    potential = ExpressionPotential(
        coordinates=("x", "y"),
        parameters={"k": 1.7},
        energy_expression=parse(texts["energy"]),
        gradient_expressions=tuple(map(parse, texts["gradient"])),
        hessian_expressions=tuple(tuple(map(parse, row)) for row in texts["hessian"]),
    )
    points = np.random.default_rng(1).normal(size=(5, 2))
    eps = 1e-6
    for axis in range(2):
        move = eps * np.eye(2)[axis]
        slope = (potential.energy(points + move) - potential.energy(points - move)) / (2 * eps)
        assert slope == pytest.approx(potential.gradient(points)[:, axis], abs=1e-8)
        change = (potential.gradient(points + move) - potential.gradient(points - move)) / (2 * eps)
        assert change == pytest.approx(potential.hessian(points)[:, :, axis], abs=1e-8)
    with pytest.raises(ValueError, match="gradient: 1 entries, expected 2"):
        ExpressionPotential(
            coordinates=("x", "y"),
            energy_expression=parse("x"),
            gradient_expressions=(parse("1"),),
            hessian_expressions=((parse("0"),),),
        )


@pytest.mark.parametrize(
    ("ends", "message"),
    [((2.0, 1.0), "increase"), ((-1.0,), "increase from 0"), ((0.0,), "increase from 0")],
)
def test_pieces_follow_each_other(ends, message):
    value = (Expression.parse("1", variables=("t",)),)
    pieces = [ForcingPiece(components=value, until=end) for end in (*ends, math.inf)]
    with pytest.raises(ValueError, match=message):
        Forcing(pieces=tuple(pieces))


def test_forcing_needs_a_last_piece_without_end():
    value = (Expression.parse("1", variables=("t",)),)
    with pytest.raises(ValueError, match="at least one"):
        Forcing(pieces=())
    with pytest.raises(ValueError, match="must not have an end"):
        Forcing(pieces=(ForcingPiece(components=value, until=1.0),))


def test_what_does_nothing_is_not_active():
    terms = (
        FractionalDamping(order=0.5, coefficient=np.zeros((2, 2))),
        FractionalDamping(order=1.0, coefficient=np.eye(2)),
    )
    assert scene(damping=terms).active_damping == (terms[1],)
    assert scene().is_linear
    assert scene().break_points == ()
