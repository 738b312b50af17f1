"""Trials of formulas of t: forces are finite and integrable, known functions finite."""

from __future__ import annotations

import functools
import math
from typing import Final

import numpy as np

from fvi_cli.mathematics.expressions import Expression

PRIME_PARTS: Final = 97
"""Parts of an interval at whose ends a formula must be finite; a prime number, so that no usual
grid has points there."""
PARTS: Final = 720
"""Parts, 6!, at whose ends lie points of most grids: a quotient such as sin(t - 1)/(t - 1), without
value at one of them, is a force; an infinite one is not."""
STEEPEST: Final = -0.999
"""A force that begins with a power below this one has an infinite integral."""


@functools.lru_cache(maxsize=1024)
def objection(text: str, begin: float, end: float, *, is_force: bool) -> str:
    """What is wrong with an expression in t on an interval; empty if nothing is.

    A force must be finite inside and integrable at its beginning; a known solution or function
    must be finite at both ends too.
    """
    prime, parts = (np.arange(n + 1) / n for n in (PRIME_PARTS, PARTS))
    inner = np.concatenate([prime[1:-1], parts[1:]]) if is_force else prime
    times = begin + (end - begin) * inner
    expression = Expression.parse(text, variables=("t",))
    values = np.broadcast_to(np.asarray(expression.evaluate({"t": times})), times.shape)
    may_be_undefined = is_force & (np.arange(times.size) >= prime.size - 2)
    wrong = np.flatnonzero(np.isinf(values) | (np.isnan(values) & ~may_be_undefined))
    if wrong.size:
        what = "not a real number" if math.isnan(values[wrong[0]]) else "infinite"
        return f"is {what} at t = {times[wrong[0]]:.6g}; it must be finite up to final_time"
    if not is_force or np.isfinite(expression.evaluate({"t": np.array([begin])})).all():
        return ""
    steps = (end - begin) * np.array([1e-9, 2e-9, 4e-9, 8e-9])
    with np.errstate(all="ignore"):
        sizes = np.abs(np.broadcast_to(expression.evaluate({"t": begin + steps}), 4))
        power = float(np.log2(sizes[1:] / sizes[:-1]).max())
    if not power < STEEPEST:
        return ""
    behind = "t" if begin == 0 else f"(t - {begin:g})"
    return (
        f"grows like {behind}**{power:.3g} behind t = {begin:g}, so that its integral is "
        "infinite; powers above -1 are allowed"
    )
