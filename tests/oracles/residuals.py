r"""Residuals of the equation of motion along a function, which need no derivative of it.

The equation, integrated twice from 0, needs no derivative of the function. With
:math:`J^a g(t) = \frac{1}{\Gamma(a)} \int_0^t (t-s)^{a-1} g(s)\,ds`,

.. math:: M (x - x_0 - v_0 t) + \sum_j \mu_j J^{2-\gamma_j} (x - x_0 - [\gamma_j > 1]\, v_0 t)
          + J^2 (\nabla V(x) - f) = 0

for Caputo derivatives; Riemann-Liouville ones act on x itself. The integrals are taken by Gauss and
Gauss-Jacobi rules on panels that are graded towards 0 and break points, independently of the
integrators of the equation.

Over long times the integrals, and with them their round-off, become larger than the motion. So
second differences in time of the same equation are checked as well,
:math:`g \mapsto g(t + \tau) - 2 g(t) + g(t - \tau)`. Of :math:`J^2 g` they leave
:math:`\int_{-\tau}^{\tau} (\tau - |s|)\, g(t + s)\,ds`, and of :math:`J^1 g` the integral over
:math:`[t, t + \tau]` less that over :math:`[t - \tau, t]`.
"""

import functools
import math

import numpy as np

from fvi_cli.effects.matrices import times

SHARES = (1 / 64, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4, 1.0)
"""Times at which the equation is checked, as shares of T."""

PLACES = ((0.0481, 0.0004), (0.2719, 0.0021), (0.4637, 0.0460), (0.6173, 0.0005), (0.8297, 0.0190))
"""(Time t, reach tau) of second differences, as shares of T; irregular on purpose."""

_PANELS = 32
_MOST_BREAKS = 64
_GRADING = 0.25 ** np.arange(1.0, 21.0)
_POINTS = 24


def residual_of(exact, scene):
    """The largest residual relative to the largest term, integrated twice or in differences."""
    end = scene.final_time
    whole = [terms_of(exact, scene, end * share, _POINTS) for share in SHARES]
    local = [
        second_differences(exact, scene, end * t, end * min(tau, 0.9 * t), _POINTS)
        for t, tau in PLACES
    ]
    # second differences that are small against the motion may be round-off
    moved = max(float(np.abs(terms[0]).max()) for terms in whole)
    return max(_relative(whole, 0.0), _relative(local, 1e-2 * moved))


def _relative(found, least):
    residual = max(float(np.abs(sum(terms)).max()) for terms in found)
    return residual / max(least, *(float(np.abs(one).max()) for terms in found for one in terms))


def second_differences(exact, scene, time, reach, points):
    """The second differences of the terms around a time, shape ``(d,)`` each."""
    around = time + reach * np.array([-1.0, 0.0, 1.0])
    total = [terms_of(exact, scene, float(one), points, is_local=True) for one in around]
    found = [low - 2.0 * middle + high for low, middle, high in zip(*total, strict=True)]
    breaks = [b for b in scene.break_points if around[0] < b < around[2]]
    edges = np.array(sorted({*around.tolist(), *breaks}))
    x, w = jacobi(points, 0.0)
    half = np.diff(edges)[:, None] / 2
    nodes = (edges[:-1, None] + half + half * x).ravel()
    lengths = (half * w).ravel()
    # the integral after the time less the integral before it
    moved = (lengths * np.sign(nodes - time)) @ exact(nodes)
    found += [times(moved, term.form) for term in scene.active_damping if term.order == 1]
    return [*found, *forces_of(exact, scene, nodes, lengths * (reach - np.abs(nodes - time)))]


def terms_of(
    exact,
    scene,
    time,
    points,
    *,
    is_local=False,
):
    """The terms of the equation, integrated twice from 0 to `time`, shape ``(d,)`` each.

    With `is_local` terms are left out whose second differences need no integral from 0.
    """
    start, rate = scene.initial_position, scene.initial_velocity
    mass = scene.inertia.form
    terms = [times(exact(np.array([time]))[0], mass), -times(start + rate * time, mass)]
    for damping in scene.active_damping:
        if is_local and damping.order == 1:
            continue
        nodes, weights = rule(time, 1.0 - damping.order, scene.break_points, points)
        moved = exact(nodes)
        if scene.derivative == "caputo" or damping.order == 1:
            moved = moved - start
            if damping.order > 1:
                moved = moved - nodes[:, None] * rate
        integral = weights @ moved / math.gamma(2.0 - damping.order)
        terms.append(times(integral, damping.form))
    if is_local:
        return terms
    return terms + forces_of(exact, scene, *rule(time, 1.0, scene.break_points, points))


def forces_of(exact, scene, nodes, weights):
    """Weighted sums of the negative conservative force and of the negative external force."""
    found = []
    if scene.potential is not None:
        found.append(weights @ scene.potential.gradient(exact(nodes)))
    if scene.forcing is not None:
        found.append(-weights @ scene.forcing(nodes))
    return found


def rule(time, power, breaks, points):
    """Nodes and weights of the integral of ``(time - s)**power g(s)`` over [0, time]."""
    own = [b for b in breaks if 0 < b < time]
    edges = [np.linspace(0.0, time, _PANELS + 1), np.array(own)]
    edges += [
        begin + (time - begin) / _PANELS * _GRADING for begin in (0.0, *own[: _MOST_BREAKS // 4])
    ]
    # NumPy's unique would import its masked arrays
    ends = np.array(sorted(set(np.concatenate(edges).tolist())))
    x, w = jacobi(points, 0.0)
    half = np.diff(ends[:-1]) / 2
    inner = (ends[:-2] + half)[:, None] + half[:, None] * x
    inner_weights = half[:, None] * w * (time - inner) ** power
    x, w = jacobi(points, power)
    last = (ends[-1] - ends[-2]) / 2
    return (
        np.concatenate([inner.ravel(), ends[-2] + last * (1 + x)]),
        np.concatenate([inner_weights.ravel(), last ** (power + 1) * w]),
    )


@functools.lru_cache(maxsize=32)
def jacobi(points, power):
    """Gauss-Jacobi rule on [-1, 1] for the weight ``(1 - x)**power``.

    By G.H. Golub, J.H. Welsch, Math. Comp. 23, 1969, 221-230; importing SciPy's version takes
    longer than all other checks of a configuration.
    """
    k = np.arange(points)
    n = 2.0 * k + power
    off = k[1:] * (k[1:] + power) / (n[1:] * np.sqrt(n[1:] ** 2 - 1.0)) * 2.0
    # the first entry is separate, since n = 0 would divide by zero
    centre = np.append(-power / (power + 2.0), -(power**2) / (n[1:] * (n[1:] + 2.0)))
    nodes, vectors = np.linalg.eigh(np.diag(centre) + np.diag(off, 1) + np.diag(off, -1))
    return nodes, 2.0 ** (power + 1.0) / (power + 1.0) * vectors[0] ** 2
