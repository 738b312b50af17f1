"""A mass matrix that is singular up to round-off is refused, whatever the units are."""

import numpy as np
import pytest
from spread import spread

from fvi_cli.effects.inertia import Inertia


def test_the_round_off_of_a_singular_matrix_is_no_mass():
    # its smallest eigenvalue is computed as 5.6e-17
    with pytest.raises(ValueError, match=r"5\.55e-17.*singular up to round-off"):
        Inertia(mass=[[1, 0.7], [0.7, 0.49]])


@spread(size=[2, 3, 8, 30], units=[0.0, 3.0, 9.0], seed=[1, 2, 3, 4])
def test_of_rank_one_less(size, units, seed):
    rng = np.random.default_rng(seed)
    factor = rng.standard_normal((size, size - 1))
    scale = 10.0 ** rng.uniform(-units, units, size)
    singular = (factor @ factor.T) * np.outer(scale, scale)
    singular = (singular + singular.T) / 2
    with pytest.raises(ValueError, match="a mass must be positive definite"):
        Inertia(mass=singular)
    # the control: a thousandth more on the diagonal
    sound = singular + np.diag(np.diagonal(singular)) / 1000
    assert Inertia(mass=sound).mass == pytest.approx(sound)


def test_masses_of_any_size_are_masses():
    Inertia(mass=np.diag([1e-30, 1.0, 1e30]))
    with pytest.raises(ValueError, match="smallest eigenvalue is -1"):
        Inertia(mass=[[1, 2], [2, 1]])
    with pytest.raises(ValueError, match="smallest eigenvalue is 0"):
        Inertia(mass=[[1, 0], [0, 0]])
