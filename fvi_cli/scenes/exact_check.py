r"""Check whether a function that a user gives as exact solution solves the equation of motion.

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

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence

import numpy as np

from fvi_cli.effects.matrices import times
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array

TOLERANCE = 1e-6
"""Permitted error, relative to the largest value or to the largest term of the equation."""

SMALL = 1e-2
"""Second differences below this share of the motion may be round-off of the formula."""

SHARES = (1 / 64, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4, 1.0)
"""Times at which the equation is checked, as shares of T."""

PLACES = tuple(
    (t, min(0.9 * t, 0.9 * (1 - t), s))
    for t, s in zip(
        (0.0481, 0.1513, 0.2719, 0.3941, 0.4637, 0.5479, 0.6173, 0.7351, 0.8297, 0.9673),
        (0.0004, 0.0310, 0.0021, 0.0007, 0.0460, 0.0110, 0.0005, 0.0037, 0.0190, 0.0009),
        strict=True,
    )
)
"""(Time t, reach tau) of second differences, as shares of T; irregular on purpose."""

RATE_STEPS = tuple(1e-4 / 16**k for k in range(5))
"""Steps of difference quotients at 0, as shares of T; so short since T may be many periods."""

ROUND_OFF = 1e-13
"""Relative round-off of a value of the function."""

SHORTER = (1.0, 1 / 16, 1 / 256, 1 / 4096)
"""Factors of the reaches, tried until integrals at :data:`ENOUGH_PLACES` times are resolved."""

ENOUGH_PLACES = 3
"""Least number of times with resolved integrals: at a single time an error may vanish."""

SAME = 0.1
"""If another rule changes a residual by less than this, relative, the rules are not its cause."""

_PANELS = 32
_MOST_BREAKS = 64
_GRADING = 0.25 ** np.arange(1.0, 21.0)
_POINTS = (16, 24)  # the second rule gives the value, the first its error
_OTHER_POINTS = 31  # points of the rule that confirms a residual


def objection(exact: Callable[[Array], Array], scene: Scene) -> str:
    """Why `exact` is not the solution of `scene`; empty: there is no reason.

    Its value and its rate at 0 are compared with the initial data, and the equation is checked on
    :data:`SHARES` of the interval. Integrals that are not resolved are not checked, and for scenes
    with a Lagrangian or relaxation laws only the initial data are compared.
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
    steps: Array = scene.final_time * np.array(RATE_STEPS)
    rates = (exact(steps) - found) / steps[:, None]
    wrong = np.abs(rates - scene.initial_velocity).max(axis=1)
    scale = max(float(np.abs(scene.initial_velocity).max()), size / scene.final_time)
    allowed = 100 * TOLERANCE * scale + ROUND_OFF * size / steps[-1]
    # a difference that shrinks with the step is curvature, also that of many periods
    if wrong[-1] > allowed and wrong[-1] > 0.6 * wrong[-2]:
        return (
            f"has the derivative {_numbers(rates[-1])} at t = 0, but initial.velocity is "
            f"{_numbers(scene.initial_velocity)}"
        )
    return ""


def _in_the_equation(exact: Callable[[Array], Array], scene: Scene) -> str:
    if scene.lagrangian is not None or scene.active_laws or len(scene.break_points) > _MOST_BREAKS:
        return ""
    end = scene.final_time
    # with memory every integral goes back to 0, which is expensive
    has_memory = any(term.order != 1 for term in scene.active_damping)
    places = PLACES[::4] if has_memory else PLACES
    size = SMALL * float(np.abs(times(exact(end * np.array(SHARES)), scene.inertia.form)).max())
    tried = _Tried(
        [functools.partial(_terms, exact, scene, end * share) for share in SHARES], least=None
    )
    if tried.has_failed:
        return tried.in_words("integrated twice, up to t", [end * share for share in SHARES])
    for shorter in (1.0,) if has_memory else SHORTER:
        local = [
            functools.partial(_differences, exact, scene, end * place, shorter * end * reach)
            for place, reach in places
        ]
        tried = _Tried(local, least=size)
        if tried.has_failed:
            at = [end * place for place, _ in places]
            return tried.in_words("in second differences around t", at)
        if tried.is_resolved:
            break
    return ""


class _Tried:
    """Residuals of the equation at some times, or of its second differences around them."""

    def __init__(self, at: Sequence[Callable[[int], list[Array]]], least: float | None) -> None:
        rough, fine = ([terms(points) for terms in at] for points in _POINTS)
        scales = np.array([max(float(np.abs(term).max()) for term in terms) for terms in fine])
        self._residuals = np.array([np.abs(sum(terms)).max() for terms in fine])
        unsure = np.array(
            [np.abs(sum(one) - sum(other)).max() for one, other in zip(rough, fine, strict=True)]
        )
        self.is_resolved = int((unsure <= TOLERANCE * scales).sum()) >= ENOUGH_PLACES
        if least is None:
            self._scales, unsure = (np.full_like(one, one.max()) for one in (scales, unsure))
        else:
            # large forces at one time could hide an error at another, resolved time
            unsure = np.where(unsure > TOLERANCE * scales, unsure.max(), unsure)
            self._scales = np.minimum(scales.max(), np.maximum(scales, least))
        excess = self._residuals / np.maximum(TOLERANCE * self._scales, 10 * unsure)
        self._worst = int(np.argmax(excess))
        self.has_failed = bool(excess[self._worst] > 1) and self._is_sure(at[self._worst])

    def _is_sure(self, terms: Callable[[int], list[Array]]) -> bool:
        """Whether another rule gives the same residual: two rules may both miss fast periods."""
        residual = self._residuals[self._worst]
        other = float(np.abs(sum(terms(_OTHER_POINTS))).max())
        return bool(abs(other - residual) <= SAME * residual)

    def in_words(self, what: str, at: Sequence[float]) -> str:
        """A message on the worst residual."""
        worst = self._worst
        return (
            f"does not solve the equation: {what} = {at[worst]:.4g}, the residual is "
            f"{self._residuals[worst]:.2g}, the largest term {self._scales[worst]:.2g}; auto "
            "searches for the solution"
        )


def _differences(
    exact: Callable[[Array], Array], scene: Scene, time: float, reach: float, points: int
) -> list[Array]:
    """The second differences of the terms around a time, shape ``(d,)`` each."""
    around = time + reach * np.array([-1.0, 0.0, 1.0])
    total = [_terms(exact, scene, float(one), points, is_local=True) for one in around]
    found = [low - 2.0 * middle + high for low, middle, high in zip(*total, strict=True)]
    breaks = [b for b in scene.break_points if around[0] < b < around[2]]
    edges = np.array(sorted({*around.tolist(), *breaks}))
    x, w = _jacobi(points, 0.0)
    half = np.diff(edges)[:, None] / 2
    nodes = (edges[:-1, None] + half + half * x).ravel()
    lengths = (half * w).ravel()
    # the integral after the time less the integral before it
    moved = (lengths * np.sign(nodes - time)) @ exact(nodes)
    found += [times(moved, term.form) for term in scene.active_damping if term.order == 1]
    return [*found, *_forces(exact, scene, nodes, lengths * (reach - np.abs(nodes - time)))]


def _terms(
    exact: Callable[[Array], Array],
    scene: Scene,
    time: float,
    points: int,
    *,
    is_local: bool = False,
) -> list[Array]:
    """The terms of the equation, integrated twice from 0 to `time`, shape ``(d,)`` each.

    With `is_local` terms are left out whose second differences need no integral from 0.
    """
    start, rate = scene.initial_position, scene.initial_velocity
    mass = scene.inertia.form
    terms = [times(exact(np.array([time]))[0], mass), -times(start + rate * time, mass)]
    for damping in scene.active_damping:
        if is_local and damping.order == 1:
            continue
        nodes, weights = _rule(time, 1.0 - damping.order, scene.break_points, points)
        moved = exact(nodes)
        if scene.derivative == "caputo" or damping.order == 1:
            moved = moved - start
            if damping.order > 1:
                moved = moved - nodes[:, None] * rate
        integral = weights @ moved / math.gamma(2.0 - damping.order)
        terms.append(times(integral, damping.form))
    if is_local:
        return terms
    return terms + _forces(exact, scene, *_rule(time, 1.0, scene.break_points, points))


def _forces(
    exact: Callable[[Array], Array], scene: Scene, nodes: Array, weights: Array
) -> list[Array]:
    """Weighted sums of the negative conservative force and of the negative external force."""
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
    # NumPy's unique would import its masked arrays
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


def _numbers(values: Array) -> str:
    texts = [f"{value:.6g}" for value in values[:4]]
    return texts[0] if values.size == 1 else f"[{', '.join(texts)}{', ...' * (values.size > 4)}]"
