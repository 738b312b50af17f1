"""Energies and balances of quadratic Lagrangians with linear and constant terms."""

import dataclasses

import numpy as np
import pytest

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.lagrangian import lagrangian_scene

GAUSS = Method(cq="gauss", degree=3)
NODES = Method(cq="bdf2", degree=1, sampling="nodes")
BALANCE = True


@dataclasses.dataclass(frozen=True)
class Drawn:
    """L = v M v / 2 - (q - a) K (q - a) / 2 + f q - c, the centre multiplied out by the program."""

    mass: np.ndarray
    stiffness: np.ndarray
    centre: np.ndarray
    force: np.ndarray
    offset: float

    @property
    def text(self):
        def form(matrix, names):
            pairs = np.ndindex(matrix.shape)
            return " + ".join(
                f"({float(matrix[i, j])!r})*{names[i]}*{names[j]}/2" for i, j in pairs
            )

        names = [f"x{k}" for k in range(self.force.size)]
        moved = [f"({x} - {float(a)!r})" for x, a in zip(names, self.centre, strict=True)]
        pull = " + ".join(f"({float(f)!r})*{x}" for x, f in zip(names, self.force, strict=True))
        kinetic = form(self.mass, [f"v{x}" for x in names])
        return f"{kinetic} - ({form(self.stiffness, moved)}) + {pull} - ({self.offset!r})"

    def energy(self, position, velocity):
        """v dL/dv - L, by hand."""
        q = position - self.centre
        kinetic = np.einsum("ki,ij,kj->k", velocity, self.mass, velocity) / 2
        elastic = np.einsum("ki,ij,kj->k", q, self.stiffness, q) / 2
        return kinetic + elastic - position @ self.force + self.offset

    def scene(self, random, more="", **data):
        d = self.force.size
        return lagrangian_scene(
            coordinates=[f"x{k}" for k in range(d)],
            lagrangian=self.text + more,
            initial_position=random.normal(size=d),
            initial_velocity=random.normal(size=d),
            final_time=2.0,
            **data,
        )


def drawn(seed):
    random = np.random.default_rng(seed)
    d = 1 + seed % 3

    def square(least):
        root = random.integers(-8, 9, size=(d, d)) / 8
        return root @ root.T + least * np.eye(d)

    stiffness = square(0.0) if seed % 4 else np.zeros((d, d))
    centre, force = random.normal(size=(2, d)).round(3)
    return random, Drawn(
        square(0.5).round(6).astype(float), stiffness, centre, force, float(random.normal())
    )


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("method", [GAUSS, NODES], ids=["gauss3", "nodes"])
def test_the_energy_of_drawn_lagrangians_is_the_one_by_hand(seed, method):
    random, case = drawn(seed)
    scene = case.scene(random)
    assert scene.is_linear
    found = integrate(scene, method, 40, diagnostics=BALANCE)
    velocity = np.linalg.solve(case.mass, found.momentum.T).T
    by_hand = case.energy(found.position, velocity)
    size = np.abs(by_hand).max() + np.abs(found.position @ case.force).max() + 1
    assert np.abs(found.energy - by_hand).max() < 1e-13 * size
    assert np.abs(found.diagnostics.forcing_work).max() < 1e-13 * size
    if method is GAUSS:
        assert np.ptp(found.energy) < 1e-13 * size
    # control: without the potential of the constant force the energy is another one
    bare = dataclasses.replace(scene, linear_potential=None)
    other = integrate(bare, method, 40, diagnostics=BALANCE)
    assert np.array_equal(other.position, found.position)
    assert np.ptp(other.energy) > 1e-3
    assert np.abs(other.diagnostics.forcing_work).max() > 1e-3


@pytest.mark.parametrize("seed", range(12))
def test_works_and_losses_of_drawn_lagrangians_close_the_balance(seed):
    random, case = drawn(seed)
    d = case.force.size
    damping = [FractionalDamping(order=0.5, coefficient=0.3 * np.eye(d))]
    given = {"forcing": Forcing.from_text(*["cos(2*t)"] * d)} if seed % 2 else {}
    scene = case.scene(random, " + x0*sin(3*t)", damping=damping, **given)
    found = integrate(scene, GAUSS, 160, diagnostics=BALANCE)
    works = found.diagnostics
    size = np.abs(found.energy).max() + 1
    drop = found.energy[0] - found.energy
    assert np.abs(drop - works.dissipated_work + works.forcing_work).max() < 1e-12 * size
    assert works.dissipated_work[-1] > 1e-3
    # only what depends on t is forcing: its power by hand
    velocity = np.linalg.solve(case.mass, found.momentum.T).T
    power = velocity[:, 0] * np.sin(3 * found.time)
    if given:
        power = power + velocity.sum(axis=1) * np.cos(2 * found.time)
    by_hand = np.trapezoid(power, found.time)
    assert works.forcing_work[-1] == pytest.approx(by_hand, abs=2e-3)
    assert found.energy == pytest.approx(case.energy(found.position, velocity), abs=1e-12 * size)
