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
from typing import TypeVar
from unittest import mock

import numpy as np

Answer = TypeVar("Answer")

CHILD_ENVIRONMENT = {
    "MALLOC_MMAP_THRESHOLD_": "1073741824",
    "MALLOC_TRIM_THRESHOLD_": "4294967296",
    "MALLOC_TOP_PAD_": "268435456",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}
YARDSTICK_REPEATS = 9
QUICK_SECONDS = 0.05
"""What takes less is repeated as often as the yardstick."""


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


def least_seconds(action: Callable[[], object], repeats: int) -> float:
    """Least time of `repeats` calls, of more where they are quick."""
    least, count = math.inf, 0
    gc.collect()
    while count < repeats or (least < QUICK_SECONDS and count < YARDSTICK_REPEATS):
        began = time.perf_counter()
        action()
        least = min(least, time.perf_counter() - began)
        count += 1
        if least > QUICK_SECONDS:
            gc.collect()
    return least


def yardstick_seconds(n_steps: int) -> float:
    """Least time of one ``scipy.fft.rfft`` of length 2N."""
    from scipy.fft import rfft

    values = np.random.default_rng(0).normal(size=2 * n_steps)
    return least_seconds(lambda: rfft(values), YARDSTICK_REPEATS)


def peak_doubles(action: Callable[[], object], n_steps: int) -> float:
    """Traced peak memory of `action` in doubles per step."""
    gc.collect()
    tracemalloc.start()
    try:
        action()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return peak / 8 / n_steps


def number(value: float, form: str) -> str:
    """The number, or a dash where there is none."""
    return format(value, form) if math.isfinite(value) else "-"


def yes_or_no(holds: bool) -> str:
    """In a word."""
    return "yes" if holds else "no"


def table(remark: str, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A remark and a Markdown table below it."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join([remark, "", *(f"| {' | '.join(cells)} |" for cells in lines), ""])
