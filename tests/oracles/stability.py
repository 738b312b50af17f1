"""Growing modes of variational steps with backward differences, derived anew for a scalar scene.

On z**-n the trajectory of a step is q(tau) = x + c_1 tau + ... + c_s tau**s, tested by the powers
of tau, and the fractional force at a sample is mu h**-order w(z)**order times the sample, with
w(z) = sum_l (1 - z)**l / l. A zero of the determinant in |z| < 1 is a mode that grows.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from scipy.special import roots_jacobi

STEPS = 20_000
LARGEST_FACTOR = 1e3
"""A run of so many steps grows when a mode grows by this factor."""


@dataclass(frozen=True, kw_only=True)
class Steps:
    """BDF order, sampling (nodes or points), degree, and rule (gauss or lobatto, points)."""

    bdf: int
    at_nodes: bool
    degree: int
    rule: str
    points: int

    def nodes_and_weights(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The rule on [0, 1]."""
        if self.rule == "gauss":
            nodes, weights = leggauss(self.points)
            return (nodes + 1) / 2, weights / 2
        n = self.points
        inner = roots_jacobi(n - 2, 1, 1)[0] if n > 2 else np.empty(0)
        nodes = np.concatenate([[-1.0], inner, [1.0]])
        legendre = np.polynomial.legendre.Legendre.basis(n - 1)(nodes)
        return (nodes + 1) / 2, 1 / (n * (n - 1) * legendre**2)


@dataclass(frozen=True, kw_only=True)
class Oscillator:
    """x'' + coefficient D^order x + stiffness x."""

    stiffness: float
    order: float
    coefficient: float


def matrices(
    scene: Oscillator, steps: Steps, h: float, z: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """The step equations for x, the new p h and c_1 .. c_s, shape ``(n, s + 2, s + 2)``."""
    s = steps.degree
    nodes, weights = steps.nodes_and_weights()
    powers = nodes[:, None] ** np.arange(s + 1)
    slopes = np.arange(s + 1) * nodes[:, None] ** np.maximum(np.arange(s + 1) - 1, 0)
    difference = sum((1 - z) ** k / k for k in range(1, steps.bdf + 1))
    force = scene.coefficient * h ** (2 - scene.order) * difference**scene.order
    spring = h * h * scene.stiffness
    found = np.zeros((z.size, s + 2, s + 2), dtype=complex)
    # x is the coefficient of tau**0: columns 0 and 2, 3, ...
    columns = [0, *range(2, s + 2)]
    found[:, 0, 0] = 1 - z
    found[:, 0, 2:] = -z[:, None]
    for test in range(s + 1):
        row = 1 + test
        inertia = (weights * slopes[:, test]) @ slopes
        stiff = (weights * powers[:, test]) @ powers
        found[:, row, columns] = inertia - spring * stiff
        if steps.at_nodes:
            # halves of the kicks at x and at the sum of x and all c
            at_begin, at_end = float(test == 0), 1.0
            found[:, row, columns] -= 0.5 * force[:, None] * at_end
            found[:, row, 0] -= 0.5 * force * at_begin
        else:
            found[:, row, columns] -= force[:, None] * stiff
        # minus the change of the momentum times the test function; the unknown is the new one
        found[:, row, 1] -= 1 - (z if test == 0 else 0)
    return found


def grows(scene: Oscillator, steps: Steps, h: float, n_steps: float = STEPS) -> bool:
    """Whether a mode grows by the largest factor in so many steps."""
    radius = math.exp(-1.02 * math.log(LARGEST_FACTOR) / n_steps)
    near = np.geomspace(1e-5, 0.3, 60)
    angles = np.unique(np.concatenate([[0.0], near, np.linspace(0.02, math.pi, 160)]))
    values = _directions(scene, steps, h, radius, angles)
    for _ in range(30):
        turns = np.angle(values[1:] / values[:-1])
        wide = np.flatnonzero(np.abs(turns) > 0.4)
        if not wide.size:
            return round(float(turns.sum()) / math.pi) > 0
        middles = 0.5 * (angles[wide] + angles[wide + 1])
        values = np.insert(values, wide + 1, _directions(scene, steps, h, radius, middles))
        angles = np.insert(angles, wide + 1, middles)
    # a zero on the circle: neither clearly growing nor not
    return False


def _directions(
    scene: Oscillator, steps: Steps, h: float, radius: float, angles: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """The determinant over its size on a circle."""
    sign, _ = np.linalg.slogdet(matrices(scene, steps, h, radius * np.exp(1j * angles)))
    return np.asarray(sign)


def run(scene: Oscillator, steps: Steps, h: float, n_steps: int) -> NDArray[np.float64]:
    """Positions from x = 1, p = 0 by the convolution written out, one step after the other."""
    s = steps.degree
    weights_of = _weights(steps.bdf, scene.order, n_steps + 2)
    nodes, weights = steps.nodes_and_weights()
    powers = nodes[:, None] ** np.arange(s + 1)
    slopes = np.arange(s + 1) * nodes[:, None] ** np.maximum(np.arange(s + 1) - 1, 0)
    inertia = (weights * slopes.T) @ slopes
    stiff = (weights * powers.T) @ powers
    size = scene.coefficient * h ** (2 - scene.order)
    spring = h * h * scene.stiffness
    samples = powers if not steps.at_nodes else np.ones((1, 1))
    history = np.zeros((samples.shape[0], n_steps + 1))
    position = np.empty(n_steps + 1)
    position[0], momentum = 1.0, 0.0
    for n in range(n_steps):
        # minus force of what is past, of samples relative to the start
        past = history[:, :n] @ weights_of[n:0:-1] if n else np.zeros(samples.shape[0])
        left = np.zeros((s + 1, s + 1))
        right = np.zeros(s + 1)
        known = inertia[:, 0] - spring * stiff[:, 0]
        left[:, 1:] = (inertia - spring * stiff)[:, 1:]
        right -= known * position[n]
        if steps.at_nodes:
            kick = size * (past[0] + weights_of[0] * (position[n] - 1.0))
            history[0, n] = position[n] - 1.0
            # the whole kick at the beginning of the step, none at the start
            right[0] += kick if n else 0.0
        else:
            left[:, 1:] -= size * weights_of[0] * stiff[:, 1:]
            right += size * weights_of[0] * stiff[:, 0] * (position[n] - 1.0)
            right += size * (weights * powers.T) @ past
        right[0] -= momentum
        # unknown: the new momentum in the first column, then c
        left[:, 0] = -1.0
        unknown = np.linalg.solve(left, right)
        if not steps.at_nodes:
            history[:, n] = position[n] - 1.0 + powers[:, 1:] @ unknown[1:]
        position[n + 1] = position[n] + unknown[1:].sum()
        momentum = unknown[0]
        if not abs(position[n + 1]) < 1e100:
            return position[: n + 2]
    return position


def _weights(bdf: int, order: float, number: int) -> NDArray[np.float64]:
    """Coefficients of w(z)**order by Miller's recurrence."""
    base = np.zeros(bdf + 1)
    for k in range(1, bdf + 1):
        base[: k + 1] += np.array([math.comb(k, j) * (-1.0) ** j for j in range(k + 1)]) / k
    found = np.empty(number)
    found[0] = base[0] ** order
    for n in range(1, number):
        j = np.arange(1, min(n, bdf) + 1)
        found[n] = np.sum(((order + 1) * j - n) * base[j] * found[n - j]) / (n * base[0])
    return found
