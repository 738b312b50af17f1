r"""Equal steps with finer ones where the motion begins like a fractional power of t.

A polynomial on [t, t + tau] approximates :math:`t^\sigma` with an error of
:math:`(\tau / t)^{2m} t^\sigma` in the end points of Gauss methods. With equal steps of size h that
is :math:`h^\sigma` on the first few of them, however finely the very first is divided. So steps are
halved on a window of the grid after every singular point, more often the nearer they are, such that
:math:`\tau \propto t^{1 - 1/r}` with :math:`r \sigma > 2 m`: the mesh
:math:`t_k \propto (k/n)^r` (Brunner, *Collocation Methods for Volterra Integral and Related
Functional Differential Equations*, Cambridge 2004, section 6.2) in powers of 2, whose points
contain the uniform grid.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from fvi_cli.integrator.meshes.mesh import Mesh, Stretch, _parts

WINDOW_SHARE = 4
"""The window has one of this many steps of a part between break points."""
WINDOW_LEAST = 16
"""Fewest steps of a window, if the part and that share of the run have as many: after a window of W
steps, equal steps approximate a singular power with an error of (4 W)^(-2m)."""
WINDOW_MOST = 512
"""Most steps of a window: after it, equal steps lose less than round-off."""
EXCESS = 0.5
"""How far r sigma lies above 2 m; with equality the error would have a logarithm."""
ROUND_OFF = 1e-16  # steps are cut towards 0 until t^sigma is below this
SHORTEST = 1e-96
"""No step is shorter than this part of a step of the grid: cubes of rates have to stay in range."""
LEAST_ELLIPSE = 1.25
"""Least rho of `_towards_zero`: no step towards a singular point is longer than [t / 81, t]."""
LEAST_IN_ULPS = 256
"""Shortest step after a break point, in units in the last place of its time."""


def graded_start_mesh(
    final_time: float,
    n_steps: int,
    breaks: tuple[float, ...],
    *,
    stages: int,
    exponent: Callable[[bool], float | None],
) -> Mesh:
    """N equal steps, halved again and again towards t = 0 and towards break points.

    For Gauss methods of m stages; `exponent` gives the least fractional power of the time after
    the start (True) or after a break point (False) in the position, None where it is smooth.
    """
    stretches: list[Stretch] = []
    for begin, end, count, size in _parts(final_time, n_steps, breaks):
        power = exponent(begin == 0.0)
        if power is None or size < 2 * least_step(begin):
            stretches.append(
                Stretch(begin=begin, end=end, n_steps=count, step_size=size, is_fresh=True)
            )
            continue
        window = window_of(count, n_steps)
        inside = graded_window(begin, size, window, 2 * stages, power)
        stretches += inside
        if window < count:
            stretches.append(
                Stretch(begin=inside[-1].end, end=end, n_steps=count - window, step_size=size)
            )
        elif inside[-1].end != end:
            stretches[-1] = replace(inside[-1], end=end)
    return Mesh(stretches=tuple(stretches))


def window_of(count: int, n_steps: int) -> int:
    """Number of graded steps in a part of `count` steps of a run of `n_steps`."""
    least = min(n_steps // WINDOW_SHARE, WINDOW_LEAST)
    return max(1, min(max(count // WINDOW_SHARE, least), count, WINDOW_MOST))


def least_step(begin: float) -> float:
    """Shortest step at this time that round-off permits; zero at the start."""
    return LEAST_IN_ULPS * math.ulp(begin) if begin > 0 else 0.0


def graded_window(
    begin: float, size: float, window: int, order: int, power: float
) -> list[Stretch]:
    """Stretches of `window` steps of the grid, finest first."""
    grading = (order + EXCESS) / power
    # with tau ~ t^(1 - 1/r) that share of the steps of a level is halved once more
    share = 2.0 ** (-1.0 / (grading - 1.0)) if grading > 1.0 else 0.0
    levels, least = [window], max(least_step(begin), SHORTEST * size)
    while levels[-1] > 1 and size * 0.5 ** (len(levels) + 1) >= least:
        levels.append(max(1, math.ceil(window * share ** len(levels) - 1e-9)))
    finest = size * 0.5 ** len(levels)
    lengths = [one for one in _towards_zero(order, power) if one == 1 or finest * one >= least]
    stretches: list[Stretch] = []
    done = begin
    for length in reversed(lengths):
        end = begin + finest * length
        stretches.append(
            Stretch(
                begin=done,
                end=end,
                n_steps=1,
                step_size=end - done if begin == 0.0 else finest * length - (done - begin),
                reported_every=0,
                is_fresh=not stretches,
            )
        )
        done = end
    # the finest level fills the remainder of the one above it; its first step is cut already
    for depth in range(len(levels) - 1, -1, -1):
        step = size * 0.5 ** (depth + 1)
        first = 1 if depth == len(levels) - 1 else levels[depth + 1]
        count = 2 * levels[depth] - first
        if count == 0:
            continue
        end = begin + 2 * levels[depth] * step
        stretches += _aligned(done, end, first, count, step, depth + 1)
        done = end
    return stretches


def _towards_zero(order: int, power: float) -> list[float]:
    r"""Ends of the steps that cut [0, 1] towards 0, from 1 on.

    On [t / r, t] the error for :math:`t^\sigma` is about :math:`\rho^{-2m} t^\sigma`, where
    :math:`\rho = (\sqrt r + 1) / (\sqrt r - 1)` belongs to the ellipse through 0 around the step.
    So ratios may grow towards 0; with r = 2 at t = 1 no step errs by more than that one.
    """
    ends, end = [1.0], 1.0
    least = ROUND_OFF ** (1.0 / power)
    first = (math.sqrt(2.0) + 1.0) / (math.sqrt(2.0) - 1.0)
    while end > least:
        rho = max(first * end ** (power / order), LEAST_ELLIPSE)
        ratio = ((rho + 1.0) / (rho - 1.0)) ** 2
        end /= ratio
        ends.append(end)
    return ends


def _aligned(
    begin: float, end: float, first: int, count: int, step: float, depth: int
) -> list[Stretch]:
    """Steps `first` to `first + count` of a level, cut where the reported grid begins to fit."""
    period = 2**depth
    lead = min(count, -first % period)
    found = []
    if lead:
        middle = end if lead == count else begin + lead * step
        reported = lead if (first + lead) % period == 0 else 0
        found.append(
            Stretch(
                begin=begin,
                end=middle,
                n_steps=lead,
                step_size=step,
                reported_every=reported,
            )
        )
        begin, count = middle, count - lead
    if count:
        found.append(
            Stretch(
                begin=begin,
                end=end,
                n_steps=count,
                step_size=step,
                reported_every=period if count >= period else 0,
            )
        )
    return found
