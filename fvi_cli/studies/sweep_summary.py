"""What became of many members, in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable


def counts_in_words(values: Iterable[str]) -> str:
    """``ok: 998; diverged: 2``, or the one word that all have."""
    counts = Counter(values)
    if len(counts) == 1:
        return next(iter(counts))
    return "; ".join(f"{value}: {count}" for value, count in counts.most_common())
