"""Pulses in formulas of the time, found before a run by the ranges of the formulas.

Formulas of forces, of given displacements, and of Lagrangians at one state of the motion are
searched. Every piece of a force is halved until no part can hide a pulse: the range of each
function in the formula is at most a few times the span of 17 samples, and a polynomial through 9 of
them meets the others; or the largest impulse that is possible in the part does not matter. Steps
have to end at the ends of parts that are far shorter than usual.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.forcing import Forcing, ForcingPiece, formula_of
from fvi_cli.effects.lagrangian import TIME, Lagrangian
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.local_error.forces import SceneForces, may_hide
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.algebra.builder import Builder
from fvi_cli.mathematics.arrays import Array, Mask
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.intervals.traced import trace
from fvi_cli.mathematics.lagrange import LagrangeBasis

LOOKED_AT = (0.0, 0.37, 0.74)
"""Times of the states in which a Lagrangian is examined, relative to T."""
FIRST_PARTS = 16  # of a piece, before any halving
MOST_PARTS = 40_000
"""Most parts of one level; with more the search is given up."""
SHORTEST = 2.0**-46
"""Parts are not halved below this share of their piece."""
NARROW = 0.25
"""Steps end at the ends of parts shorter than this share of the median, by time."""
ROUND_OFF = 1e-14
"""Relative to the largest force times the length of the run; smaller impulses do not count."""


@dataclass(frozen=True, kw_only=True)
class Pulses:
    """Result of a search for pulses."""

    points: tuple[float, ...] = ()  # times at which steps have to end, ascending
    unresolved_at: float | None = None  # time near which something may hide; None: nowhere


Motion = Callable[[Array], tuple[Array, Array, Array]]
"""From times ``(...)`` to positions, velocities and momenta ``(..., d)``."""


@dataclass(frozen=True, kw_only=True)
class Pulsed:
    """A quantity with formulas of the time, and its pulses."""

    name: str
    effect: Callable[[Array], Array]  # values whose integral counts, from times (...) to (..., k)
    pulses: Pulses


def pulses_that_move(scene: Scene, length: float) -> Pulses:
    """Pulses of formulas of the time that may move a scene by more than `length` until its end."""
    every = [one.pulses for one in pulsed(scene, length)]
    unresolved = (one.unresolved_at for one in every if one.unresolved_at is not None)
    return Pulses(
        points=tuple(sorted({time for one in every for time in one.points})),
        unresolved_at=min(unresolved, default=None),
    )


def pulsed(scene: Scene, length: float, motion: Motion | None = None) -> Iterator[Pulsed]:
    """Quantities with formulas of the time, with the pulses that may move a scene by this length.

    A Lagrangian is examined along a motion, by default uniform motion from the start.
    """
    end, (x, v) = scene.final_time, (scene.initial_position, scene.initial_velocity)
    if scene.prescribed is not None:
        given, rate = scene.prescribed.displacement, scene.prescribed.rate
        # work is dissipated by the square of the rate, so that low pulses count that are narrow
        found = find_pulses(given, end, 0.0)
        yield Pulsed(name="displacement", effect=lambda t: rate(t) ** 2, pulses=found)
        return
    lagrangian = scene.lagrangian
    is_moved = lagrangian and lagrangian.depends_on_time and may_hide(lagrangian.value)
    if scene.forcing is None and not is_moved:
        return
    mobility = SceneForces(scene).mobility(x, v, 0.0)
    impulse = length / (mobility * end) if mobility > 0 else math.inf
    if scene.forcing is not None:
        found = find_pulses(scene.forcing, end, impulse)
        yield Pulsed(name="force", effect=scene.forcing, pulses=found)
    if lagrangian is not None and is_moved:
        yield from _pulsed_lagrangian(
            lagrangian, end, motion or _uniform(lagrangian, x, v, end), impulse
        )


def _uniform(lagrangian: Lagrangian, x: Array, v: Array, end: float) -> Motion:
    """Uniform motion; not from 0, and not at rest, so that forces may act."""
    size = float(np.abs(x).max()) or float(np.abs(v).max()) * end or 1.0
    x, v = x + (x == 0) * size, v + (v == 0) * size / end
    p, _ = lagrangian.forces(x, v, 0.0)

    def motion(t: Array) -> tuple[Array, Array, Array]:
        along = x + t[..., None] * v
        return along, np.broadcast_to(v, along.shape), np.broadcast_to(p, along.shape)

    return motion


def _pulsed_lagrangian(
    lagrangian: Lagrangian, end: float, motion: Motion, impulse: float
) -> Iterator[Pulsed]:
    """Forces, and velocities by momenta, with the pulses in the first state that has any."""

    def force(t: Array) -> Array:
        position, velocity, _ = motion(t)
        return lagrangian.forces(position, velocity, t)[1]

    def velocity(t: Array) -> Array:
        position, _, momentum = motion(t)
        return lagrangian.velocity(position, momentum, t)

    every = [_formulas_at(lagrangian, *motion(np.array(share * end))[:2]) for share in LOOKED_AT]
    for kind, effect in enumerate((force, velocity)):
        found = Pulses()
        for one in filter(None, every):
            found = find_pulses(one[kind], end, 0.0 if kind else impulse)
            if found.points or found.unresolved_at is not None:
                break
        yield Pulsed(name="Lagrangian", effect=effect, pulses=found)


def _formulas_at(lagrangian: Lagrangian, position: Array, velocity: Array) -> list[Forcing]:
    """Forces, and the terms of velocities by momenta, in one state; empty if there are none."""
    d = lagrangian.dimension
    names = (*lagrangian.coordinates, *lagrangian.velocities)
    state = dict(zip(names, map(float, (*position, *velocity)), strict=True))
    values = {name: float(one) for name, one in lagrangian.parameters.items()}
    builder = Builder()
    try:
        found = builder.include(lagrangian.second[: 2 * d + d * d], {**values, **state})
        masses = [1.0 / one for one in found[2 * d :: d + 1]]
        momenta = [one * mass for one, mass in zip(found[:d], masses, strict=True)]
    except ExpressionError:
        return []
    components = (
        tuple(Expression("of t", (TIME,), (), builder.system([one])) for one in terms)
        for terms in (found[d : 2 * d], [*masses, *momenta])
    )
    return [Forcing(pieces=(ForcingPiece(components=one),)) for one in components]


def find_pulses(forcing: Forcing | None, final_time: float, negligible: float) -> Pulses:
    """Search for pulses of a force in [0, T].

    Only formulas are searched, also those that are added to samples. Impulses, force times time, up
    to `negligible` do not matter.
    """
    points: set[float] = set()
    unresolved: list[float] = []
    begin = 0.0
    for piece in () if forcing is None else forcing.pieces:
        end = min(piece.until, final_time)
        if begin >= end:
            break
        for component, _ in piece.distinct:
            formula = formula_of(component)
            if formula is not None and may_hide(formula.system):
                found = _Search(formula, begin, end, negligible).result()
                points.update(found.points)
                unresolved += [] if found.unresolved_at is None else [found.unresolved_at]
        begin = end
    # ends of neighbouring parts are rounded apart
    ends = np.array(sorted(points))
    kept = ends[np.diff(ends, prepend=-math.inf) > 8 * np.spacing(final_time)]
    return Pulses(points=tuple(kept.tolist()), unresolved_at=min(unresolved, default=None))


@functools.cache
def _nodes() -> tuple[Array, Array, Array, Array]:
    """17 points in [0, 1], maps from 9 of them to the others, and from 17 to both halves."""
    points = 0.5 - 0.5 * np.cos(np.pi * np.arange(17) / 16)
    coarse, fine = (LagrangeBasis(control_points=one) for one in (points[::2], points))
    return (
        points,
        coarse.values(points[1::2]).T,
        fine.values(0.5 * points).T,
        fine.values(0.5 + 0.5 * points).T,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Level:
    """Parts of one length; `children`: place of the first half in the next level, or -1."""

    begin: Array
    values: Array
    children: NDArray[np.int_]
    is_smooth: Mask


class _Search:
    """The search of one formula in one piece."""

    def __init__(self, formula: Expression, begin: float, end: float, negligible: float) -> None:
        self._formula, self._begin, self._end = formula, begin, end
        self._negligible = negligible
        self._unresolved: float | None = None
        self._levels: list[_Level] = []

    def _length(self, level: int) -> float:
        return (self._end - self._begin) / FIRST_PARTS * 0.5**level

    def result(self) -> Pulses:
        self._divide()
        panels = self._panels()
        lengths = panels[:, 1] - panels[:, 0]
        order = np.argsort(lengths)
        by_time = np.cumsum(lengths[order])
        median = lengths[order][np.searchsorted(by_time, 0.5 * by_time[-1])]
        narrow = (lengths < NARROW * median) & (panels[:, 2] > 0)
        ends = np.unique(panels[narrow, :2])
        inside = ends[(ends > self._begin) & (ends < self._end)]
        return Pulses(points=tuple(inside.tolist()), unresolved_at=self._unresolved)

    def _divide(self) -> None:
        """Halve parts until no pulse can hide in them."""
        points, coarse, _, _ = _nodes()
        length = self._length(0)
        begin: Array = self._begin + length * np.arange(FIRST_PARTS, dtype=float)
        level = 0
        while begin.size:
            length = self._length(level)
            times = begin[:, None] + length * points
            box, values, undersampled = trace(self._formula, begin, begin + length, times)
            if level == 0:
                reach = np.maximum(np.abs(box.low), np.abs(box.high)).max()
                if math.isfinite(reach):
                    least = ROUND_OFF * reach * (self._end - self._begin)
                    self._negligible = max(self._negligible, least)
            with np.errstate(all="ignore"):
                missed = np.abs(values[:, ::2] @ coarse.T - values[:, 1::2]).max(axis=1)
                is_rough = ~(missed * length <= self._negligible)
                matters = ~(box.width * length <= self._negligible)
            halved = matters & (undersampled | is_rough)
            shortest = length <= SHORTEST * (self._end - self._begin)
            if shortest or halved.sum() > MOST_PARTS:
                # near a singular power no polynomial is close, but no pulse can hide
                self._give_up(begin[halved & undersampled] if shortest else begin[halved])
                halved = np.zeros_like(halved)
            children = np.where(halved, 2 * (np.cumsum(halved) - 1), -1)
            self._levels.append(
                _Level(begin=begin, values=values, children=children, is_smooth=~halved)
            )
            first = begin[halved]
            begin = np.stack([first, first + 0.5 * length], axis=1).ravel()
            level += 1

    def _give_up(self, begin: Array) -> None:
        """Note a part that may hide a pulse; at the piece's beginning the force may be singular."""
        inside = begin[begin > self._begin]
        if inside.size:
            self._unresolved = float(inside.min())

    def _panels(self) -> Array:
        """Largest parts in which a polynomial meets all samples: begin, end, whether by a pulse."""
        _, _, left, right = _nodes()
        smooth = self._levels[-1].is_smooth
        kept = [smooth]
        for level in range(len(self._levels) - 2, -1, -1):
            one, finer = self._levels[level], self._levels[level + 1]
            halved = np.flatnonzero(one.children >= 0)
            first = one.children[halved]
            is_smooth = one.is_smooth.copy()
            with np.errstate(all="ignore"):
                missed = sum(
                    np.abs(one.values[halved] @ half.T - finer.values[first + side]).max(axis=1)
                    for side, half in enumerate((left, right))
                )
                is_met = 0.5 * self._length(level) * missed <= self._negligible
            is_smooth[halved] = is_met & smooth[first] & smooth[first + 1]
            smooth = is_smooth
            kept.append(smooth)
        panels: list[Array] = []
        place = np.arange(FIRST_PARTS)
        by_pulse = np.zeros(FIRST_PARTS, dtype=bool)
        for level, is_smooth in enumerate(reversed(kept)):
            one, length = self._levels[level], self._length(level)
            done = is_smooth[place] | (one.children[place] < 0)
            begin = one.begin[place]
            panels.append(np.stack([begin, begin + length, by_pulse], axis=1)[done])
            # parts at the beginning of a piece may be halved for a singular power
            by_pulse = np.repeat((by_pulse | (begin > self._begin))[~done], 2)
            first = one.children[place[~done]]
            place = np.stack([first, first + 1], axis=1).ravel()
        return np.concatenate(panels)
