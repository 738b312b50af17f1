r"""The solution of a step that is connected with its beginning.

Far from its solution Newton's iteration may end at another one: if a motion becomes infinite within
a step, at one after the infinity. So where the iteration leads away from its guess, convergence
alone is not enough. All forces and displacements of the step are multiplied by :math:`\theta`; for
the law alone this is a step of length :math:`\theta h`. The solution is followed from free motion
at :math:`\theta = 0` to 1 in parts over which Newton's iteration contracts from its first change on
(Deuflhard, Newton Methods for Nonlinear Problems, 2004, chapter 5). If there is no such solution up
to the end of the step, the parts become ever shorter.
"""

from __future__ import annotations

import numpy as np

from fvi_cli.integrator.damping.damping import Damping
from fvi_cli.integrator.engine.frame import Frame
from fvi_cli.integrator.engine.law import StepLaw
from fvi_cli.integrator.engine.operator import Operator
from fvi_cli.integrator.engine.state import State
from fvi_cli.integrator.engine.tables import largest
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.convergence import ITERATIONS, NOISE, SLOW, UNIT
from fvi_cli.mathematics.lagrange import lobatto_basis

LONGEST_PART, SHORTEST_PART = 0.25, 2.0**-10  # parts of theta from 0 to 1
CLOSE = 1e-6
"""Tolerance of the solution at the end of a part, relative to the unknowns."""


def follow(
    law: StepLaw, damping: Damping | None, frame: Frame, state: State, known: Array
) -> Array | None:
    """U of a step of one member, ``(1, s, e)``; None if the solution ends within the step.

    Known loads have the sign of the left side, ``(1, 1, s + 1, e)``.
    """
    s, points = frame.tables.degree, frame.tables.control_points[1:]
    unknowns = points[:, None] * law.velocity(state.x, state.p, state.t)[:, None]
    done, part = 0.0, LONGEST_PART
    while done < 1.0:
        end = min(1.0, done + part)
        guess = unknowns
        if done:
            # the same polynomial, on the longer step
            longer = lobatto_basis(s).values(end / done * points)[1:].T * (done / end)
            guess = np.matmul(longer, unknowns)
        found = _solve(law, damping, frame.shortened(end), state, end * known, guess)
        if found is None:
            part *= 0.5
            if part < SHORTEST_PART:
                return None
            continue
        unknowns, done, part = found, end, min(2.0 * part, LONGEST_PART)
    return unknowns


def _solve(
    law: StepLaw, damping: Damping | None, frame: Frame, state: State, known: Array, guess: Array
) -> Array | None:
    """Newton's iteration, with new derivatives each time; None if it does not contract."""
    times = state.t + frame.h * frame.tables.points
    noise = NOISE * UNIT * np.abs(state.x) / frame.h
    unknowns, before = guess, np.full(state.x.shape, np.inf)
    for _ in range(ITERATIONS):
        points = frame.points_of(unknowns[:, None]).reshape(1, times.size, -1)
        at, rest = law.expand(state.x, points, times)
        op = Operator(frame, at, damping, is_linear=False)
        found = op.solve(state, known) + op.respond(rest, 1)
        found = found.reshape(guess.shape)
        change = largest(np.abs(found - unknowns))
        if (change <= CLOSE * largest(np.abs(found)) + noise).all():
            return found
        if not (change <= SLOW * before).all():
            return None
        unknowns, before = found, change
    return None
