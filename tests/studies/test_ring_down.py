r"""Free motions against their modes and the branch cut, which is integrated here.

The transform of the motion is :math:`T(s)^{-1} N(s)`. Closing the contour of its inversion around
the negative axis leaves the residues at the modes and an integral over the branch cut,

.. math:: q(t) = 2\,\mathrm{Re} \sum_j \frac{v_j v_j^T N(s_j)}{v_j^T T'(s_j) v_j} e^{s_j t}
          - \frac1\pi \int_0^\infty \mathrm{Im}\bigl[T(r e^{i\pi})^{-1} N(r e^{i\pi})\bigr]
          e^{-rt}\, dr .
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from letters import spring
from numpy.typing import NDArray
from oracles.sandwich_beam import sandwich_beam
from scipy.linalg import eigh

from fvi_cli.effects.laws import Law, fractional_zener
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.studies.vibration.modes import Mode, find_modes

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
GAUSS4 = Method(cq="gauss", degree=4, start="graded")


class Transform:
    """T(s) and N(s) of a scene that begins at `scene.initial_position`, from its matrices."""

    def __init__(self, scene: Scene) -> None:
        self.mass = scene.inertia.mass
        self.stiffness = scene.potential.stiffness
        self.forces = [(one.symbol, one.matrix) for one in scene.active_forces]
        self.position, self.velocity = scene.initial_position, scene.initial_velocity

    def left(self, s: complex) -> ComplexArray:
        total = s * s * self.mass + self.stiffness
        for symbol, matrix in self.forces:
            total = total + symbol(s) * matrix
        return np.asarray(total, dtype=complex)

    def right(self, s: complex) -> ComplexArray:
        total = self.mass @ (s * self.position + self.velocity)
        for symbol, matrix in self.forces:
            # memory begins with the motion
            total = total + symbol(s) / s * (matrix @ self.position)
        return np.asarray(total, dtype=complex)

    def residue(self, s: complex, shape: ComplexArray) -> ComplexArray:
        step = 1e-4 * s
        slope = (8 * (self.left(s + step) - self.left(s - step))) / (12 * step)
        slope -= (self.left(s + 2 * step) - self.left(s - 2 * step)) / (12 * step)
        return np.asarray(shape * (shape @ self.right(s)) / (shape @ slope @ shape))

    def cut(self, time: Array, least: float, largest: float, nodes: int) -> Array:
        """The integral by the trapezoidal rule in log r, shape ``(n, d)``."""
        logs = np.linspace(np.log(least), np.log(largest), nodes)
        total = np.zeros((time.size, self.position.size))
        for r in np.exp(logs):
            # the upper side of the cut
            s = complex(-r, 0.0)
            density = np.linalg.solve(self.left(s), self.right(s)).imag
            total -= np.outer(np.exp(-r * time), density) * r / np.pi
        return np.asarray(total * (logs[1] - logs[0]))


def oscillator(*laws: Law, order: float | None = None) -> Scene:
    damping = [] if order is None else [(order, 0.8)]
    return spring(*damping, T=20.0, m=1.5, k=4.0, x=1.0, laws=laws)


def ringing(transform: Transform, modes: Sequence[Mode], time: Array) -> Array:
    """What residues at modes and their conjugates leave of a motion."""
    return sum(
        2.0
        * np.outer(np.exp(one.frequency * time), transform.residue(one.frequency, one.shape)).real
        for one in modes
    )


ZENER = fractional_zener(order=0.6, time=0.3, relaxed=1.0, unrelaxed=5.0, coefficient=1.0)


@pytest.mark.parametrize(
    "scene",
    [oscillator(ZENER), oscillator(order=0.5), oscillator(ZENER, order=1.4)],
    ids=["zener", "springpot", "both"],
)
def test_one_degree_of_freedom_rings_down_as_pole_and_branch_cut(scene):
    (mode,) = find_modes(scene, 1).modes
    transform = Transform(scene)
    run = integrate(scene, GAUSS4, 200)
    late = run.time >= 0.5
    time = run.time[late]
    pole = ringing(transform, [mode], time)
    whole = pole + transform.cut(time, 1e-22, 1e3, 1500)
    assert np.abs(run.position[late] - whole).max() < 1e-8
    # neither is small
    assert np.abs(run.position[late] - pole).max() > 1e-3


def test_the_beam_rings_down_from_its_first_shape_as_modes_and_branch_cut():
    plain = sandwich_beam(6, final_time=0.05)
    forms = (dense(plain.potential.stiffness), dense(plain.inertia.mass))
    _, shapes = eigh(*forms, subset_by_index=[0, 0])
    scene = replace(plain, initial_position=shapes[:, 0] / np.abs(shapes).max())
    table = find_modes(scene, 24)
    assert table.is_complete
    assert len(table.modes) == 24
    transform = Transform(scene)
    run = integrate(scene, GAUSS4, 400)
    late = run.time >= 1e-3
    time = run.time[late]
    whole = ringing(transform, table.modes, time) + transform.cut(time, 1e-16, 1e5, 800)
    largest = np.abs(scene.initial_position).max()
    assert np.abs(run.position[late] - whole).max() < 1e-8 * largest
    alone = ringing(transform, table.modes[:1], time)
    assert np.abs(run.position[late] - alone).max() > 1e-6 * largest
