r"""Motions that bounce: closed forms, DOP853 flight by flight, and pushes through the response.

An impact at :math:`t_k` with restitution e changes the velocity by :math:`J_k`, and the derivative
of order :math:`\gamma` remembers it: :math:`D^\gamma x` gets
:math:`J_k (t - t_k)^{1-\gamma} / \Gamma(2 - \gamma)`, as that of Riemann and Liouville has for an
initial velocity. So a linear motion is the free one plus :math:`\sum_k J_k G(t - t_k)`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from .volterra import solve_volterra

Array = NDArray[np.float64]
Acceleration = Callable[[float, Array, Array], Array]


def free_fall(height: float, gravity: float, restitution: float, count: int) -> tuple[Array, float]:
    """Times of the first impacts of a ball that is let go, and the time of the last of all."""
    first = math.sqrt(2 * height / gravity)
    flights = 2 * first * restitution ** np.arange(1, count)
    rest = first * (1 + restitution) / (1 - restitution) if restitution < 1 else math.inf
    return first + np.concatenate([[0.0], np.cumsum(flights)]), rest


@dataclass(frozen=True)
class Wall:
    """The surface distance + lift sin(rate t) - normal . q = 0; the motion stays where it is > 0.

    With a radius the surface radius^2 - |q|^2 = 0.
    """

    normal: tuple[float, float] = (0.0, 0.0)
    distance: float = 0.0
    lift: float = 0.0
    rate: float = 1.0
    radius: float = 0.0
    restitution: float = 1.0

    def gap(self, t: float, q: Array) -> float:
        """Value of the surface's function."""
        if self.radius:
            return float(self.radius**2 - q @ q)
        return self.distance + self.lift * math.sin(self.rate * t) - float(self.normal @ q)

    def slopes(self, t: float, q: Array) -> tuple[Array, float]:
        """Its derivatives by q and by t."""
        if self.radius:
            return -2 * q, 0.0
        return -np.array(self.normal), self.lift * self.rate * math.cos(self.rate * t)

    def text(self, names: Sequence[str]) -> str:
        """The same for the package, in formulas of the coordinates."""
        if self.radius:
            return f"{self.radius**2!r} - " + " - ".join(f"({name})**2" for name in names)
        moving = f" + {self.lift!r}*sin({self.rate!r}*t)" if self.lift else ""
        way = " + ".join(f"{a!r}*({q})" for a, q in zip(self.normal, names, strict=True))
        return f"{self.distance!r}{moving} - ({way})"


@dataclass
class Bounced:
    """Impacts by wall, and where and when the motion was left."""

    times: list[list[float]]
    end: float
    position: Array
    velocity: Array


def ordinary_bounces(
    acceleration: Acceleration,
    walls: Sequence[Wall],
    x0: Array,
    v0: Array,
    final_time: float,
    *,
    shortest: float,
    forgets: bool = False,
) -> Bounced:
    """Masses 1 by DOP853 with event location, up to the first flight shorter than `shortest`.

    With `forgets` the restitution is always 1: the control.
    """
    d, t, last = len(x0), 0.0, -math.inf
    state = np.concatenate([x0, v0])
    found = Bounced([[] for _ in walls], final_time, state[:d], state[d:])

    def slope(time: float, y: Array) -> Array:
        return np.concatenate([y[d:], acceleration(time, y[:d], y[d:])])

    def event_of(wall: Wall) -> Callable[[float, Array], float]:
        def event(time: float, y: Array) -> float:
            return wall.gap(time, y[:d])

        event.terminal, event.direction = True, -1  # type: ignore[attr-defined]
        return event

    while t < final_time:
        run = solve_ivp(
            slope,
            (t, final_time),
            state,
            method="DOP853",
            rtol=1e-12,
            atol=1e-13,
            events=[event_of(wall) for wall in walls],
            max_step=final_time / 200,
        )
        t, state = float(run.t[-1]), run.y[:, -1].copy()
        if run.status != 1:
            break
        if t - last < shortest:
            found.end = last
            break
        index = next(k for k, times in enumerate(run.t_events or ()) if times.size)
        wall, last = walls[index], t
        normal, rate = wall.slopes(t, state[:d])
        speed = normal @ state[d:] + rate
        factor = 1.0 if forgets else wall.restitution
        state[d:] -= (1 + factor) * speed / (normal @ normal) * normal
        # the solver sees a root only where the gap begins above 0
        state[:d] += 1e-13 / (normal @ normal) * normal
        found.times[index].append(t)
    found.position, found.velocity = state[:d], state[d:]
    return found


@dataclass
class LinearBounces:
    """x'' + c D^g x + k x = -g0 above a floor at floor + lift sin(rate t), with its whole past.

    Free motion and impulse response by collocation of Volterra's equation.
    """

    order: float
    coefficient: float
    stiffness: float
    gravity: float
    start: float
    final_time: float
    floor: float = 0.0
    lift: float = 0.0
    rate: float = 1.0
    restitution: float = 1.0
    speed: float = 0.0
    derivative: str = "caputo"
    tolerance: float = 1e-12
    pushes: list[tuple[float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        k, g = self.stiffness, self.gravity

        def solve(x: float, v: float, load: float, derivative: str):  # type: ignore[no-untyped-def]
            return solve_volterra(
                1.0,
                [(self.order, self.coefficient)],
                lambda q: k * q,
                lambda q: np.full((*q.shape, 1), k),
                lambda t: np.full((t.size, 1), load),
                x,
                v,
                self.final_time,
                derivative=derivative,
                tolerance=self.tolerance,
            )

        self._free = solve(self.start, self.speed, -g, self.derivative)
        self._response = solve(0.0, 1.0, 0.0, "riemann-liouville")

    def motion(self, t: Array | float) -> tuple[Array, Array]:
        """Position and velocity at times; at an impact those before it."""
        times = np.atleast_1d(np.asarray(t, dtype=float))
        x, v = self._free.position(times)[:, 0], self._free.velocity(times)[:, 0]
        for at, push in self.pushes:
            later = times > at
            if later.any():
                x[later] += push * self._response.position(times[later] - at)[:, 0]
                v[later] += push * self._response.velocity(times[later] - at)[:, 0]
        return x, v

    def gap(self, t: Array) -> Array:
        """Height above the floor."""
        return self.motion(t)[0] - self.floor - self.lift * np.sin(self.rate * t)

    def strike(self, before: float, behind: float) -> tuple[float, float]:
        """The impact between two times: its time, and the velocity before it."""
        at = float(
            brentq(lambda t: self.gap(np.array([t]))[0], before, behind, xtol=1e-15, rtol=1e-14)
        )
        speed = float(self.motion(at)[1][0])
        floor = self.lift * self.rate * math.cos(self.rate * at)
        self.pushes.append((at, -(1 + self.restitution) * (speed - floor)))
        return at, speed

    def bounce(self, count: int, stride: float) -> tuple[Array, Array]:
        """Times of the next impacts, and velocities before them."""
        found = []
        for _ in range(count):
            t = self.pushes[-1][0] + 0.01 * stride if self.pushes else 0.01 * stride
            while self.gap(np.array([t + stride]))[0] > 0:
                t += stride
            found.append(self.strike(t, t + stride))
        times, speeds = np.array(found).T
        return times, speeds
