"""Printed numbers, what they should be, and how they are judged."""

from __future__ import annotations

import contextlib
import io
import math
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from fvi_cli.errors import FviError

Random = np.random.Generator
Change = Callable[[float], float]
"""What is done to every printed number before it is judged: nothing, but in controls."""


class RefusedError(Exception):
    """The program says that it has no number, or that it is not to be trusted."""


class UnjudgedError(Exception):
    """The other route has no number that is good enough."""


@dataclass(frozen=True)
class Claim:
    """One printed number.

    Parameters
    ----------
    name
        Which one.
    printed, true
        By the program, and by a route that shares no code with it.
    allowed
        How far the two may be apart; infinite numbers have to be the same.
    """

    name: str
    printed: float
    true: float
    allowed: float

    def ratio(self, change: Change) -> float:
        """Difference over what is allowed; infinite where one number is none."""
        printed = change(self.printed)
        if not math.isfinite(printed) or not math.isfinite(self.true):
            return 0.0 if printed == self.true else math.inf
        difference = abs(printed - self.true)
        return difference / self.allowed if difference > 0 else 0.0


Claims = Iterator[Claim]
Kind = Callable[[Random, list[str]], Claims]
"""Draws a scene, appends words by which it can be repeated, and yields printed numbers."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One draw: ``right``, ``wrong``, ``refused`` (or said to be doubtful) or ``unjudged``."""

    kind: str
    verdict: str
    ratio: float
    numbers: int
    words: tuple[str, ...]


def judge(name: str, kind: Kind, random: Random, change: Change = float) -> Judged:
    """Draw one scene of a kind and judge its numbers."""
    words: list[str] = []
    claims: list[Claim] = []
    verdict = ""
    try:
        # what was printed before something is not known stays among the claims
        with contextlib.redirect_stderr(io.StringIO()):
            claims.extend(kind(random, words))
    except (RefusedError, FviError) as error:
        verdict = "refused"
        words.append(f"refused: {error}")
    except UnjudgedError as error:
        verdict = "" if claims else "unjudged"
        words.append(f"unjudged: {error}")
    except Exception:
        # any other error of a command is a wrong answer, and its place is wanted
        words.append(traceback.format_exc(limit=-4))
        return Judged(kind=name, verdict="wrong", ratio=math.inf, numbers=0, words=tuple(words))
    ratios = [claim.ratio(change) for claim in claims]
    for claim, ratio in zip(claims, ratios, strict=True):
        if ratio > 1:
            words.append(
                f"{claim.name}: printed {claim.printed!r}, true {claim.true!r}, "
                f"allowed difference {claim.allowed:.3g}"
            )
    worst = max(ratios, default=0.0)
    if worst > 1:
        verdict = "wrong"
    return Judged(
        kind=name,
        verdict=verdict or ("right" if claims else "unjudged"),
        ratio=worst,
        numbers=len(claims),
        words=tuple(words),
    )
