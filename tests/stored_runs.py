"""Finished runs in result files, and read back from them."""

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fvi_cli.storage import Store
from fvi_cli.storage.identity import identity_of
from fvi_cli.storage.parts import part_name, part_of
from fvi_cli.studies.experiment import FinishedRun, Run


def add(store: Store, finished: Sequence[FinishedRun]) -> None:
    """Store finished runs as one part."""
    runs = [one.run for one in finished]
    name = part_name(runs[0], map(identity_of, runs))
    store.add(name, part_of(runs, finished))
    store.look()


def stored(path: Path | None, finished: Sequence[FinishedRun]) -> Store:
    """A store with finished runs, folded if it has a file."""
    store = Store(path)
    add(store, finished)
    store.fold([one.run for one in finished])
    return store


def read_back(path: Path | None, finished: FinishedRun) -> FinishedRun:
    """A run after it was stored and read."""
    return stored(path, [finished]).read([finished.run])[finished.run]


def kept_in(path: Path, runs: Sequence[Run]) -> int:
    """How many of the runs a result file and its parts have."""
    return len(Store(path).read(runs))


def assert_same(one: Any, other: Any, without: Sequence[str] = ("run", "failure", "steps")) -> None:
    """Every field of two values, bit by bit."""
    if is_dataclass(one):
        for field in fields(one):
            if field.name not in without:
                assert_same(getattr(one, field.name), getattr(other, field.name), without)
    elif isinstance(one, dict):
        assert list(one) == list(other)
        for key in one:
            assert_same(one[key], other[key], without)
    elif isinstance(one, np.ndarray):
        assert (one.shape, one.tobytes()) == (other.shape, other.tobytes())
    else:
        assert type(one) is type(other)
        assert one == other or (one != one and other != other)
