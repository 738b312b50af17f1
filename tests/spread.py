"""Tests over many combinations, of which the default suite takes as many as show every value."""

import itertools
import os
import random
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import pytest

SEED = "FVI_TEST_SEED"
"""The variable of the environment with the seed; ``conftest.py`` sets it to the day's."""


def spread(few: int | None = None, **values: Sequence[Any]) -> pytest.MarkDecorator:
    """Parametrize by all combinations of `values`; all but a diagonal of them are ``slow``.

    The diagonal has every value of every name at least once; which values meet is drawn by the
    seed of the day. Where each takes long, only so `few` of the diagonal are taken. Names that
    belong together, such as ``**{"a, b": pairs}``, have tuples as values.
    """
    lists = [list(enumerate(one)) for one in values.values()]
    chance = random.Random(f"{os.environ[SEED]} {' '.join(values)}")
    orders = [chance.sample(range(len(one)), len(one)) for one in lists]
    longest = max(map(len, lists))
    kept = {tuple(order[k % len(order)] for order in orders) for k in range(few or longest)}
    together = [name.split(", ") for name in values]
    entries = []
    for combination in itertools.product(*lists):
        marks = () if tuple(k for k, _ in combination) in kept else (pytest.mark.slow,)
        flat: list[Any] = []
        for names, (_, value) in zip(together, combination, strict=True):
            flat += value if len(names) > 1 else [value]
        entries.append(pytest.param(*flat, marks=marks))
    return pytest.mark.parametrize([name for names in together for name in names], entries)


def few_of(few: int, many: int, name: str = "seed") -> pytest.MarkDecorator:
    """Parametrize by the numbers below `many`; all but so `few`, drawn by the day, are ``slow``."""
    kept = random.Random(f"{os.environ[SEED]} {few} of {many}").sample(range(many), few)
    rest = {number: () if number in kept else (pytest.mark.slow,) for number in range(many)}
    return pytest.mark.parametrize(name, [pytest.param(n, marks=m) for n, m in rest.items()])


def draw_few(tests: Iterable[pytest.Item]) -> None:
    """Make all cases of a test ``slow`` but so many as its mark ``few`` says, drawn by the day."""
    families = defaultdict(list)
    for one in tests:
        if one.get_closest_marker("few") and not one.get_closest_marker("slow"):
            families[one.nodeid.partition("[")[0]].append(one)
    for name, cases in families.items():
        (few,) = cases[0].get_closest_marker("few").args
        chance = random.Random(f"{os.environ[SEED]} {name}")
        for one in chance.sample(cases, max(len(cases) - few, 0)):
            one.add_marker("slow")
