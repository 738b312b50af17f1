"""Tests over many combinations, of which the default suite takes as many as show every value."""

import itertools
from collections.abc import Sequence
from typing import Any

import pytest


def spread(**values: Sequence[Any]) -> pytest.MarkDecorator:
    """Parametrize by all combinations of `values`; all but a diagonal of them are ``slow``.

    The diagonal has every value of every name at least once. Names that belong together, such as
    ``**{"a, b": pairs}``, have tuples as values.
    """
    lists = [list(enumerate(one)) for one in values.values()]
    longest = max(map(len, lists))
    kept = {tuple(k % len(one) for one in lists) for k in range(longest)}
    together = [name.split(", ") for name in values]
    entries = []
    for combination in itertools.product(*lists):
        marks = () if tuple(k for k, _ in combination) in kept else (pytest.mark.slow,)
        flat: list[Any] = []
        for names, (_, value) in zip(together, combination, strict=True):
            flat += value if len(names) > 1 else [value]
        entries.append(pytest.param(*flat, marks=marks))
    return pytest.mark.parametrize([name for names in together for name in names], entries)
