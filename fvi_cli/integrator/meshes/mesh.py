"""Meshes that are given beforehand: stretches of equal steps, one after the other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array, Mask, Places

ON_GRID = 1e-9
"""A break point this close to a point of the mesh, relative to its time, is that point."""
LARGEST_GRADING = 20.0  # exponent r


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Equal steps from one time to another."""

    begin: float  # times of its ends; `end` is given exactly, it is no sum of steps
    end: float
    n_steps: int
    # size of each, the same bits in all stretches that have it, so that tables are shared
    step_size: float
    # whether the motion may be singular at the beginning: the start, or a break point
    is_fresh: bool = False

    def time_after(self, count: int) -> float:
        """Time after so many of its steps."""
        return self.end if count == self.n_steps else self.begin + count * self.step_size


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """Steps from 0 to T: stretches one after the other, without gaps."""

    stretches: tuple[Stretch, ...]
    reported: Mask | None = None  # which points are reported, (n + 1,); None: all

    @property
    def final_time(self) -> float:
        """T."""
        return self.stretches[-1].end

    @cached_property
    def n_steps(self) -> int:
        """Number of all steps, including steps that are not reported."""
        return sum(one.n_steps for one in self.stretches)

    @cached_property
    def shortest_step(self) -> float:
        """Least step size."""
        return min(one.step_size for one in self.stretches)

    @cached_property
    def equivalent_steps(self) -> float:
        """Sum of (shortest step / step): so many of the shortest steps have the same decay."""
        return sum(one.n_steps * self.shortest_step / one.step_size for one in self.stretches)

    @cached_property
    def n_reported(self) -> int:
        """Number of reported points after t = 0."""
        return self.n_steps if self.reported is None else int(self.reported.sum()) - 1

    @cached_property
    def times(self) -> Array:
        """Points of all steps, shape ``(n + 1,)``."""
        inside = [one.begin + one.step_size * np.arange(1, one.n_steps) for one in self.stretches]
        ends = [np.append(own, one.end) for own, one in zip(inside, self.stretches, strict=True)]
        return np.concatenate([[0.0], *ends])

    @property
    def sizes(self) -> Array:
        """Sizes of all steps, shape ``(n,)``."""
        return np.repeat(
            [one.step_size for one in self.stretches], [one.n_steps for one in self.stretches]
        )

    def check_breaks(self, breaks: Sequence[float]) -> None:
        """Refuse a mesh with a break point inside of a step.

        Raises
        ------
        ValueError
            With the break point.
        """
        for time in breaks:
            if not are_near(self.times, [time]).any():
                raise ArgumentError(
                    "mesh", f"the break point t = {time:g} lies inside of a step; make it a point"
                )


def misplaced_break_point(breaks: Sequence[float], final_time: float, n_steps: int) -> str:
    """Which break point lies inside one of N equal steps, and what to write; empty if none does."""
    for one in breaks:
        place = one / final_time * n_steps
        if abs(place - round(place)) > ON_GRID * max(1.0, place):
            return f"the break point t = {one:g} inside a step; write an N that makes N t / T whole"
    return ""


def mesh_of(times: Array, breaks: tuple[float, ...] = ()) -> Mesh:
    """A mesh through given points, all of them reported; break points must be among them.

    Raises
    ------
    ValueError
        If the times do not increase from 0, or a break point is not one of them.
    """
    times = np.asarray(times, dtype=float)
    if times.ndim != 1 or times.size < 2 or times[0] != 0 or not (np.diff(times) > 0).all():
        raise ArgumentError("mesh", "the times must increase from 0")
    mesh = mesh_through(times, np.diff(times), np.arange(1, times.size - 1), breaks)
    mesh.check_breaks(breaks)
    return mesh


def mesh_through(times: Array, sizes: Array, ends: Places, breaks: Sequence[float]) -> Mesh:
    """Stretches of steps of given sizes, which end at the points of these numbers.

    At 0 and at the breaks the motion may be singular.
    """
    edges = np.array([0, *ends, sizes.size])
    fresh = are_near(times[edges], (0.0, *breaks)).tolist()
    points = zip(edges.tolist(), times[edges].tolist(), fresh, strict=True)
    return Mesh(
        stretches=tuple(
            Stretch(
                begin=begin,
                end=end,
                n_steps=last - first,
                step_size=float(sizes[first]),
                is_fresh=is_fresh,
            )
            for (first, begin, is_fresh), (last, end, _) in itertools.pairwise(points)
        )
    )


def are_near(times: Array, breaks: Sequence[float]) -> Mask:
    """Which of the times are break points, but for round-off, ``(n,)``."""
    known = np.sort([-math.inf, *breaks, math.inf])
    after = np.searchsorted(known, times)
    away = np.minimum(times - known[after - 1], known[after] - times)
    return np.asarray(away <= ON_GRID * times)


def share_steps(ends: Sequence[float], n_steps: int) -> Array:
    """Numbers of steps of the parts between successive ends: those to the nearest grid points.

    `ends` are from 0 to T. Every part has a step at least.

    Raises
    ------
    ValueError
        If there are fewer steps than parts.
    """
    order = np.arange(len(ends))
    if n_steps < order[-1]:
        raise ArgumentError(
            "n_steps",
            f"{n_steps} is not allowed; {order[-1]} parts between break points need "
            "at least one step each",
        )
    nearest = np.rint(n_steps * (np.array(ends) / ends[-1])).astype(int)
    nearest = np.maximum.accumulate(nearest - order) + order
    return np.diff(np.minimum(nearest, n_steps - order[::-1]))


def uniform_mesh(final_time: float, n_steps: int, breaks: tuple[float, ...] = ()) -> Mesh:
    """N equal steps; a part between break points that are not on the grid has steps of its own."""
    ends, h = (0.0, *breaks, final_time), final_time / n_steps
    stretches = []
    for (a, b), count in zip(
        itertools.pairwise(ends), share_steps(ends, n_steps).tolist(), strict=True
    ):
        # break points may lie slightly off the grid: steps must end on them
        on_grid = abs(count * h - (b - a)) <= 1e-12 * (b - a) + 4 * math.ulp(b)
        size = h if on_grid else (b - a) / count
        stretches.append(Stretch(begin=a, end=b, n_steps=count, step_size=size, is_fresh=True))
    return Mesh(stretches=tuple(stretches))


def graded_mesh(
    final_time: float, n_steps: int, grading: float, breaks: tuple[float, ...] = ()
) -> Mesh:
    r"""Steps with ends :math:`t_k = a + (b - a) (k/n)^r` on every part [a, b].

    Parameters
    ----------
    final_time
        T.
    n_steps
        N over the whole of [0, T], shared out by the lengths of the parts between break points.
    grading
        r from 1 to 20; 1 gives equal steps on each part.
    breaks
        Break points inside (0, T).

    Raises
    ------
    ValueError
        For a grading out of range, steps that vanish in round-off, and fewer steps than parts.
    """
    if not 1 <= grading <= LARGEST_GRADING:
        raise ArgumentError(
            "grading", f"{grading!r} is not allowed; it must be 1 to {LARGEST_GRADING:g}"
        )
    if grading == 1:
        return uniform_mesh(final_time, n_steps, breaks)
    ends, parts = (0.0, *breaks, final_time), []
    for (a, b), count in zip(itertools.pairwise(ends), share_steps(ends, n_steps), strict=True):
        parts.append(a + (b - a) * (np.arange(count) / count) ** grading)
    return mesh_of(np.concatenate([*parts, [final_time]]), breaks)
