"""Random scenes in random units, with their motion by routes that share no code."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from benchmarks.truth.judging import Random, UnjudgedError
from tests.oracles.ordinary import solve_ordinary
from tests.oracles.volterra import solve_volterra

Array = NDArray[np.float64]
ORACLE_TOLERANCE = 1e-9
"""Of the last coefficients; the positions are known to some 1e-14 then."""


@dataclass(frozen=True, eq=False)
class Units:
    """Time, energy and a length for every component: x = length * x of the scene without units."""

    time: float
    energy: float
    lengths: Array

    def matrix(self, plain: Array, power: float) -> list[list[float]]:
        """A coefficient of a derivative of order `power`."""
        scaled = self.energy * self.time**power * plain / np.outer(self.lengths, self.lengths)
        return [[float(value) for value in row] for row in scaled]


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A problem of a configuration, and how its motion is found otherwise."""

    problem: dict[str, Any]
    names: tuple[str, ...]
    units: Units
    span: float
    """Final time without unit."""
    solve: Callable[[], Any]

    @cached_property
    def known(self) -> Any:
        """The motion without units."""
        try:
            return self.solve()
        except ArithmeticError as error:
            raise UnjudgedError(str(error)) from error

    @property
    def final_time(self) -> float:
        """That of the configuration."""
        return float(self.problem["final_time"])

    def position(self, times: ArrayLike) -> Array:
        """True positions, shape ``(n, d)``."""
        return np.asarray(self.known.position(self._plain(times)) * self.units.lengths)

    def velocity(self, times: ArrayLike) -> Array:
        """True velocities, shape ``(n, d)``."""
        rate = self.units.lengths / self.units.time
        return np.asarray(self.known.velocity(self._plain(times)) * rate)

    def _largest(self, motion: Callable[[Array], Array]) -> Array:
        times = np.linspace(0, self.final_time, 2001)[1:]
        return np.asarray(np.maximum(np.max(np.abs(motion(times)), axis=0), 1e-300))

    @cached_property
    def sizes(self) -> Array:
        """Largest position of every component."""
        return self._largest(self.position)

    @cached_property
    def speeds(self) -> Array:
        """Largest velocity of every component."""
        return self._largest(self.velocity)

    @property
    def error(self) -> Array:
        """How far the true positions may be wrong."""
        return np.asarray(3 * self.known.error * self.units.lengths + 1e-15 * self.sizes)

    def _plain(self, times: ArrayLike) -> Array:
        return np.clip(np.asarray(times, dtype=float) / self.units.time, 0.0, self.span)


def draw_order(random: Random) -> float:
    """Any order in (0, 2), with those near the ends and 1 more often than by chance."""
    kind = random.random()
    if kind < 0.12:
        return 1.0
    if kind < 0.24:
        return float(random.uniform(1.9, 1.99))
    if kind < 0.3:
        return float(random.choice([0.5, 1.5]))
    return float(random.uniform(0.03, 1.9))


def draw_units(random: Random, dimension: int, *, apart: float) -> Units:
    """Units of which lengths are up to 10**apart from each other."""
    if random.random() < 0.4:
        return Units(1.0, 1.0, np.ones(dimension))
    common = random.uniform(-8, 8)
    lengths = 10 ** (common + np.append(0.0, random.uniform(-apart, apart, dimension - 1)))
    time, energy = (float(10 ** random.uniform(-e, e)) for e in (9, 6))
    return Units(time, energy, lengths)


@dataclass(frozen=True, eq=False)
class Force:
    """A force on every component: texts for the configuration, values, break points."""

    pieces: tuple[tuple[float, tuple[str, ...], Callable[[Array], Array]], ...]
    marks: tuple[float, ...]
    """Beginning, middle and end of pulses: points of the reference's mesh."""

    def entry(self, units: Units) -> Any:
        """What stands under `forcing`."""
        texts = [list(text) for _, text, _ in self.pieces]
        if len(texts) == 1:
            return texts[0]
        pieces: list[dict[str, Any]] = [{"value": text} for text in texts]
        for piece, (until, _, _) in zip(pieces[:-1], self.pieces, strict=False):
            piece["until"] = until * units.time
        return {"pieces": pieces}

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times without unit."""
        return tuple(until for until, _, _ in self.pieces[:-1])

    def __call__(self, times: Array) -> Array:
        """Values, shape ``(n, d)``; at a break point those before it."""
        total = self.pieces[-1][2](times)
        for until, _, values in reversed(self.pieces[:-1]):
            total = np.where((times <= until)[:, None], values(times), total)
        return total


def draw_force(random: Random, units: Units, span: float) -> Force | None:
    """No force, a sine, a smooth pulse, or pieces with jumps at any times."""
    kind = random.random()
    if kind < 0.35:
        return None
    d = units.lengths.size
    sizes = units.energy / units.lengths
    marks: list[float] = []

    def piece() -> tuple[tuple[str, ...], Callable[[Array], Array]]:
        amplitude = random.normal(size=d) * (random.random(d) < 0.8)
        frequency, phase = float(10 ** random.uniform(-0.5, 0.7)), float(random.uniform(0, 6))
        if kind < 0.7:
            inner = f"sin({frequency / units.time!r}*t + {phase!r})"

            def values(times: Array) -> Array:
                return np.multiply.outer(np.sin(frequency * times + phase), amplitude)
        else:
            center = float(random.uniform(0.2, 0.8) * span)
            width = float(10 ** random.uniform(-1.3 if random.random() < 0.7 else -4, 0.3))
            marks.extend(center + k * width for k in (-6, 0, 6))
            inner = f"exp(-((t - {center * units.time!r})/{width * units.time!r})**2)"

            def values(times: Array) -> Array:
                return np.multiply.outer(np.exp(-(((times - center) / width) ** 2)), amplitude)

        return tuple(f"{a!r}*{inner}" for a in (amplitude * sizes).tolist()), values

    many = 1 if random.random() < 0.5 else int(random.integers(2, 4))
    ends = [*np.sort(random.uniform(0.05, 0.95, many - 1)) * span, math.inf]
    return Force(tuple((float(end), *piece()) for end in ends), tuple(marks))


def draw_damping(
    random: Random, units: Units
) -> tuple[list[tuple[float, Array]], list[dict[str, Any]]]:
    """Terms without units, and their entries."""
    d = units.lengths.size
    terms = []
    for _ in range(int(random.integers(1, 3))):
        matrix = np.diag(random.uniform(0.3, 1, d)) ** 2
        terms.append((draw_order(random), 10 ** random.uniform(-2.5, 0.3) * matrix))
    return terms, [
        {"order": order, "coefficient": units.matrix(matrix, order)} for order, matrix in terms
    ]


def draw_start(
    random: Random, terms: list[tuple[float, Array]], amplitudes: Array
) -> tuple[str, Array, Array]:
    """Derivative and initial data without units, of all kinds that are permitted."""
    derivative = "riemann-liouville" if random.random() < 0.35 else "caputo"
    x0 = random.normal(size=amplitudes.size) * amplitudes
    v0 = random.normal(size=amplitudes.size) * amplitudes
    forbidden = derivative == "riemann-liouville" and any(order > 1 for order, _ in terms)
    kind = random.random()
    if forbidden or kind < 0.2:
        x0 = 0 * x0
    if kind > 0.8:
        v0 = 0 * v0
    if kind < 0.2 and random.random() < 0.3:
        v0 = v0 * 1e-8
    return derivative, x0, v0


def draw_linear(random: Random) -> Scene:
    """A structure with springpots."""
    d = int(random.choice([1, 1, 2]))
    units = draw_units(random, d, apart=1.5)
    root, other = random.normal(size=(2, d, d))
    mass = np.eye(d) + 0.3 * root @ root.T
    stiffness = 10 ** random.uniform(-0.5, 1.0) * (np.eye(d) + other @ other.T)
    return _scene(random, units, mass, stiffness, None, np.ones(d))


def draw_nonlinear(random: Random) -> Scene:
    """A Lagrangian text with pendulums, Duffing's and harmonic springs, coupled or not."""
    d = int(random.choice([1, 2]))
    is_coupled = d == 2 and random.random() < 0.5
    units = draw_units(random, d, apart=1.5 if is_coupled else 9.0)
    mass, stiffness = np.diag(random.uniform(0.5, 2, d)), np.diag(random.uniform(0.5, 4, d))
    amplitudes = np.ones(d)
    kinds = [str(random.choice(["pendulum", "duffing", "harmonic"])) for _ in range(d)]
    if d == 2 and not is_coupled:
        kinds[0] = "harmonic"
        amplitudes[0] = 10 ** random.uniform(-7, 7)
    if is_coupled:
        stiffness += random.uniform(0.1, 1) * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return _scene(random, units, mass, stiffness, kinds, amplitudes)


def _scene(
    random: Random,
    units: Units,
    mass: Array,
    stiffness: Array,
    kinds: list[str] | None,
    amplitudes: Array,
) -> Scene:
    d, span = len(mass), float(random.uniform(2, 12))
    terms, damping = draw_damping(random, units)
    derivative, x0, v0 = draw_start(random, terms, amplitudes)
    force = draw_force(random, units, span)
    if not np.any(x0) and not np.any(v0) and force is None:
        v0 = amplitudes.copy()
    shapes = kinds or ["harmonic"] * d
    bends = np.array([{"pendulum": -1 / 6, "duffing": 1.0, "harmonic": 0.0}[k] for k in shapes])
    is_sine = np.array([k == "pendulum" for k in shapes])
    own = np.diag(stiffness) if kinds else np.zeros(d)

    def gradient(x: Array) -> Array:
        change = np.where(is_sine, np.sin(x) - x, bends * x**3)
        return np.asarray(x @ stiffness.T + own * change)

    def hessian(x: Array) -> Array:
        change = np.where(is_sine, np.cos(x) - 1, 3 * bends * x**2)
        return np.asarray(stiffness + np.einsum("nd,de->nde", own * change, np.eye(d)))

    def solve() -> Any:
        return solve_volterra(
            mass,
            terms,
            gradient,
            hessian,
            force,
            x0,
            v0,
            span,
            derivative=derivative,
            breaks=(*force.breaks, *force.marks) if force else (),
            tolerance=ORACLE_TOLERANCE,
            n_nodes=9,
            longest_step=span / 20,
        )

    problem: dict[str, Any] = {
        "damping": damping,
        "derivative": derivative,
        "initial": {
            "position": [float(x) for x in x0 * units.lengths],
            "velocity": [float(v) for v in v0 * units.lengths / units.time],
        },
        "final_time": span * units.time,
    }
    if force:
        problem["forcing"] = force.entry(units)
    if kinds is None:
        problem |= {
            "kind": "structure",
            "mass": units.matrix(mass, 2),
            "stiffness": units.matrix(stiffness, 0),
        }
        names = tuple(f"x{n + 1}" for n in range(d)) if d > 1 else ("x",)
    else:
        names = ("x", "y")[:d]
        problem |= {
            "kind": "lagrangian",
            "coordinates": list(names),
            "lagrangian": _text(units, mass, stiffness, shapes, names),
        }
    return Scene(
        problem=problem,
        names=names,
        units=units,
        span=span,
        solve=solve,
    )


def _text(
    units: Units, mass: Array, stiffness: Array, kinds: list[str], names: tuple[str, ...]
) -> str:
    """The Lagrangian of a nonlinear scene."""
    parts = []
    m, k = np.array(units.matrix(mass, 2)), np.array(units.matrix(stiffness, 0))
    for n, (kind, name) in enumerate(zip(kinds, names, strict=True)):
        length, own = float(units.lengths[n]), float(k[n, n])
        parts.append(f"{float(m[n, n]) / 2!r}*v{name}**2")
        if kind == "pendulum":
            parts.append(f"{-own * length**2!r}*(1 - cos({name}/{length!r}))")
        else:
            parts.append(f"{-own / 2!r}*{name}**2")
        if kind == "duffing":
            parts.append(f"{-own / 4 / length**2!r}*{name}**4")
    if len(names) == 2 and k[0, 1] != 0:
        parts.append(f"{-float(k[0, 1])!r}*x*y")
    return " + ".join(parts)


def draw_general(random: Random) -> Scene:
    """A Lagrangian whose kinetic energy is not quadratic, with damping of order exactly 1."""
    units = draw_units(random, 1, apart=0)
    tau, length = units.time, float(units.lengths[0])
    span = float(random.uniform(2, 10))
    c = float(10 ** random.uniform(-2, 0))
    a, k = float(10 ** random.uniform(-1, 1)), float(random.uniform(0.5, 3))
    x0, v0 = (float(value) for value in random.normal(size=2))
    x, v = f"(x/{length!r})", f"(vx*{tau / length!r})"
    kind = str(random.choice(["relativistic", "mass of position"]))
    if kind == "relativistic":
        v0 = float(random.uniform(-0.95, 0.95))
        kinetic = f"-sqrt(1 - {v}**2)"

        def acceleration(t: float, x: Array, v: Array, z: Array) -> Array:
            return np.asarray((-k * x - c * v) * (1 - v**2) ** 1.5)
    else:
        kinetic = f"(1 + {a!r}*{x}**2)*{v}**2/2"

        def acceleration(t: float, x: Array, v: Array, z: Array) -> Array:
            return np.asarray((-k * x - c * v - a * x * v**2) / (1 + a * x**2))

    problem = {
        "kind": "lagrangian",
        "coordinates": ["x"],
        "lagrangian": f"{units.energy!r}*({kinetic} - {k / 2!r}*{x}**2)",
        "damping": [{"order": 1.0, "coefficient": units.energy * tau / length**2 * c}],
        "initial": {"position": x0 * length, "velocity": v0 * length / tau},
        "final_time": span * tau,
    }
    return Scene(
        problem=problem,
        names=("x",),
        units=units,
        span=span,
        solve=lambda: solve_ordinary(acceleration, x0, v0, span),
    )
