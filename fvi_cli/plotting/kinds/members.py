"""Curves of the members of a sweep: with names, with colours, or their mean and range."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.plotting.looks import Look
from fvi_cli.plotting.panels import Curve
from fvi_cli.plotting.style import COLOURS
from fvi_cli.plotting.words import member_label, swept_keys_in_words, swept_label, swept_number
from fvi_cli.studies.experiment import Experiment, FinishedRun
from fvi_cli.studies.members import value_in_words

MOST_NAMED = 6
"""Up to so many members have names in the legend."""
MOST_LINES = 100
"""Up to so many members have a line."""
_MOST_PANELS = 4
_MEAN = Look(colour=COLOURS[0], width=1.6)
_MEMBER = Look(colour="#8fb8d4", width=0.4)

Line = tuple[FinishedRun, Array, Array]


def members_title(experiment: Experiment) -> str:
    """The keys in which members differ; with their count if not each has a name."""
    count, words = len(experiment.members), swept_keys_in_words(experiment)
    return words if count <= MOST_NAMED else f"{count} members: {words}"


def bar_of(experiment: Experiment, count: int) -> str:
    """The name of a colour bar where it distinguishes that many members; else empty."""
    is_number = all(swept_number(member) is not None for member in experiment.members)
    return members_title(experiment) if MOST_NAMED < count <= MOST_LINES and is_number else ""


def member_curves(experiment: Experiment, lines: Sequence[Line]) -> list[Curve]:
    """A curve for every member with its name or number; of many their mean and range."""
    if len(lines) <= MOST_NAMED:
        return [Curve(x=x, y=y, label=member_label(one.run.member)) for one, x, y in lines]
    if bar_of(experiment, len(lines)):
        return [Curve(x=x, y=y, by=_number(one)) for one, x, y in lines]
    x = max((x for _, x, _ in lines), key=np.size)
    values = np.array([np.interp(x, own, y, np.nan, np.nan) for _, own, y in lines])
    values = values[:, np.isfinite(values).any(axis=0)]
    thin = lines if len(lines) <= MOST_LINES else ()
    edges = [np.nanpercentile(values, share, axis=0) for share in (0.0, 100.0)]
    return [
        *(Curve(x=own, y=y, label="members", look=_MEMBER) for _, own, y in thin),
        Curve(
            x=x[: values.shape[1]],
            y=np.nanmean(values, axis=0),
            label="mean",
            look=_MEAN,
            bands=[("range", edges[0], edges[1])],
        ),
    ]


def _number(one: FinishedRun) -> float:
    number = swept_number(one.run.member)
    return math.nan if number is None else number


def split_members(
    experiment: Experiment, finished: Sequence[FinishedRun]
) -> dict[str, list[FinishedRun]]:
    """Many members by the values of the key that has fewest, where another one is swept too."""
    keys = {
        key: list(dict.fromkeys(value_in_words(one.values[key]) for one in experiment.members))
        for key in experiment.swept
    }
    few = [key for key, values in keys.items() if 1 < len(values) <= _MOST_PANELS]
    if len(keys) < 2 or len(experiment.members) <= MOST_NAMED or not few:
        return {"": list(finished)}
    key = min(few, key=lambda one: len(keys[one]))
    words, found = swept_label(experiment, key), dict[str, list[FinishedRun]]()
    for one in finished:
        if one.run.member is not None:
            title = f"{words} = {value_in_words(one.run.member.values[key])}"
            found.setdefault(title, []).append(one)
    return found
