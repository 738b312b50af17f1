"""Objects of the user as potentials: the numbers of the same potential as a formula."""

import numpy as np
import pytest

import fvi_cli as fvi

SHARED = {
    "damping": [fvi.FractionalDamping(order=0.5, coefficient=0.2 * np.eye(2))],
    "initial_position": [0.7, -0.4],
    "initial_velocity": [0.0, 0.3],
    "final_time": 6.0,
}
ENERGY = "depth*(1 - exp(-x))**2 + x**2*y**2/2 + y**2"


class Bond:
    def __init__(self, depth=2.0):
        self.depth = depth

    def energy(self, position):
        x, y = position[..., 0], position[..., 1]
        return self.depth * (1 - np.exp(-x)) ** 2 + x**2 * y**2 / 2 + y**2

    def gradient(self, position):
        x, y = position[..., 0], position[..., 1]
        decay = np.exp(-x)
        first = 2 * self.depth * (1 - decay) * decay + x * y**2
        return np.stack([first, x**2 * y + 2 * y], axis=-1)

    def hessian(self, position):
        x, y = position[..., 0], position[..., 1]
        decay = np.exp(-x)
        first = 2 * self.depth * (2 * decay - 1) * decay + y**2
        rows = [[first, 2 * x * y], [2 * x * y, x**2 + 2]]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


class Uncut(Bond):
    """With one function in another form."""

    def __init__(self, **functions):
        super().__init__()
        vars(self).update(functions)


def own(depth=2.0, potential=None, **changes):
    potential = Bond(depth) if potential is None else potential
    return fvi.Scene(inertia=fvi.Inertia(mass=np.eye(2)), potential=potential, **SHARED | changes)


def formula(depth=2.0, **changes):
    return fvi.lagrangian(
        coordinates=["x", "y"],
        parameters={"depth": depth},
        lagrangian=f"vx**2/2 + vy**2/2 - ({ENERGY})",
        **SHARED | changes,
    )


@pytest.mark.parametrize(
    "method",
    ["gauss3", "gauss2-none", "lobatto-iiic2", "bdf2", "bdf3-nodes", "implicit-euler"],
)
def test_runs_are_those_of_the_formula(method):
    ours, known = (fvi.integrate(make(), method, 60) for make in (own, formula))
    assert ours.status == known.status == "ok"
    assert np.abs(ours.position - known.position).max() < 1e-13
    assert np.abs(ours.energy - known.energy).max() < 1e-13


def test_adaptive_steps_and_tolerances_do_as_well():
    steps = fvi.AdaptiveSteps(tolerance=1e-8)
    ours, known = (fvi.integrate(make(), "gauss6", steps) for make in (own, formula))
    assert ours.status == "ok"
    assert np.abs(ours.position[-1] - known.position[-1]).max() < 1e-8
    pulse = fvi.Forcing.from_text("exp(-400*(t-3)**2)", "0")
    ours, known = (fvi.solve(make(forcing=pulse), tolerance=1e-7) for make in (own, formula))
    assert ours.met
    assert known.met
    assert np.abs(ours.position[-1] - known.position[-1]).max() < 1e-7


def test_laws_add_their_relaxed_stiffness():
    law = fvi.fractional_zener(
        order=0.5, time=0.3, relaxed=1.5, unrelaxed=4.0, coefficient=np.eye(2)
    )
    ours, known = (fvi.integrate(make(laws=[law]), "gauss3", 60) for make in (own, formula))
    assert np.abs(ours.position - known.position).max() < 1e-13


def test_gradients_by_numbers_of_the_scene():
    quantity = fvi.position_at(5.0, component=1)
    names = ["damping.0.order", "mass", "initial_position"]
    ours, known = (fvi.gradient(make(), "gauss3", 60, quantity, names) for make in (own, formula))
    for name in names:
        assert np.abs(ours[name] - known[name]).max() < 1e-12
    with pytest.raises(ValueError, match=r"'potential\.depth' unknown; give"):
        fvi.gradient(own(), "gauss3", 60, quantity, ["potential.depth"])


@pytest.mark.parametrize(
    ("potential", "words"),
    [
        (Uncut(energy=lambda q: q[..., :1]), r"energy returns the shape \(3, 1\).*return \(3,\)"),
        (Uncut(gradient=lambda q: np.zeros(2)), r"gradient returns .*return \(3, 2\)"),
        (Uncut(hessian=lambda q: np.eye(2)), r"hessian returns .*return \(3, 2, 2\)"),
    ],
)
def test_functions_that_do_not_fit_are_refused(potential, words):
    with pytest.raises(ValueError, match=words):
        own(potential=potential)
