"""Gauss rules on panels, for forces that are singular at the beginning of a step."""

from __future__ import annotations

from functools import cache

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis
from fvi_cli.mathematics.quadrature import gauss_rule

GRADING_RATIO = 0.15  # of the ends of successive panels
GRADING_LEVELS = 200  # number of panels
FINE_POINTS = 24  # Gauss points of a panel


@cache
def tested_rule(degree: int, *, is_graded: bool) -> tuple[Array, Array]:
    """Points ``(r,)`` of a rule on [0, 1], and weights times the basis there, ``(s + 1, r)``.

    The panels of a graded rule shrink towards 0. Otherwise there is one panel, on which smooth
    forces are integrated to round-off. The first panel of a graded rule ends where t**0.1 is below
    1e-16, so that powers from t**-0.9 on are integrated to round-off.
    """
    ends = GRADING_RATIO ** np.arange(GRADING_LEVELS - 1, -1, -1.0) if is_graded else [1.0]
    points, weights = graded_rule(np.array([0.0, *ends]))
    tested = lobatto_basis(degree).values(points) * weights
    for one in (points, tested):
        one.setflags(write=False)
    return points, tested


def graded_rule(edges: Array) -> tuple[Array, Array]:
    """Points and weights of a Gauss rule on every panel, in the order of the panels."""
    fine = gauss_rule(FINE_POINTS)
    widths = np.diff(edges)
    points = (edges[:-1, None] + widths[:, None] * fine.nodes).ravel()
    return points, (widths[:, None] * fine.weights).ravel()
