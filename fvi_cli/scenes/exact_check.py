r"""Whether a given function solves the equation of motion that it is given for.

The equation, integrated twice from 0, needs no derivative of the function. With
:math:`J^a g(t) = \frac{1}{\Gamma(a)} \int_0^t (t-s)^{a-1} g(s)\,ds`,

.. math:: M (x - x_0 - v_0 t) + \sum_j \mu_j J^{2-\gamma_j} (x - x_0 - [\gamma_j > 1]\, v_0 t)
          + J^2 (\nabla V(x) - f) = 0

for Caputo derivatives; Riemann-Liouville ones act on x itself. The integrals are taken by Gauss and
Gauss-Jacobi rules on panels that are graded towards 0 and break points, apart from anything that
integrates the equation.

Over long times the integrals outgrow the motion, and with them what counts as round-off. So the
second differences in time of the same equation are tried as well,
:math:`g \mapsto g(t + \tau) - 2 g(t) + g(t - \tau)`, which of :math:`J^2 g` leave
:math:`\int_{-\tau}^{\tau} (\tau - |s|)\, g(t + s)\,ds`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np

from fvi_cli.effects.matrices import times
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array

TOLERANCE = 1e-6
"""Of the largest value, or of the largest term of the equation."""

SMALL = 1e-2
"""Part of the motion: smaller second differences may be no more than the digits of a formula."""

SHARES = (1 / 64, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4, 1.0)
"""The parts of [0, T] at whose ends the equation is tried."""

PLACES = tuple(
    (t, min(0.9 * t, 0.9 * (1 - t), s))
    for t, s in zip(
        (0.0481, 0.1513, 0.2719, 0.3941, 0.4637, 0.5479, 0.6173, 0.7351, 0.8297, 0.9673),
        (0.0004, 0.0310, 0.0021, 0.0007, 0.0460, 0.0110, 0.0005, 0.0037, 0.0190, 0.0009),
        strict=True,
    )
)
"""Where second differences are tried and how far they reach, in parts of [0, T]; unrelated."""

_PANELS = 32
_MOST_BREAKS = 64
_GRADING = 0.25 ** np.arange(1.0, 21.0)
_POINTS = (16, 24)  # the second rule gives the value, the first its error


def objection(exact: Callable[[Array], Array], scene: Scene) -> str:
    """What speaks against `exact` as the solution of `scene`; empty where nothing does.

    Its value and its rate at 0 are compared with the initial data, and the equation is tried on
    :data:`SHARES` of the interval. No check is made where the integrals are not resolved, and of
    scenes with a Lagrangian or relaxation laws only the initial data are compared.
    """
    end = scene.final_time
    with np.errstate(all="ignore"):
        values = exact(np.linspace(0.0, end, 257))
        size = float(np.abs(values).max(initial=0.0))
        if not math.isfinite(size):
            return "" if not np.any(scene.initial_velocity) else _at_start(exact, scene, size)
        return _at_start(exact, scene, size) or _in_the_equation(exact, scene)


def _at_start(exact: Callable[[Array], Array], scene: Scene, size: float) -> str:
    found = exact(np.zeros(1))[0]
    if np.abs(found - scene.initial_position).max() > TOLERANCE * max(
        size, float(np.abs(scene.initial_position).max())
    ):
        return (
            f"is {_numbers(found)} at t = 0, but initial.position is "
            f"{_numbers(scene.initial_position)}"
        )
    steps = scene.final_time * np.array([1e-4, 1e-4 / 16])
    rates = (exact(steps) - found) / steps[:, None]
    coarse, fine = np.abs(rates - scene.initial_velocity).max(axis=1)
    scale = max(float(np.abs(scene.initial_velocity).max()), size / scene.final_time)
    # what shrinks with the step is curvature
    if fine > 100 * TOLERANCE * scale and fine > 0.6 * coarse:
        return (
            f"has the derivative {_numbers(rates[1])} at t = 0, but initial.velocity is "
            f"{_numbers(scene.initial_velocity)}"
        )
    return ""


def _in_the_equation(exact: Callable[[Array], Array], scene: Scene) -> str:
    if scene.lagrangian is not None or scene.active_laws or len(scene.break_points) > _MOST_BREAKS:
        return ""
    end = scene.final_time
    # of a memory every integral goes back to 0
    has_memory = any(term.order != 1 for term in scene.active_damping)
    places = PLACES[::4] if has_memory else PLACES
    whole = [functools.partial(_terms, exact, scene, end * share) for share in SHARES]
    local = [
        functools.partial(_differences, exact, scene, end * place, end * reach)
        for place, reach in places
    ]
    size = SMALL * float(np.abs(times(exact(end * np.array(SHARES)), scene.inertia.form)).max())
    for at, ends, words, is_local in (
        (whole, SHARES, "integrated twice, up to t", False),
        (local, [place for place, _ in places], "in second differences around t", True),
    ):
        rough, fine = ([terms(points) for terms in at] for points in _POINTS)
        scales = np.array([max(float(np.abs(term).max()) for term in terms) for terms in fine])
        residuals = np.array([np.abs(sum(terms)).max() for terms in fine])
        unsure = np.array(
            [np.abs(sum(one) - sum(other)).max() for one, other in zip(rough, fine, strict=True)]
        )
        if is_local:
            # forces of a long reach hide errors of a shorter one, which may be resolved by itself
            unsure = np.where(unsure > TOLERANCE * scales, unsure.max(), unsure)
            scales = np.minimum(scales.max(), np.maximum(scales, size))
        else:
            scales, unsure = np.full_like(scales, scales.max()), unsure.max()
        excess = residuals / np.maximum(TOLERANCE * scales, 10 * unsure)
        worst = int(np.argmax(excess))
        if excess[worst] > 1:
            return (
                f"does not solve the equation: {words} = {end * ends[worst]:.4g}, the residual is "
                f"{residuals[worst]:.2g}, the largest term {scales[worst]:.2g}; auto searches for "
                "the solution"
            )
    return ""


def _differences(
    exact: Callable[[Array], Array], scene: Scene, time: float, reach: float, points: int
) -> list[Array]:
    """The second differences of the terms around a time, shape ``(d,)`` each."""
    around = time + reach * np.array([-1.0, 0.0, 1.0])
    total = [_terms(exact, scene, float(one), points, conservative=False) for one in around]
    found = [low - 2.0 * middle + high for low, middle, high in zip(*total, strict=True)]
    breaks = [b for b in scene.break_points if around[0] < b < around[2]]
    edges = np.array(sorted({*around.tolist(), *breaks}))
    x, w = _jacobi(points, 0.0)
    half = np.diff(edges)[:, None] / 2
    nodes = (edges[:-1, None] + half + half * x).ravel()
    weights = (half * w).ravel() * (reach - np.abs(nodes - time))
    return [*found, *_forces(exact, scene, nodes, weights)]


def _terms(
    exact: Callable[[Array], Array],
    scene: Scene,
    time: float,
    points: int,
    *,
    conservative: bool = True,
) -> list[Array]:
    """The terms of the equation, integrated twice from 0 to `time`, shape ``(d,)`` each."""
    start, rate = scene.initial_position, scene.initial_velocity
    mass = scene.inertia.form
    terms = [times(exact(np.array([time]))[0], mass), -times(start + rate * time, mass)]
    for damping in scene.active_damping:
        nodes, weights = _rule(time, 1.0 - damping.order, scene.break_points, points)
        moved = exact(nodes)
        if scene.derivative == "caputo" or damping.order == 1:
            moved = moved - start
            if damping.order > 1:
                moved = moved - nodes[:, None] * rate
        integral = weights @ moved / math.gamma(2.0 - damping.order)
        terms.append(times(integral, damping.form))
    if not conservative:
        return terms
    return terms + _forces(exact, scene, *_rule(time, 1.0, scene.break_points, points))


def _forces(
    exact: Callable[[Array], Array], scene: Scene, nodes: Array, weights: Array
) -> list[Array]:
    """Weighted sums of minus the conservative force, and of minus the known one."""
    found = []
    if scene.potential is not None:
        found.append(weights @ scene.potential.gradient(exact(nodes)))
    if scene.forcing is not None:
        found.append(-weights @ scene.forcing(nodes))
    return found


def _rule(time: float, power: float, breaks: tuple[float, ...], points: int) -> tuple[Array, Array]:
    """Nodes and weights of the integral of ``(time - s)**power g(s)`` over [0, time]."""
    own = [b for b in breaks if 0 < b < time]
    edges = [np.linspace(0.0, time, _PANELS + 1), np.array(own)]
    edges += [
        begin + (time - begin) / _PANELS * _GRADING for begin in (0.0, *own[: _MOST_BREAKS // 4])
    ]
    # NumPy's unique would load all of its masked arrays
    ends = np.array(sorted(set(np.concatenate(edges).tolist())))
    x, w = _jacobi(points, 0.0)
    half = np.diff(ends[:-1]) / 2
    inner = (ends[:-2] + half)[:, None] + half[:, None] * x
    inner_weights = half[:, None] * w * (time - inner) ** power
    x, w = _jacobi(points, power)
    last = (ends[-1] - ends[-2]) / 2
    return (
        np.concatenate([inner.ravel(), ends[-2] + last * (1 + x)]),
        np.concatenate([inner_weights.ravel(), last ** (power + 1) * w]),
    )


@functools.lru_cache(maxsize=32)
def _jacobi(points: int, power: float) -> tuple[Array, Array]:
    """Gauss-Jacobi rule on [-1, 1] for the weight ``(1 - x)**power``.

    By G.H. Golub, J.H. Welsch, Math. Comp. 23, 1969, 221-230; SciPy's takes longer to import than
    everything else that looks at a configuration.
    """
    k = np.arange(points)
    n = 2.0 * k + power
    off = k[1:] * (k[1:] + power) / (n[1:] * np.sqrt(n[1:] ** 2 - 1.0)) * 2.0
    # the first entry is written out, for n may be 0
    centre = np.append(-power / (power + 2.0), -(power**2) / (n[1:] * (n[1:] + 2.0)))
    nodes, vectors = np.linalg.eigh(np.diag(centre) + np.diag(off, 1) + np.diag(off, -1))
    return nodes, 2.0 ** (power + 1.0) / (power + 1.0) * vectors[0] ** 2


def _numbers(values: Array) -> str:
    texts = [f"{value:.6g}" for value in values[:4]]
    return texts[0] if values.size == 1 else f"[{', '.join(texts)}{', ...' * (values.size > 4)}]"
