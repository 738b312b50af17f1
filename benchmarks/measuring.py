"""How times and memory are measured, and how the tables are written."""

from __future__ import annotations

import gc
import math
import multiprocessing
import os
import time
import tracemalloc
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import TypeVar
from unittest import mock

import numpy as np

Answer = TypeVar("Answer")
Action = Callable[[], object]

CHILD_ENVIRONMENT = {
    "MALLOC_MMAP_THRESHOLD_": "1073741824",
    "MALLOC_TRIM_THRESHOLD_": "4294967296",
    "MALLOC_TOP_PAD_": "268435456",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}
YARDSTICK_REPEATS = 9


@dataclass(frozen=True, kw_only=True)
class Figure:
    """What was measured, the figure to meet, and words on how."""

    name: str
    measured: float
    goal: float = math.inf
    how: str = ""

    @property
    def is_met(self) -> bool:
        """Whether it is not above its goal."""
        return self.measured <= self.goal


def figure_of(name: str, goal: float, ours: float, theirs: float) -> Figure:
    """The ratio of two times."""
    how = f"{ours:.3g} s over {theirs:.3g} s"
    return Figure(name=name, measured=ours / theirs, goal=goal, how=how)


def in_own_process(action: Callable[..., Answer], *arguments: object) -> Answer:
    """What `action` returns in a fresh process that keeps freed memory and has one core.

    The thresholds of its allocator are raised, so that a transform does not pay for fresh pages
    every other time.
    """
    fresh = multiprocessing.get_context("spawn")
    with (
        mock.patch.dict(os.environ, CHILD_ENVIRONMENT),
        ProcessPoolExecutor(max_workers=1, mp_context=fresh) as process,
    ):
        return process.submit(action, *arguments).result()


def processor_seconds(action: Action) -> float:
    """Processor seconds of one call."""
    gc.collect()
    began = time.process_time()
    action()
    return time.process_time() - began


def least_seconds(action: Action, repeats: int) -> float:
    """Least processor seconds of so many calls."""
    return min(processor_seconds(action) for _ in range(repeats))


def yardstick_seconds(length: int) -> float:
    """Least processor seconds of one ``scipy.fft.rfft`` of that length."""
    from scipy.fft import rfft

    values = np.random.default_rng(0).normal(size=length)
    return least_seconds(lambda: rfft(values), YARDSTICK_REPEATS)


def peak_doubles(action: Action, n_steps: int) -> float:
    """Traced peak memory of `action` in doubles per step."""
    gc.collect()
    tracemalloc.start()
    try:
        action()
        return tracemalloc.get_traced_memory()[1] / 8 / n_steps
    finally:
        tracemalloc.stop()


def number(value: float, form: str = ".3g") -> str:
    """The number, or a dash where there is none."""
    return format(value, form) if math.isfinite(value) else "-"


def table(remark: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A remark and a Markdown table below it."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join([remark, "", *(f"| {' | '.join(cells)} |" for cells in lines), ""])


def figures_table(remark: str, figures: Sequence[Figure]) -> str:
    """Figures beside their goals."""
    verdicts = ["yes" if one.is_met else "no" for one in figures]
    return table(
        remark,
        ("what", "measured", "at most", "met", "how"),
        [
            (one.name, number(one.measured), number(one.goal), verdict, one.how)
            for one, verdict in zip(figures, verdicts, strict=True)
        ],
    )
