"""Meshes that are given beforehand: stretches of equal steps, one after the other."""

from __future__ import annotations

import bisect
import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np

from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.break_points import ON_GRID, are_on_grid
from fvi_cli.mathematics.arrays import Array

LARGEST_GRADING = 20.0  # exponent r


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Equal steps from one time to another."""

    begin: float  # times of its ends; `end` is given exactly, it is no sum of steps
    end: float
    n_steps: int  # number of steps
    # size of each, the same bits in all stretches that have it, so that tables are shared
    step_size: float
    # points at this distance from the beginning belong to the grid that is reported; 0: none
    reported_every: int = 1
    # whether the motion may be singular at the beginning: the start, or a break point
    is_fresh: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """Steps from 0 to T.

    Parameters
    ----------
    stretches
        One after the other, without gaps.

    Raises
    ------
    ValueError
        For stretches with gaps, without steps, or whose steps do not lead to their end.
    """

    stretches: tuple[Stretch, ...]

    def __post_init__(self) -> None:
        if not self.stretches or self.stretches[0].begin != 0:
            raise ArgumentError("mesh", "it must begin at 0")
        for one, following in itertools.zip_longest(self.stretches, self.stretches[1:]):
            if following is not None and following.begin != one.end:
                raise ArgumentError("mesh", f"a gap at t = {one.end:g}")
            length = one.end - one.begin
            if one.n_steps < 1 or not length > 0 or not math.isfinite(length):
                raise ArgumentError(
                    "mesh", f"{one.n_steps} steps from {one.begin:g} to {one.end:g}"
                )
            displacement = one.n_steps * one.step_size
            if abs(displacement - length) > 1e-9 * length + 1e-14 * one.end:
                raise ArgumentError(
                    "mesh", f"{one.n_steps} steps of {one.step_size:g} make {displacement:g}"
                )

    @property
    def final_time(self) -> float:
        """T."""
        return self.stretches[-1].end

    @functools.cached_property
    def n_steps(self) -> int:
        """Number of all steps, including steps that are not reported."""
        return sum(one.n_steps for one in self.stretches)

    @functools.cached_property
    def shortest_step(self) -> float:
        """Least step size."""
        return min(one.step_size for one in self.stretches)

    @functools.cached_property
    def equivalent_steps(self) -> float:
        """Sum of (shortest step / step): so many of the shortest steps have the same decay."""
        shortest = self.shortest_step
        return sum(one.n_steps * shortest / one.step_size for one in self.stretches)

    @functools.cached_property
    def n_reported(self) -> int:
        """Number of reported points after t = 0."""
        return sum(
            one.n_steps // one.reported_every for one in self.stretches if one.reported_every
        )

    @functools.cached_property
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

    def check_breaks(self, breaks: tuple[float, ...]) -> None:
        """Refuse a mesh with a break point inside of a step.

        Raises
        ------
        ValueError
            With the break point and the step.
        """
        ends = [one.end for one in self.stretches]
        for time in breaks:
            one = self.stretches[min(bisect.bisect_left(ends, time), len(ends) - 1)]
            place = (time - one.begin) / one.step_size
            distance = abs(place - round(place))
            if distance > ON_GRID * max(1.0, place) + 4 * math.ulp(time) / one.step_size:
                raise ArgumentError(
                    "mesh",
                    f"the break point t = {time:g} of the forcing lies inside of a step of "
                    f"length {one.step_size:g}; make it a point of the mesh",
                )


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
    fresh = {0}
    for one in breaks:
        index = int(np.abs(times - one).argmin())
        if abs(times[index] - one) > ON_GRID * float(np.diff(times).min()):
            raise ArgumentError("mesh", f"the break point t = {one:g} is not one of its points")
        fresh.add(index)
    return Mesh(
        stretches=tuple(
            Stretch(begin=a, end=b, n_steps=1, step_size=b - a, is_fresh=index in fresh)
            for index, (a, b) in enumerate(itertools.pairwise(times.tolist()))
        )
    )


def steps_of_parts(ends: tuple[float, ...], n_steps: int) -> tuple[int, ...]:
    """How many of `n_steps` steps each part between successive `ends` gets: by length, >= 1.

    Raises
    ------
    ValueError
        If there are fewer steps than parts.
    """
    lengths = [b - a for a, b in itertools.pairwise(ends)]
    if n_steps < len(lengths):
        raise ArgumentError(
            "n_steps",
            f"{n_steps} is not allowed; {len(lengths)} parts between break points need "
            "at least one step each",
        )
    shares = [n_steps * length / sum(lengths) for length in lengths]
    counts = [max(1, math.floor(share)) for share in shares]
    while sum(counts) != n_steps:
        step = 1 if sum(counts) < n_steps else -1
        able = [i for i, count in enumerate(counts) if step > 0 or count > 1]
        index = max(able, key=lambda i: step * (shares[i] - counts[i]))
        counts[index] += step
    return tuple(counts)


def _parts(
    final_time: float, n_steps: int, breaks: tuple[float, ...]
) -> list[tuple[float, float, int, float]]:
    """Begin, end, number of steps and step size of every part between break points.

    If all break points lie on the grid of N equal steps, its steps are taken.
    """
    h = final_time / n_steps
    places = [one / h for one in breaks]
    ends = (0.0, *breaks, final_time)
    if are_on_grid(np.array(places)).all() and all(
        round(a) < round(b) for a, b in itertools.pairwise([0, *places, n_steps])
    ):
        indices = [0, *(round(p) for p in places), n_steps]
        counts = [b - a for a, b in itertools.pairwise(indices)]
        # break points may lie slightly off the grid: steps must end on them
        sizes = [
            h if abs(n * h - (b - a)) <= 1e-12 * (b - a) + 4 * math.ulp(b) else (b - a) / n
            for (a, b), n in zip(itertools.pairwise(ends), counts, strict=True)
        ]
    else:
        counts = list(steps_of_parts(ends, n_steps))
        sizes = [(b - a) / n for (a, b), n in zip(itertools.pairwise(ends), counts, strict=True)]
    return [
        (a, b, n, size)
        for (a, b), n, size in zip(itertools.pairwise(ends), counts, sizes, strict=True)
    ]


def uniform_mesh(final_time: float, n_steps: int, breaks: tuple[float, ...] = ()) -> Mesh:
    """N equal steps; on every part between break points that do not fit, equal steps of its own."""
    return Mesh(
        stretches=tuple(
            Stretch(begin=a, end=b, n_steps=n, step_size=size, is_fresh=True)
            for a, b, n, size in _parts(final_time, n_steps, breaks)
        )
    )


def check_graded(ends: tuple[float, ...], n_steps: int, grading: float) -> tuple[int, ...]:
    """How many of `n_steps` graded steps each part between successive `ends` gets.

    Raises
    ------
    ValueError
        For a grading out of range, a mesh whose first step vanishes in round-off, and fewer steps
        than parts.
    """
    if not 1 <= grading <= LARGEST_GRADING:
        raise ArgumentError(
            "grading", f"{grading!r} is not allowed; it must be 1 to {LARGEST_GRADING:g}"
        )
    counts = steps_of_parts(ends, n_steps)
    for (a, b), count in zip(itertools.pairwise(ends), counts, strict=True):
        first = (b - a) * (1.0 / count) ** grading
        # the second point must differ from the first, and the third from the second
        if not a + first > a + 1e-3 * first > a:
            raise ArgumentError(
                "grading",
                f"{grading:g} with {n_steps} steps makes a first step of "
                f"{first:.3g}, which vanishes in round-off; take a smaller grading",
            )
    return counts


def graded_mesh(
    final_time: float, n_steps: int, grading: float, breaks: tuple[float, ...] = ()
) -> Mesh:
    r"""Steps with ends :math:`t_k = a + (b - a) (k/N)^r` on every part [a, b].

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
        For a grading out of range, a mesh whose first step vanishes in round-off, and fewer steps
        than parts.
    """
    ends = (0.0, *breaks, final_time)
    counts = check_graded(ends, n_steps, grading)
    if grading == 1:
        return uniform_mesh(final_time, n_steps, breaks)
    stretches = []
    for (a, b), count in zip(itertools.pairwise(ends), counts, strict=True):
        fractions = (np.arange(count + 1) / count) ** grading
        times = a + (b - a) * fractions
        times[-1] = b
        sizes = (b - a) * np.diff(fractions)
        stretches += [
            Stretch(begin=begin, end=end, n_steps=1, step_size=size, is_fresh=index == 0)
            for index, (begin, end, size) in enumerate(
                zip(times[:-1].tolist(), times[1:].tolist(), sizes.tolist(), strict=True)
            )
        ]
    return Mesh(stretches=tuple(stretches))
