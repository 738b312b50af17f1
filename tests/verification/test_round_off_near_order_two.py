r"""How far rounding carries, with orders of damping close to 2 above all.

For Gauss1:

The midpoint rule's weights, those of :math:`(2 (1 - z) / (1 + z))^{\gamma - 1}`, approach
:math:`C (-1)^n n^{\gamma - 2}`: they hardly decay, and the sum of a smooth velocity with them is a
small difference of large numbers, multiplied by :math:`h^{1 - \gamma}`. Rounding the weights alone
to doubles, in otherwise extended arithmetic, moves the solution by some 1e-12; histories that sum
weights times samples in doubles are off by up to thirty times that. With exponentials the
alternating part is a state of its own and nothing cancels.
"""

import numpy as np
import pytest
from letters import spring
from numpy.typing import NDArray

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.linear_response import linear_response

Long = NDArray[np.longdouble]
GAUSS1 = Method(cq="gauss", degree=1)
STIFFNESS, POSITION, VELOCITY, FINAL_TIME = 2.0, 1.0, 0.5, 8.0

needs_long_doubles = pytest.mark.skipif(
    np.finfo(np.longdouble).eps > 1e-18, reason="there is no arithmetic beyond doubles here"
)


def weights(theta: float, count: int) -> Long:
    """Weights of the midpoint rule's symbol to this power, by recurrences in extended numbers."""
    power = np.longdouble(theta)
    above, below = np.ones(count, np.longdouble), np.ones(count, np.longdouble)
    for n in range(1, count):
        above[n] = above[n - 1] * (n - 1 - power) / n
        below[n] = -below[n - 1] * (n - 1 + power) / n
    return np.asarray(np.longdouble(2) ** power * np.convolve(above, below)[:count])


def literal(order: float, n_steps: int, w: Long) -> Long:
    """The scheme written out, one step after the other, in extended numbers."""
    h = np.longdouble(FINAL_TIME) / n_steps
    scale = h ** (1 - np.longdouble(order))
    x, p = np.longdouble(POSITION), np.longdouble(VELOCITY)
    start = np.longdouble(VELOCITY) if order > 1 else np.longdouble(0)
    samples = np.zeros(n_steps, np.longdouble)
    positions = [x]
    for k in range(n_steps):
        known = scale * np.dot(w[1 : k + 1], samples[:k][::-1])
        right = p + h / 2 * (-STIFFNESS * x - known + scale * w[0] * start)
        velocity = right / (1 + h / 2 * (STIFFNESS * h / 2 + scale * w[0]))
        samples[k] = velocity - start
        force = known + scale * w[0] * samples[k]
        p = p - h * (STIFFNESS * (x + h / 2 * velocity) + force)
        x = x + h * velocity
        positions.append(x)
    return np.array(positions)


def distances(order: float, n_steps: int) -> dict[str, float]:
    """Largest differences of positions from those in extended numbers."""
    exact = weights(order - 1, n_steps)
    reference = literal(order, n_steps, exact)
    rounded = literal(order, n_steps, exact.astype(float).astype(np.longdouble))
    found = {"rounded weights": float(np.abs(rounded - reference).max())}
    scene = spring((order, np.eye(1)), T=FINAL_TIME, k=STIFFNESS, x=POSITION, v=VELOCITY)
    position = integrate(scene, GAUSS1, n_steps).position[:, 0]
    found["exponentials"] = float(np.abs(position - reference).max())
    return found


@needs_long_doubles
def test_usual_orders_keep_thirteen_digits():
    for order in (0.5, 1.5):
        assert max(distances(order, 1024).values()) < 1e-13


@needs_long_doubles
@pytest.mark.parametrize("order", [1.9, 1.98])
def test_exponentials_lose_no_more_than_rounded_weights(order):
    found = distances(order, 2048)
    assert found["exponentials"] < 2e-12
    # no sum of rounded weights could do better than this
    assert found["rounded weights"] > 5e-13


@pytest.mark.parametrize("degree", [3, 5])
def test_odd_degrees_keep_ten_digits_on_many_steps(degree):
    method = Method(cq="gauss", degree=degree, start="graded")
    found = integrate(spring((1.98, np.eye(1)), T=20.0, x=1.0, v=0.5), method, 2**16, every=256)
    exact = linear_response(
        mass=1.0, stiffness=1.0, damping=((1.98, 1.0),), position=1.0, velocity=0.5
    )
    error = np.abs(found.position[:, 0] - exact(found.time)).max()
    assert error < 1e-10
