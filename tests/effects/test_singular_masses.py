"""A mass matrix that is singular up to round-off is refused, whatever the units are."""

import numpy as np
import pytest
from spread import spread

from fvi_cli.effects.inertia import Inertia
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.lagrangian import lagrangian_scene


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


@spread(size=[2, 3, 5], units=[0.0, 6.0, 12.0], seed=[1, 2, 3], route=["lagrangian", "general"])
def test_units_of_a_lagrangian_do_not_matter(size, units, seed, route):
    """Masses of coordinates in units of 1e-12 to 1e12 are masses, in formulas as in matrices."""
    rng = np.random.default_rng(seed)
    factor = rng.standard_normal((size, size)) + 2 * np.eye(size)
    scale = 10.0 ** rng.uniform(-units, units, size)
    sound = (factor @ factor.T) * np.outer(scale, scale)
    # the last coordinate is the first one once more: a motion without any mass
    again = np.r_[np.arange(size - 1), 0]
    singular = (factor @ factor.T)[np.ix_(again, again)] * np.outer(scale, scale)
    names = [f"x{i}" for i in range(size)]

    def scene(mass):
        entries = enumerate(mass.tolist())
        terms = [f"({m!r})*vx{i}*vx{j}" for i, row in entries for j, m in enumerate(row)]
        kinetic = f"0.5*({' + '.join(terms)})"
        if route == "general":
            kinetic = f"(2 + cos(x0*{float(scale[0])!r}))*{kinetic}"
        return lagrangian_scene(
            coordinates=names,
            lagrangian=kinetic,
            initial_velocity=1.0 / scale,
            final_time=1.0,
        )

    run = integrate(scene(sound), Method(cq="gauss", degree=2), 8)
    assert run.status == "ok", run.message
    with pytest.raises(ValueError, match="must be positive definite"):
        scene(singular)
