"""Linear scenes without a run: modes, steady responses, stability of steps."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

import fvi_cli as fvi
from benchmarks.truth.judging import Claim, Claims, Random, RefusedError, UnjudgedError
from benchmarks.truth.motions import repeat
from benchmarks.truth.scenes import Array, Units, draw_units
from fvi_cli.errors import RequestError
from tests.oracles.eigenvalues import unpolished_modes

Complex = NDArray[np.complex128]
LARGEST_RATIO = 0.99


class Structure:
    """A random structure with springpots of rational orders, and its entry in a configuration."""

    def __init__(self, random: Random) -> None:
        d = self.dimension = int(random.integers(1, 4))
        self.units: Units = draw_units(random, d, apart=1.0)
        root, other = random.normal(size=(2, d, d))
        self.mass = np.eye(d) + 0.2 * root @ root.T
        self.stiffness = 10 ** random.uniform(-0.5, 1) * (np.eye(d) + other @ other.T)
        if d > 1 and random.random() < 0.3:
            # two modes next to each other
            self.mass, self.stiffness = np.eye(d), np.diag(1 + 0.05 * np.arange(d))
        self.terms: list[tuple[Fraction, Array]] = [(Fraction(0), self.stiffness)]
        for _ in range(int(random.integers(1, 3))):
            place = np.zeros((d, d))
            place[0, 0] = 1.0
            shape = place if random.random() < 0.5 else np.eye(d)
            size = 10 ** random.uniform(-4, 1.2)
            self.terms.append((Fraction(int(random.integers(1, 20)), 10), size * shape))
        self.problem: dict[str, Any] = {
            "kind": "structure",
            "mass": self.units.matrix(self.mass, 2),
            "stiffness": self.units.matrix(self.stiffness, 0),
            "damping": [
                {"order": float(order), "coefficient": self.units.matrix(matrix, float(order))}
                for order, matrix in self.terms[1:]
            ],
            "final_time": self.units.time,
        }

    def dynamic(self, s: Complex) -> Complex:
        """Z(s) without units, shape ``(n, d, d)``."""
        total = np.multiply.outer(s**2, self.mass)
        for order, matrix in self.terms:
            total = total + np.multiply.outer(s ** float(order), matrix)
        return np.asarray(total, dtype=complex)

    def modes(self) -> Complex:
        """All s with Im s > 0 on the principal sheet: orders are multiples of 1/10."""
        s = np.array(unpolished_modes(self.mass, self.terms), dtype=complex)
        s = s[s.imag > 1e-8 * np.abs(s)]
        for _ in range(3):
            s = s - self._correction(s)
        ratios = -s.real / np.abs(s)
        if np.any(np.abs(ratios - LARGEST_RATIO) < 0.008) or np.any(
            np.abs(self._correction(s)) > 1e-9 * np.abs(s)
        ):
            raise UnjudgedError("modes at the limit")
        return np.asarray(s[ratios < LARGEST_RATIO])

    def _correction(self, s: Complex) -> Complex:
        """Newton's correction of roots of det Z."""
        change = 1e-6 * np.abs(s)
        slope = (self.dynamic(s + change) - self.dynamic(s - change)) / (2 * change)[:, None, None]
        # an exact root leaves nothing to solve; so close to one nothing is lost
        matrix = self.dynamic(s * (1 + 1e-12 * np.exp(1j)))
        try:
            trace = np.trace(np.linalg.solve(matrix, slope), axis1=1, axis2=2)
        except np.linalg.LinAlgError as error:
            raise UnjudgedError("roots that are hard to tell apart") from error
        return np.asarray(1 / trace)


def modes(random: Random, words: list[str]) -> Claims:
    """Modes and their number, where it is said that none is missing."""
    structure = Structure(random)
    config = {"name": "made", "problem": structure.problem, "method": {"rk": "gauss"}}
    config["ladder"] = {"steps": 10}
    repeat(words, config, "modes")
    true = structure.modes()
    try:
        (table,) = fvi.modes(config)
    except RequestError as error:
        words.append(str(error))
        if "oscillates" not in str(error):
            raise
        yield Claim("number of modes", 0.0, float(true.size), 0.5)
        return
    if not table.is_complete:
        raise RefusedError("not known to be complete")
    found = np.array([mode.frequency for mode in table.modes]) * structure.units.time
    found = found[-found.real / np.abs(found) < LARGEST_RATIO]
    yield Claim("number of modes", float(found.size), float(true.size), 0.5)
    for s in found:
        near = true[np.argmin(np.abs(true - s))] if true.size else complex(math.nan)
        yield Claim("real part", float(s.real), float(near.real), 1e-6 * abs(s))
        yield Claim("imaginary part", float(s.imag), float(near.imag), 1e-6 * abs(s))


def response(random: Random, words: list[str]) -> Claims:
    """Magnitudes and peaks of steady responses."""
    structure = Structure(random)
    d, units = structure.dimension, structure.units
    poles = structure.modes()
    if not poles.size:
        raise UnjudgedError("no modes")
    radians = np.sort(poles.imag)
    low, high = (float(v) for v in (0.3 * radians[0], 2.5 * radians[-1]))
    number = int(random.integers(10, 60))
    start, stop = (v / (2 * math.pi * units.time) for v in (low, high))
    config = {"name": "made", "problem": structure.problem, "method": {"rk": "gauss"}}
    config["ladder"] = {"steps": 10}
    is_coupled = structure.mass[0, -1] != 0
    at, name = int(random.integers(d)) if is_coupled else 0, "x" if d == 1 else "x1"
    output = "x" if d == 1 else f"x{at + 1}"
    frequency = f"{start!r}:{stop!r}:{number}"
    repeat(words, config, "response", "--frequency", frequency, "--force", name, "--at", output)
    (table,) = fvi.response(config, frequency=frequency, force=[name], at=[output])
    unit = units.lengths[at] * units.lengths[0] / units.energy

    def magnitude(w: Array) -> Array:
        try:
            inverse = np.linalg.inv(structure.dynamic(1j * np.asarray(w, dtype=complex)))
        except np.linalg.LinAlgError as error:
            raise UnjudgedError("a mode that is not damped") from error
        return np.asarray(np.abs(inverse[:, at, 0]))

    printed = np.abs(table.values[:, 0]) / unit
    true = magnitude(table.hertz * 2 * math.pi * units.time)
    worst = int(np.argmax(np.abs(printed - true) / true))
    yield Claim(f"magnitude {worst}", float(printed[worst]), float(true[worst]), 1e-9 * true[worst])
    for peak in table.peaks:
        size = float(magnitude(np.array([peak.hertz * 2 * math.pi * units.time]))[0])
        yield Claim("peak", float(peak.magnitude / unit), size, 1e-3 * size)
    widths = np.maximum(-poles.real, 1e-9 * np.abs(poles))
    around = np.multiply.outer(widths, np.sinh(np.linspace(-12, 12, 2001)) / 100)
    w = np.unique(np.append(np.linspace(low, high, 20001), poles.imag[:, None] + around))
    w = w[(w >= low) & (w <= high)]
    sizes, step = magnitude(w), (high - low) / (number - 1)
    top = w[np.argmax(sizes)]
    if low + step < top < high - step:
        places = [peak.hertz * 2 * math.pi * units.time for peak in table.peaks]
        near = min(places, key=lambda place: abs(place - top), default=math.nan)
        yield Claim("highest peak at", near, float(top), 1e-3 * top)


def stability(random: Random, words: list[str]) -> Claims:
    """Predictions of backward differences of degree 1."""
    p, order = int(random.integers(1, 7)), float(random.uniform(0.02, 1.98))
    sampling = str(random.choice(["nodes", "points"]))
    k, mu = (float(10 ** random.uniform(-1, 2)), float(10 ** random.uniform(-2.5, 1)))
    span = float(10 ** random.uniform(0, 2))
    tau = float(10 ** random.uniform(-9, 9))
    steps = np.unique((10 ** random.uniform(0.5, 3, 4)).astype(int)).tolist()
    config = {
        "name": "made",
        "problem": {
            "kind": "damped-oscillator",
            "mass": 1.0,
            "stiffness": k / tau**2,
            "damping": [{"order": order, "coefficient": mu * tau ** (order - 2)}],
            "initial": {"position": 1.0},
            "final_time": span * tau,
            "exact": "none",
        },
        "method": {"bdf": p, "sampling": sampling, "degree": 1},
        "ladder": {"steps": steps},
    }
    repeat(words, config, "stability")
    (table,) = fvi.stability(config)

    def grows(h: float, n_steps: float) -> bool | None:
        """Whether a mode outgrows 1000 in so many steps; None where it nearly does."""
        counts = [
            _roots_inside(p, order, sampling, k * h * h, mu * h ** (2 - order), radius)
            for radius in (math.exp(-m * math.log(1e3) / n_steps) for m in (0.9, 1.1))
        ]
        return counts[0] > 0 if (counts[0] > 0) == (counts[1] > 0) else None

    for row in table.rows:
        n, verdict = row.run.n_steps, row.prediction.verdict
        truth = grows(span / n, n)
        if truth is not None and verdict in ("stable", "unstable"):
            said = float(verdict == "unstable")
            yield Claim(f"instability at N = {n}", said, float(truth), 0.5)


def _roots_inside(p: int, order: float, sampling: str, k: float, mu: float, radius: float) -> int:
    """Number of solutions x_n = w**-n of the step equations (mass and step 1) with |w| < radius."""
    # as many points as the nearest root to the circle may need: the phase turns slowly
    for points in (1024, 16384, 1 << 18):
        w = radius * np.exp(2j * math.pi * np.arange(points + 1) / points)
        symbol = sum((1 - w) ** n / n for n in range(1, p + 1))
        memory = w if sampling == "nodes" else (1 + w) ** 2 / 4
        value = (1 - w) ** 2 + k * (1 + w) ** 2 / 4 + mu * memory * symbol**order
        turns = np.angle(value[1:] / value[:-1])
        if np.max(np.abs(turns)) < 1.0:
            return round(float(np.sum(turns)) / (2 * math.pi))
    raise UnjudgedError("a root on the circle")
