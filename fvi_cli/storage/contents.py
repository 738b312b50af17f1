"""The contents of a result file, for people and for other commands."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

from fvi_cli.storage.fields import field_named
from fvi_cli.storage.fold import experiments_in
from fvi_cli.storage.groups import OF_GROUP, read_records, run_groups
from fvi_cli.storage.hdf5 import opened, read_attributes, read_plain
from fvi_cli.storage.parts import SETTINGS
from fvi_cli.storage.store import Store, StoredConfiguration
from fvi_cli.studies.members import counts_in_words, swept_in_words, value_in_words

MOST_WORDS: Final = 12
"""Most settings that are said to differ."""
COUNTED: Final = ("status", "predicted")
"""Values of members that are counted in a line for all."""


@dataclass(frozen=True, kw_only=True)
class StoredRun:
    """One run of a file, or all members of a sweep, in a line."""

    experiment: str
    # values by the names of the table of fields; of members the largest error, how many have which
    # status, and what they share
    values: Mapping[str, Any]
    members: int = 0  # number of members; 0: a single run
    swept: str = ""  # the swept keys and values, in words
    variant: str = ""  # settings that differ from those of the file's configuration, in words


@dataclass(frozen=True, kw_only=True)
class StoredFile:
    """The runs of a file in one line each, and its provenance."""

    provenance: Mapping[str, Any]  # attributes of the root
    runs: tuple[StoredRun, ...]


def read_configuration(path: Path | str) -> StoredConfiguration:
    """The configuration that made a result file."""
    return Store(Path(path)).configuration()


def list_runs(path: Path | str) -> StoredFile:
    """The runs and the provenance of a result file, without their motions."""
    store = Store.existing(Path(path))
    settings: dict[str, Any] = {}
    runs: list[StoredRun] = []
    provenance: dict[str, Any] = {}
    for source in store.sources():
        with opened(source) as file:
            provenance |= read_attributes(file)
            texts = read_plain(file, SETTINGS)
            # those that are asked for stand first
            for experiment, name, variant in experiments_in(file):
                own = json.loads(texts[f"{SETTINGS}/{variant}"]["settings"])
                words = difference_in_words(settings.setdefault(name, own), own)
                runs += [_stored_run(name, group, words) for group in run_groups(experiment)]
    runs.sort(key=lambda one: bool(one.variant))
    return StoredFile(provenance=provenance, runs=tuple(runs))


def _stored_run(experiment: str, group: h5py.Group, variant: str) -> StoredRun:
    records = list(chain.from_iterable(read_records(group, motions=False)))
    keys, first = records[0].keys, records[0].values
    if not keys:
        values = {name: one for name, one in first.items() if field_named(name) is not None}
        return StoredRun(experiment=experiment, values=values, variant=variant)
    columns: dict[str, list[Any]] = {
        name: [one.values.get(name) for one in records] for name in ("error", *COUNTED, *keys)
    }
    errors = np.array(columns["error"], dtype=float)
    values = {name: first[name] for name in OF_GROUP if name in first} | {"norm": first["norm"]}
    values["error"] = float(np.nanmax(errors)) if np.isfinite(errors).any() else float("nan")
    values |= {name: counts_in_words(columns[name]) for name in COUNTED}
    return StoredRun(
        experiment=experiment,
        values=values,
        members=len(records),
        swept="; ".join(swept_in_words(key, columns[key]) for key in keys),
        variant=variant,
    )


def difference_in_words(base: Mapping[str, Any], own: Mapping[str, Any]) -> str:
    """``problem.stiffness = 2, store.every = 4``: settings of `own` that `base` does not have."""
    before, after = dict(_leaves(base)), dict(_leaves(own))
    changed = (one for one in after.items() if one not in before.items())
    texts = [f"{key} = {value_in_words(value)}" for key, value in changed]
    texts += [f"no {key}" for key in before if key not in after]
    more = f"and {len(texts) - MOST_WORDS} more"
    return ", ".join(texts[:MOST_WORDS] + [more] * (len(texts) > MOST_WORDS))


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping) and value:
        for key, inner in value.items():
            yield from _leaves(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and value:
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{path}.{index}")
    else:
        yield path, value
