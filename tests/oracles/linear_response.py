r"""Exact motions of linear scenes: residues of their Laplace transforms, and what the cut adds.

.. math:: X(s) = \frac{N(s)}{Z(s)}, \qquad
          Z(s) = m s^2 + k + \sum_j c_j s^{\gamma_j} + \sum_i a_i s \hat k_i(s)

with powers cut along the negative axis. The zeros of Z are found by Newton's iteration from all
over the sheet and counted by the argument principle. The integral round the cut is taken along a
hyperbola that scales with 1/t, so that small times lose nothing by cancellation and the algebraic
tail keeps its relative accuracy.

J.A.C. Weideman, L.N. Trefethen, *Parabolic and hyperbolic contours for computing the Bromwich
integral*, Math. Comp. 76 (2007); L.N. Trefethen, J.A.C. Weideman, *The exponentially convergent
trapezoidal rule*, SIAM Rev. 56 (2014), section 5, for the correction of a nearby pole.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.linalg import eigh

from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene

Array = NDArray[np.float64]
Powers = dict[float, float]
"""Coefficients by power."""

ANGLE = math.pi / 4  # of the hyperbola
RULES = ((0.05, 0.0), (0.05, 0.5), (0.045, 0.0), (0.045, 0.5))
"""Spacings along it, and where nodes begin: the rule with nodes farther from poles is used."""
DECAY = 42.0  # the contour ends where e^(st) is about exp(-42)
TIMES_TOGETHER = 2048
FARTHEST = 60.0  # logarithm of the largest and least modulus of a zero
WAVE = re.compile(r"(sin|cos)\(([-+.\de]+)\*t\)")
STRIPS = (2.9, 2.85, 2.95, 2.8)
"""Bounds of the arguments of zeros, tried in turn; those behind are left of every contour."""


@dataclass(frozen=True, eq=False)
class Equation:
    """The left side of a scalar equation: powers of s, and pairs of a kernel and its size."""

    powers: Powers
    laws: Sequence[tuple[Any, float]] = ()

    def terms(self, z: Any, t: Any) -> list[Any]:
        """Terms of t^2 Z(z / t)."""
        found = [c * t ** (2 - power) * z**power for power, c in self.powers.items()]
        return found + [size * t * z * kernel.transform(z / t) for kernel, size in self.laws]

    def values(self, z: Any, t: Any = 1.0) -> Any:
        """The sum of the terms."""
        return sum(self.terms(z, t))

    @cached_property
    def zeros(self) -> Any:
        """Zeros of Z in the upper half-plane and on the positive axis, in extended precision."""
        logs = np.linspace(-FARTHEST, FARTHEST, 961)
        sizes = np.abs([np.broadcast_to(one, logs.shape) for one in self.terms(np.exp(logs), 1.0)])
        # a kernel may be some times larger beside the cut
        sizes[len(self.powers) :] *= 10.0
        balanced = logs[sizes.max(axis=0) < 0.8 * sizes.sum(axis=0)]
        if not balanced.size:
            return np.zeros(0, dtype=np.clongdouble)
        low, high = balanced[0] - 0.5, balanced[-1] + 0.5
        seeds = np.add.outer(np.arange(low, high, 0.5), 1j * np.linspace(0.0, 3.0, 9)).ravel()
        found = np.unique(np.round(self._polished(seeds, 30), 6))
        found = self._polished(found.astype(np.clongdouble), 6)
        for strip in STRIPS:
            inside = found[(found.imag < strip) & (found.real > low) & (found.real < high)]
            distinct: list[Any] = []
            for one in inside:
                if all(abs(one - other) > 1e-6 for other in distinct):
                    distinct.append(one)
            zeros = np.array([w.real if w.imag < 1e-12 else w for w in distinct], np.clongdouble)
            if self._count(low, high, strip) == sum(1 if w.imag == 0 else 2 for w in zeros):
                return np.exp(zeros)
        raise ValueError(f"the zeros of {self} could not be separated")

    def _polished(self, w: Any, count: int) -> Any:
        """Logarithms of zeros by Newton's iteration; those that lead to none are left out."""
        for _ in range(count):
            here, shift = self.values(np.exp(w)), 1e-6
            slope = (self.values(np.exp(w + shift)) - self.values(np.exp(w - shift))) / (2 * shift)
            step = here / np.where(slope == 0, 1.0, slope)
            step = step * np.minimum(1.0, 0.5 / np.maximum(np.abs(step), 1e-300))
            w = w - step
            w = np.clip(w.real, -FARTHEST, FARTHEST) + 1j * np.clip(np.abs(w.imag), 0.0, 3.1)
        sizes = sum(map(np.abs, self.terms(np.exp(w), 1.0)))
        return w[np.abs(self.values(np.exp(w))) < 1e-12 * sizes]

    def _count(self, low: float, high: float, strip: float) -> int | None:
        """Zeros with abs(arg s) < strip by the argument principle; None: one is on the edge."""
        up, along = 1j * np.linspace(0.0, strip, 500), np.linspace(high, low, 5000)
        path = np.concatenate([high + up, along + 1j * strip, low + up[::-1]])
        values = self.values(np.exp(path))
        turns = np.angle(values[1:] / values[:-1])
        return None if np.abs(turns).max() > 1.0 else round(float(turns.sum()) / math.pi)


@dataclass(frozen=True, eq=False)
class Input:
    """A transform N(s) from a time on: powers, laws that were relaxed at a position, a wave."""

    powers: Powers
    begin: float = 0.0
    position: float = 0.0
    frequency: float = 0.0  # N is divided by s^2 + frequency^2

    def values(self, equation: Equation, z: Any, t: Any) -> Any:
        """T N(z / t)."""
        total = sum((c * t ** (1 - power) * z**power for power, c in self.powers.items()), 0 * z)
        for kernel, size in equation.laws:
            total = total + size * self.position * t * kernel.transform(z / t)
        return total * t**2 / (z**2 + self.frequency**2 * t**2) if self.frequency else total


@dataclass(frozen=True, eq=False)
class LinearResponse:
    """Solution x(t) of a scalar equation."""

    equation: Equation
    inputs: Sequence[Input]
    position: float = 0.0

    def __call__(self, time: Array) -> Array:
        """The position at times >= 0, same shape; not finite beyond the range of doubles."""
        total = np.where(time == 0, self.position, 0.0)
        for one in self.inputs:
            places = np.flatnonzero(time > one.begin)
            for some in np.array_split(places, max(1, len(places) // TIMES_TOGETHER)):
                with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                    total[some] += self._invert(one, time[some] - one.begin)
        return total

    def _invert(self, one: Input, time: Array) -> Array:
        """The trapezoidal rule along the contour, with the residues at zeros right of it."""
        zeros = list(self.equation.zeros)
        zeros += [np.clongdouble(1j * one.frequency)] if one.frequency else []
        # e^z n!/z^(n+1) is of the size of its integral where z is about n + 1
        scale = min(max(1.2, -min(one.powers, default=0.0)), 10.0) / (1.0 - math.sin(ANGLE))
        places = [-1j * (np.arcsin(complex(s) * time / scale - 1.0) + ANGLE) for s in zeros]
        factors = np.array(
            [[np.exp(2j * np.pi * (o - p / h)) for p in places] for h, o in RULES]
        ).reshape(len(RULES), len(zeros), time.size)
        best = np.abs(1.0 - factors).min(axis=1, initial=2.0).argmax(axis=0)
        residues = [self._residue(one, s, zeros) * np.exp(s * time) for s in zeros]
        total = np.empty(time.size)
        for index, (spacing, offset) in enumerate(RULES):
            own = best == index
            last = math.acosh((DECAY / scale + 1.0) / math.sin(ANGLE))
            u = spacing * (offset + np.arange(int(last / spacing) + 2))
            z = scale * (1.0 + np.sin(1j * u - ANGLE))
            weights = np.exp(z) * np.cos(1j * u - ANGLE) * (spacing * scale / math.pi)
            t = time[own, None]
            transform = one.values(self.equation, z, t) / self.equation.values(z, t)
            total[own] = (transform @ np.where(u == 0, 0.5 * weights, weights)).real
            for s, residue, factor in zip(zeros, residues, factors[index], strict=True):
                both = residue[own].astype(complex) / (1.0 - factor[own])
                total[own] += (1.0 if s.imag == 0 else 2.0) * both.real
        return total

    def _residue(self, one: Input, zero: Any, zeros: Sequence[Any]) -> Any:
        """That of N / Z by a circle round the zero on which nothing else lies."""
        others = [abs(s - zero) for z in zeros for s in (z, z.conjugate()) if s != zero]
        radius = 0.1 * min([abs(zero) * np.sin(min(np.pi - np.angle(zero), 1.0)), *others])
        around = radius * np.exp(2j * np.pi * np.arange(32, dtype=np.longdouble) / 32)
        s = zero + around
        return np.mean(one.values(self.equation, s, 1.0) / self.equation.values(s) * around)


@dataclass(frozen=True, kw_only=True, eq=False)
class ExactSolution:
    """The motion of a scene."""

    shapes: Array
    responses: tuple[LinearResponse, ...]

    @property
    def error(self) -> Array:
        """Of the position, beside round-off, for every component."""
        return np.zeros(len(self.shapes))

    def position(self, time: Array) -> Array:
        """At times ``(n,)`` >= 0, shape ``(n, d)``."""
        return np.stack([response(time) for response in self.responses], axis=-1) @ self.shapes.T


def match_scene(scene: Scene) -> ExactSolution:
    r"""Exact solution of a linear scene whose matrices are diagonal in common coordinates.

    Its force is a sum of powers of t, of which pieces may differ by polynomials, or one sine or
    cosine. With Riemann-Liouville derivatives of orders above 1 it starts from 0.

    Raises
    ------
    ValueError
        For other scenes.
    """
    terms, laws = scene.active_damping, scene.active_laws
    matrices = [scene.stiffness, *(force.matrix for force in (*terms, *laws))]
    shapes, (stiffness, *sizes) = _common_modes(scene.inertia.mass, matrices)
    momenta = shapes.T @ scene.inertia.mass
    start, rate = momenta @ scene.initial_position, momenta @ scene.initial_velocity
    forces = _jumps(scene.forcing)
    responses = []
    for i, (x, v) in enumerate(zip(start.tolist(), rate.tolist(), strict=True)):
        data, powers = [(1.0, x), (0.0, v)], [(2.0, 1.0), (0.0, float(stiffness[i]))]
        for term, size in zip(terms, sizes, strict=False):
            g, c = term.order, float(size[i])
            powers.append((g, c))
            if scene.derivative == "caputo" or g == 1:
                data += [(g - 1, c * x), (g - 2, c * v * (g > 1))]
            elif g > 1 and x:
                raise ValueError("riemann-liouville above order 1 starts from 0")
        pairs = zip(laws, sizes[len(terms) :], strict=True)
        own = [(law.kernel, law.size * float(size[i])) for law, size in pairs if size[i]]
        pushes = [
            Input(added((p, c * shapes[n, i]) for p, c in jump.items()), begin, 0.0, frequency)
            for begin, components in forces
            for n, (jump, frequency) in enumerate(components)
        ]
        inputs = [Input(added(data), position=x), *pushes]
        responses.append(LinearResponse(Equation(added(powers), own), inputs, x))
    return ExactSolution(shapes=shapes, responses=tuple(responses))


def added(terms: Iterable[tuple[float, float]]) -> Powers:
    """Sums of coefficients of equal powers, without zeros."""
    found: Powers = {}
    for power, coefficient in terms:
        found[power] = found.get(power, 0.0) + coefficient
    return {power: c for power, c in found.items() if c}


def _common_modes(mass: Array, matrices: Sequence[Array]) -> tuple[Array, list[Array]]:
    """Shapes S with S^T M S = 1 and all S^T A S diagonal, and these diagonals."""
    # square roots of integers are not rationally related: equal eigenvalues of the mixture are
    # equal in every matrix
    norms = [float(np.linalg.norm(matrix, 2)) or 1.0 for matrix in matrices]
    shares = [np.sqrt(k + 2.0) / norm for k, norm in enumerate(norms)]
    mixture = sum(share * matrix for share, matrix in zip(shares, matrices, strict=True))
    _, shapes = eigh(mixture, mass)
    diagonals = []
    for matrix in matrices:
        rotated = shapes.T @ matrix @ shapes
        diagonal = np.diagonal(rotated).copy()
        size = len(mass) * float(np.abs(rotated).max())
        if np.abs(rotated - np.diag(diagonal)).max() > 1e-13 * size:
            raise ValueError("no common modes")
        diagonal[np.abs(diagonal) < 4e-16 * size] = 0.0
        diagonals.append(diagonal)
    return shapes, diagonals


def _jumps(forcing: Forcing | None) -> list[tuple[float, list[tuple[Powers, float]]]]:
    """Transforms of what begins at a time, by components, each with the frequency of a wave."""
    if forcing is None:
        return []
    before: list[Powers] = [{}] * forcing.dimension
    found = []
    for begin, piece in zip((0.0, *forcing.break_points), forcing.pieces, strict=True):
        texts = [_text(row, piece.components) for row in piece.weights.tolist()]
        waves = [WAVE.fullmatch(text) for text in texts]
        now = [
            {} if wave else _powers(ast.parse(text, mode="eval").body)
            for text, wave in zip(texts, waves, strict=True)
        ]
        jumps = [(_transform(new, old, begin), 0.0) for new, old in zip(now, before, strict=True)]
        for n, wave in enumerate(waves):
            if wave:
                frequency = float(wave[2])
                jumps[n] = ({1.0: 1.0} if wave[1] == "cos" else {0.0: frequency}), frequency
        found.append((begin, jumps))
        before = now
    return found


def _text(weights: Sequence[float], components: Sequence[Any]) -> str:
    """The sum of functions with weights as text."""
    pairs = zip(weights, (getattr(one, "text", "samples") for one in components), strict=True)
    return " + ".join(text if w == 1 else f"({w!r})*({text})" for w, text in pairs if w) or "0"


def _transform(new: Powers, old: Powers, begin: float) -> Powers:
    """Laplace transform of the difference, from `begin` on."""
    change = added([*new.items(), *((power, -c) for power, c in old.items())])
    if begin and change:
        degrees = range(int(max(change)) + 1)
        if not set(change) <= set(degrees):
            raise ValueError("pieces that do not differ by polynomials")
        moved = Polynomial([change.get(k, 0.0) for k in degrees])(Polynomial([begin, 1.0]))
        change = {float(k): c for k, c in enumerate(moved.coef.tolist())}
    return {-power - 1.0: c * math.gamma(power + 1.0) for power, c in change.items()}


def _powers(node: ast.expr) -> Powers:
    """A formula as a sum of powers of t."""
    match node:
        case ast.Constant(value=float() | int() as value):
            return {0.0: float(value)}
        case ast.Name(id="t"):
            return {1.0: 1.0}
        case ast.UnaryOp(op=ast.USub(), operand=one):
            return {power: -c for power, c in _powers(one).items()}
        case ast.Call(func=ast.Name(id="sqrt"), args=[one]):
            return _power(_powers(one), 0.5)
        case ast.BinOp(left=one, op=operation, right=other):
            a, b = _powers(one), _powers(other)
            match operation:
                case ast.Add() | ast.Sub():
                    sign = 1.0 if isinstance(operation, ast.Add) else -1.0
                    return added([*a.items(), *((power, sign * c) for power, c in b.items())])
                case ast.Pow():
                    return _power(a, _power(b, 1.0)[0.0])
                case ast.Div():
                    b = _power(b, -1.0)
            return added((p + q, c * d) for p, c in a.items() for q, d in b.items())
    raise ValueError(f"{ast.unparse(node)} is no sum of powers of t")


def _power(base: Powers, exponent: float) -> Powers:
    ((power, coefficient),) = base.items()
    return {power * exponent: coefficient**exponent}
