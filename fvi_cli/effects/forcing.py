"""Forcing by expressions in time or samples, possibly in pieces with jumps between them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvi_cli.effects.sampled import FunctionForce, Interpolation, SampledForce
from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array, set_arrays
from fvi_cli.mathematics.expressions import Expression

LARGEST_GAP = 10.0
"""Gap of samples, in median spacings, from which on it is remarked on."""

ForceComponent = Expression | SampledForce | FunctionForce


@dataclass(frozen=True, kw_only=True, eq=False)
class ForcingPiece:
    """One piece of a force, W s(t) of n functions of the time, up to and including `until`.

    Formulas are smooth inside the piece. Samples may have knots there, at which one polynomial
    follows another.
    """

    components: tuple[ForceComponent, ...]  # the functions s
    until: float = math.inf
    # W, (d, n); None: there is one function for each coordinate, and equal ones are kept once
    weights: Any = None

    def __post_init__(self) -> None:
        weights = self.weights
        if weights is None:
            places = {one: place for place, one in enumerate(dict.fromkeys(self.components))}
            weights = np.eye(len(places))[[places[one] for one in self.components]]
            object.__setattr__(self, "components", tuple(places))
        set_arrays(self, weights=weights)

    def evaluate(self, time: Array, rows: Array | None = None) -> Array:
        """The force at `time`, shape ``(...)`` to ``(..., d)``; `until` is not checked here.

        With `rows` combinations ``(c, d)`` of it, shape ``(..., c)``.
        """
        time = np.asarray(time, dtype=float)
        acting = self._acting if rows is None else _acting(self.components, rows @ self.weights)
        result = np.zeros((*time.shape, len(self.weights if rows is None else rows)))
        for component, places, factors in acting:
            value = np.asarray(component.evaluate({"t": time}))
            result[..., places] += value[..., None] * factors
        return result

    @cached_property
    def _acting(self) -> Acting:
        return _acting(self.components, self.weights)


Acting = list[tuple[ForceComponent, Any, Array]]
"""Functions with the places where they act, and their weights there."""


def _acting(components: Sequence[ForceComponent], weights: Array) -> Acting:
    """What has weights: a function may be infinite where it has none."""
    found: Acting = []
    for component, column in zip(components, weights.T, strict=True):
        places = np.flatnonzero(column)
        if places.size:
            everywhere = places.size == column.size
            found.append((component, slice(None) if everywhere else places, column[places]))
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Forcing:
    """A force f(t) in R^d, smooth inside each piece except at the knots of samples.

    Raises
    ------
    ValueError
        If the ends do not increase from 0 to infinity, or if the pieces differ in dimension.
    """

    pieces: tuple[ForcingPiece, ...]  # in the order of time; only the last has no end

    def __post_init__(self) -> None:
        ends = [0.0, *(piece.until for piece in self.pieces)]
        if ends[-1] != math.inf or any(not a < b for a, b in itertools.pairwise(ends)):
            words = f"until must increase from 0 to no end, got {ends[1:]}"
            raise ArgumentError("pieces", words)
        if len({len(piece.weights) for piece in self.pieces}) != 1:
            raise ArgumentError("pieces", "all pieces must have the same number of components")

    @classmethod
    def from_text(cls, *components: str) -> Forcing:
        """One smooth piece from d expressions in ``t``."""
        expressions = tuple(Expression.parse(text, variables=("t",)) for text in components)
        return cls(pieces=(ForcingPiece(components=expressions),))

    @classmethod
    def from_functions(
        cls, *functions: Callable[[Array], Array], break_points: Sequence[float] = ()
    ) -> Forcing:
        """A force from d functions of the time, smooth between break points.

        A function maps times of any shape to the force, in the same shape. At break points it may
        jump or have kinks; there the value before counts.
        """
        components = tuple(FunctionForce(function=one) for one in functions)
        ends = (*break_points, math.inf)
        return cls(pieces=tuple(ForcingPiece(components=components, until=end) for end in ends))

    @classmethod
    def from_samples(
        cls,
        time: ArrayLike,
        *values: ArrayLike,
        interpolation: Interpolation = "linear",
        beyond: Literal["zero", "refuse"] = "refuse",
    ) -> Forcing:
        """A force through samples of d components, each ``(n,)``, at the same times.

        After the last sample the force is zero (``zero``), or longer scenes are refused
        (``refuse``).
        """
        components = tuple(
            SampledForce.through(time, one, interpolation, source=f"component {index}")
            for index, one in enumerate(values, start=1)
        )
        if beyond == "refuse":
            return cls(pieces=(ForcingPiece(components=components),))
        first = ForcingPiece(components=components, until=float(components[0].knots[-1]))
        nothing = ForcingPiece(components=(), weights=np.zeros((len(components), 0)))
        return cls(pieces=(first, nothing))

    def cut(self, times: Sequence[float]) -> Forcing:
        """The same force with further break points."""
        pieces, begin = [], 0.0
        for piece in self.pieces:
            ends = [time for time in times if begin < time < piece.until]
            pieces += [replace(piece, until=end) for end in (*sorted(ends), piece.until)]
            begin = piece.until
        return Forcing(pieces=tuple(pieces))

    def along(self, directions: Array) -> Forcing:
        """The force D f(t) of directions D, ``(d, c)``, by a force of c components."""
        pieces = [replace(one, weights=directions @ one.weights) for one in self.pieces]
        return Forcing(pieces=tuple(pieces))

    def plus(self, other: Forcing) -> Forcing:
        """The sum of two forces."""
        own, others = self.cut(other.break_points).pieces, other.cut(self.break_points).pieces
        pieces = []
        for one, more in zip(own, others, strict=True):
            components = (*one.components, *more.components)
            weights = np.hstack([one.weights, more.weights])
            pieces.append(replace(one, components=components, weights=weights))
        return Forcing(pieces=tuple(pieces))

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return len(self.pieces[0].weights)

    @cached_property
    def break_points(self) -> tuple[float, ...]:
        """Times at which one piece ends and the next begins."""
        return tuple(piece.until for piece in self.pieces[:-1])

    @property
    def components(self) -> tuple[ForceComponent, ...]:
        """The functions of all pieces."""
        return tuple(one for piece in self.pieces for one in piece.components)

    @property
    def samples(self) -> tuple[SampledForce, ...]:
        """Its components that are given by samples."""
        return tuple(one for one in self.components if isinstance(one, SampledForce))

    def objection(self, final_time: float) -> str:
        """Why the force is not allowed up to a time; empty if it is allowed.

        Samples must reach to the end of their piece.
        """
        slack = 1e-9 * final_time
        for begin, piece in zip((0.0, *self.break_points), self.pieces, strict=True):
            end = min(piece.until, final_time)
            samples = [one for one in piece.components if isinstance(one, SampledForce)]
            for one in samples if begin < end else ():
                first, last = float(one.knots[0]), float(one.knots[-1])
                if first > begin + slack or last < end - slack:
                    return (
                        f"{one.source} has samples from {first:g} to {last:g}, but acts from "
                        f"{begin:g} to {end:g}; give more of them, or beyond='zero' for no force "
                        "behind the last"
                    )
        return ""

    def remarks(self, final_time: float, step_size: float) -> tuple[str, ...]:
        """Which samples lie closer than steps of this size or have gaps, in a sentence for each."""
        found = {}
        for one in self.samples:
            knots = one.knots[(one.knots >= 0.0) & (one.knots <= final_time)]
            if knots.size < 2:
                continue
            gaps = np.diff(knots)
            spacing, widest = float(np.median(gaps)), int(gaps.argmax())
            if step_size > spacing * (1.0 + 1e-9):
                found["steps", one.source] = (
                    f"steps: h = {step_size:.4g} is longer than the spacing {spacing:.4g} of "
                    f"{one.source}"
                )
            if gaps[widest] > LARGEST_GAP * spacing:
                found["samples", one.source] = (
                    f"samples: {one.source} has a gap of {gaps[widest] / spacing:.0f} intervals "
                    f"after t = {knots[widest]:g}"
                )
        return tuple(found.values())

    def on_steps(self, start: Array, step_size: float, offsets: Array) -> Array:
        r"""One-sided values on steps that no break point cuts.

        Takes the starts ``(n,)`` of n steps and offsets ``(r,)`` in [0, 1]; returns ``(n, r, d)``.
        At offsets 0 and 1 the limit from inside the step is taken.
        """
        which = np.searchsorted(np.array(self.break_points), start + 0.5 * step_size)
        times = start[:, None] + step_size * offsets
        if self._jumps_at_knots:
            # the last bits of a time decide which side of a jump is meant
            inside = 4.0 * np.spacing(np.abs(times) + step_size) * (1.0 - 2.0 * offsets)
            times = times + np.where((offsets == 0.0) | (offsets == 1.0), inside, 0.0)
        return self._by_pieces(times, which)

    def __call__(self, time: Array, rows: Array | None = None) -> Array:
        """F at `time`, shape ``(...)`` to ``(..., d)``; at a break point the earlier piece.

        With `rows` combinations ``(c, d)`` of it, shape ``(..., c)``.
        """
        time = np.asarray(time, dtype=float)
        which = np.searchsorted(np.array(self.break_points), time)
        return self._by_pieces(time, which, rows)

    @cached_property
    def _jumps_at_knots(self) -> bool:
        return any(one.order == 1 for one in self.samples)

    def _by_pieces(self, time: Array, which: NDArray[np.intp], rows: Array | None = None) -> Array:
        if which.size and (which == which.flat[0]).all():
            return self.pieces[int(which.flat[0])].evaluate(time, rows)
        result = np.empty((*time.shape, self.dimension if rows is None else len(rows)))
        for index in np.unique(which):
            chosen = which == index
            result[chosen] = self.pieces[int(index)].evaluate(time[chosen], rows)
        return result
