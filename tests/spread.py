"""Tests over many combinations, of which the default suite takes as many as show every value."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import pytest


def spread(**values: Sequence[Any]) -> pytest.MarkDecorator:
    """Parametrize by all combinations of `values`; all but a diagonal of them are ``slow``.

    The diagonal has every value of every name at least once.
    """
    lists = [list(enumerate(one)) for one in values.values()]
    longest = max(map(len, lists))
    kept = {tuple(k % len(one) for one in lists) for k in range(longest)}
    entries = []
    for combination in itertools.product(*lists):
        marks = () if tuple(k for k, _ in combination) in kept else (pytest.mark.slow,)
        entries.append(pytest.param(*(value for _, value in combination), marks=marks))
    return pytest.mark.parametrize(tuple(values), entries)
