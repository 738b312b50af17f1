r"""Fractionally damped motions by collocation of their Volterra equation for the acceleration.

With :math:`a = x''`, :math:`x = x_0 + v_0 t + I^2 a` and
:math:`D^\gamma x = I^{2-\gamma} a + {}` (known powers of t), the equation of motion

.. math:: M x'' + \sum_j C_j D^{\gamma_j} x + \nabla V(x) = f(t)

is of the second kind for all orders below 2. On [0, h] the acceleration is its series of powers,
behind it a polynomial on every element, which solves the equation at Gauss points. Elements are at
most as long as their distance from the singular point before them, and are shortened until the
Legendre coefficients of their acceleration end below a tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike
from scipy.special import gamma, rgamma, roots_jacobi

from .elements import Array, Element, History, Series, integrate_legendre

Field = Callable[[Array], Array]
"""Values, shape ``(n, ...)``, at n positions, shape ``(n, d)``, or at n times, shape ``(n,)``."""

FIRST_ELEMENT = 1e-13
NEXT_ELEMENT = 1e-10
"""Length of the first element at 0 and behind breaks, as a part of the time until the next."""
SERIES = 1.6
"""Powers of the series on the first element are kept up to this far above its first one."""


@dataclass(frozen=True, eq=False)
class VolterraSolution:
    """Motion on [0, T], and how far that of a coarser mesh with fewer nodes is from it.

    Parameters
    ----------
    error
        Largest difference of positions over the elements, for every component, shape ``(d,)``.
    """

    initial_position: Array
    initial_velocity: Array
    series: Series
    elements: tuple[Element, ...]
    error: Array

    def position(self, times: ArrayLike) -> Array:
        """Positions, shape ``(n, d)``."""
        return self._motion(times)[0]

    def velocity(self, times: ArrayLike) -> Array:
        """Velocities, shape ``(n, d)``."""
        return self._motion(times)[1]

    def scale(self) -> tuple[Array, Array]:
        """Largest |x| and |v| at the ends of elements, shapes ``(d,)``."""
        found = np.array([[e.position, e.velocity] for e in self.elements])
        largest = np.max(np.abs(found), axis=0)
        return largest[0], largest[1]

    def _motion(self, times: ArrayLike) -> tuple[Array, Array]:
        t = np.atleast_1d(np.asarray(times, dtype=float))
        end = self.elements[-1].start + self.elements[-1].length
        if t.min() < 0 or t.max() > end * (1 + 1e-12):
            raise ValueError(f"times: {t.min()} to {t.max()} are not within [0, {end}]")
        starts = np.array([e.start for e in self.elements])
        index = np.searchsorted(starts, t, side="right") - 1
        result = np.empty((2, t.size, self.initial_position.size))
        for n in np.unique(index):
            chosen = index == n
            if n < 0:
                found = self.series.motion(t[chosen], self.initial_position, self.initial_velocity)
            else:
                element = self.elements[n]
                found = element.motion((t[chosen] - element.start) / element.length)
            result[:, chosen] = found
        return result[0], result[1]


def solve_volterra(
    mass: ArrayLike,
    terms: Sequence[tuple[float, ArrayLike]],
    gradient: Field | None,
    hessian: Field | None,
    force: Field | None,
    x0: ArrayLike,
    v0: ArrayLike,
    final_time: float,
    *,
    derivative: str = "caputo",
    breaks: Sequence[float] = (),
    tolerance: float = 1e-13,
    longest_step: float = math.inf,
    n_nodes: int = 10,
) -> VolterraSolution:
    r"""Solve :math:`M x'' + \sum_j C_j D^{\gamma_j} x + \nabla V(x) = f(t)` on [0, T].

    Parameters
    ----------
    mass
        M, a number or shape ``(d, d)``.
    terms
        Pairs of order in (0, 2) and C, a number or shape ``(d, d)``.
    gradient, hessian
        Of V: ``(n, d)`` to ``(n, d)`` and ``(n, d, d)``; both or neither.
    force
        f, ``(n,)`` to ``(n, d)``; smooth between `breaks`.
    derivative
        ``caputo`` (D acts on x - x0, and on x - x0 - v0 t for orders above 1) or
        ``riemann-liouville`` (on x; orders of 1 and more need x0 = 0).
    tolerance
        Of the last Legendre coefficients, in the scale of the velocity of each component.
    longest_step
        No element is longer: write something here where the force has narrow pulses.

    Raises
    ------
    ArithmeticError
        If Newton's iteration does not converge, or the series does not on the first element.
    """
    x, v = (np.atleast_1d(np.array(value, dtype=float)) for value in (x0, v0))
    d = x.size
    problem = _Problem(
        mass=_matrix(mass, d),
        terms=tuple((float(order), _matrix(value, d)) for order, value in terms),
        gradient=gradient or (lambda positions: np.zeros_like(positions)),
        hessian=hessian or (lambda positions: np.zeros((*positions.shape, d))),
        force=force or (lambda times: np.zeros((times.size, d))),
        position=x,
        velocity=v,
        ends=(*sorted({t for t in breaks if 0 < t < final_time}), final_time),
        is_caputo={"caputo": True, "riemann-liouville": False}[derivative],
        longest_step=longest_step,
    )
    fine = _solve(problem, n_nodes, tolerance)
    coarse = _solve(problem, n_nodes - 2, 10 * tolerance)
    places = np.linspace(0.05, 0.95, 4)
    times = np.concatenate([e.start + e.length * places for e in fine.elements])
    error = np.max(np.abs(fine.position(times) - coarse.position(times)), axis=0)
    return VolterraSolution(x, v, fine.series, fine.elements, error)


@dataclass(frozen=True, eq=False)
class _Problem:
    mass: Array
    terms: tuple[tuple[float, Array], ...]
    gradient: Field
    hessian: Field
    force: Field
    position: Array
    velocity: Array
    ends: tuple[float, ...]
    is_caputo: bool
    longest_step: float

    def known_powers(self) -> list[tuple[float, Array]]:
        """Powers t**p with vectors c on the left side that do not depend on the acceleration."""
        found = []
        for order, matrix in self.terms:
            if not self.is_caputo:
                found.append((-order, rgamma(1 - order) * (matrix @ self.position)))
            if not self.is_caputo or order <= 1:
                found.append((1 - order, rgamma(2 - order) * (matrix @ self.velocity)))
        return [(power, vector) for power, vector in found if np.any(vector != 0)]

    def series(self) -> Series:
        """Neumann's series of the equation with the potential's force at t = 0."""
        length = FIRST_ELEMENT * self.ends[0]
        start = self.force(np.zeros(1))[0] - self.gradient(self.position[None])[0]
        layer = {0.0: np.linalg.solve(self.mass, start)}
        for power, vector in self.known_powers():
            _add(layer, power, -np.linalg.solve(self.mass, vector))
        last = min(layer) + SERIES
        total: dict[float, Array] = {}
        while layer:
            following: dict[float, Array] = {}
            for power, vector in layer.items():
                _add(total, power, vector)
                for order, matrix in self.terms:
                    if power + 2 - order <= last:
                        weight = gamma(power + 1) * rgamma(power + 3 - order)
                        change = -weight * np.linalg.solve(self.mass, matrix @ vector)
                        _add(following, power + 2 - order, change)
            layer = following
        powers = np.array(sorted(total))
        coefficients = np.array([total[p] for p in powers])
        speeds = coefficients * (length ** (powers + 1) / (powers + 1))[:, None]
        most = np.max(np.abs(speeds), axis=0)
        left_out = np.max(np.abs(speeds[powers > last - 0.1]), axis=0, initial=0.0)
        known = np.abs(np.sum(speeds, axis=0)) + np.abs(self.velocity)
        if np.any(left_out > 1e-13 * known):
            raise ArithmeticError("series: it does not converge; take a smaller C")
        if np.any(most > 1e4 * np.abs(np.sum(speeds, axis=0)) + 1e-13 * np.abs(self.velocity)):
            raise ArithmeticError("series: it cancels on the first element; take a smaller C")
        return Series(length, powers, coefficients)


def _solve(problem: _Problem, n_nodes: int, tolerance: float) -> VolterraSolution:
    """Motion with one tolerance and one number of nodes."""
    series = problem.series()
    time = series.length
    position, velocity = (
        value[0] for value in series.motion(np.array([time]), problem.position, problem.velocity)
    )
    rules = _Rules.make(n_nodes, tuple(order for order, _ in problem.terms))
    elements: list[Element] = []
    history = History(series)
    largest = np.abs(velocity)
    singular, step = 0.0, time
    for end in problem.ends:
        smallest = 0.05 * time
        if singular > 0:
            step = smallest = NEXT_ELEMENT * (end - singular)
        while time < end:
            step = min(step, problem.longest_step)
            if singular < time:
                step = min(step, time - singular)
            if end - time < 2 * step:
                step = end - time if end - time <= step * 1.01 else (end - time) / 2
            stop = end if step == end - time else time + step
            nodes = time + (stop - time) * rules.nodes
            memory = [history.integrate(2 - order, time, nodes) for order, _ in problem.terms]
            element = _step(problem, rules, memory, time, stop - time, position, velocity)
            coefficients = np.abs(element.coefficients)
            scale = np.maximum(largest, np.max(coefficients, axis=0) * step)
            tail = np.max(coefficients[-2:], axis=0) * step
            with np.errstate(invalid="ignore", divide="ignore"):
                ratio = np.nanmax(np.where(tail > 0, tail / (tolerance * scale), 0.0))
            if ratio > 1 and step > 1.01 * smallest:
                step = max(step * max(0.25, 0.8 * ratio ** (-1 / (n_nodes - 1))), smallest)
                continue
            elements.append(element)
            history.append(element)
            time = stop
            position, velocity = element.end()
            largest = np.maximum(largest, np.abs(velocity))
            step *= min(2.0, 0.8 * max(ratio, 1e-12) ** (-1 / (n_nodes - 1)))
        singular = time
    start, unknown = (problem.position, problem.velocity), np.full_like(position, math.nan)
    return VolterraSolution(*start, series, tuple(elements), unknown)


@dataclass(frozen=True, eq=False)
class _Rules:
    """What does not depend on the element: nodes in [0, 1] and integrals up to them."""

    nodes: Array
    to_coefficients: Array
    twice: Array
    once: Array
    fractional: tuple[Array, ...]
    """For every order matrices of I^{2-order} on [0, 1], from values to values."""

    @classmethod
    def make(cls, n: int, orders: tuple[float, ...]) -> _Rules:
        points = legendre.leggauss(n)[0]
        nodes = (points + 1) / 2
        inverse = np.linalg.inv(legendre.legvander(points, n - 1))
        fractional = []
        for order in orders:
            z, weights = roots_jacobi(n, 1 - order, 0.0)
            places = np.multiply.outer(nodes, (z + 1) / 2)
            basis = legendre.legvander(2 * places - 1, n - 1) @ inverse
            part = np.einsum("j,ijk->ik", weights, basis) * rgamma(2 - order)
            fractional.append((nodes[:, None] / 2) ** (2 - order) * part)
        once, twice = (integrate_legendre(nodes, n, k) @ inverse for k in (1, 2))
        return cls(np.asarray(nodes), np.asarray(inverse), twice, once, tuple(fractional))


def _step(
    problem: _Problem,
    rules: _Rules,
    memory: list[Array],
    time: float,
    length: float,
    position: Array,
    velocity: Array,
) -> Element:
    """One element: Newton's iteration for the accelerations at its nodes."""
    m, d = rules.nodes.size, position.size
    times = time + length * rules.nodes
    load = problem.force(times)
    for power, vector in problem.known_powers():
        load = load - np.multiply.outer(times**power, vector)
    linear = np.kron(np.eye(m), problem.mass)
    for (order, matrix), past, rule in zip(problem.terms, memory, rules.fractional, strict=True):
        load = load - past @ matrix.T
        linear += np.kron(length ** (2 - order) * rule, matrix)
    straight = position + np.multiply.outer(length * rules.nodes, velocity)
    values = np.zeros((m, d))
    size = math.inf
    for _ in range(60):
        x = straight + length**2 * (rules.twice @ values)
        rest = load - problem.gradient(x) - (linear @ values.ravel()).reshape(m, d)
        curved = np.einsum("ik,iab->iakb", length**2 * rules.twice, problem.hessian(x))
        change = np.linalg.solve(linear + curved.reshape(m * d, m * d), rest.ravel())
        values = values + change.reshape(m, d)
        known = np.maximum(np.max(np.abs(values), axis=0), 1e-300)
        before, size = size, float(np.max(np.abs(change.reshape(m, d)) / known))
        if size < 1e-15 or (size < 1e-9 and size >= 0.5 * before):
            return Element(time, length, position, velocity, rules.to_coefficients @ values)
    raise ArithmeticError(f"Newton's iteration at t = {time} does not converge")


def _matrix(value: ArrayLike, d: int) -> Array:
    found = np.asarray(value, dtype=float)
    return found * np.eye(d) if found.ndim == 0 else found


def _add(layer: dict[float, Array], power: float, vector: ArrayLike) -> None:
    """Add to the coefficient of a power, which is known up to round-off."""
    near = next((p for p in layer if abs(p - power) < 1e-12), power)
    layer[near] = np.asarray(layer.get(near, 0.0) + np.asarray(vector), dtype=float)
