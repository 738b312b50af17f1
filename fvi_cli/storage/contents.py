"""The contents of a result file, for people and for other commands."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from fvi_cli.storage.columns import Rows
from fvi_cli.storage.fields import field_named
from fvi_cli.storage.fold import KEPT, run_groups
from fvi_cli.storage.groups import GroupRows
from fvi_cli.storage.hdf5 import opened, read_attributes
from fvi_cli.storage.identity import INPUT
from fvi_cli.storage.parts import REFERENCES, SETTINGS, texts_in
from fvi_cli.storage.store import Store, StoredConfiguration
from fvi_cli.studies.members import counts_in_words, swept_in_words, value_in_words

_CONFIG_KEYS: Final = {"norm": "report.norm", "store_every": "store.every"}
_ABSENT: Final = object()


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
    store = Store(Path(path))
    store.configuration()
    store.fold()
    own: dict[str, dict[str, Any]] = {}
    found: list[tuple[str, bool, Rows, dict[str, Any]]] = []
    provenance: dict[str, Any] = {}
    for source in store.sources():
        with opened(source) as file:
            provenance |= read_attributes(file.id)
            for group in run_groups(file):
                *above, experiment, _, _ = str(group.name).split("/")
                if experiment == REFERENCES:
                    continue
                rows = GroupRows(group, source)
                (variant, *_) = rows.column("variant")
                settings = json.loads(texts_in(file[SETTINGS][variant])["settings"])
                if KEPT not in above:
                    own.setdefault(experiment, settings)
                found.append((experiment, KEPT in above, rows, settings))
    runs = [
        _stored_run(name, rows, difference_in_words(own.get(name, {}), settings) if kept else "")
        for name, kept, rows, settings in sorted(found, key=lambda one: one[1])
    ]
    return StoredFile(provenance=provenance, runs=tuple(runs))


def _stored_run(experiment: str, rows: Rows, variant: str) -> StoredRun:
    values = {name: one for name, one in rows.common.items() if field_named(name) is not None}
    if not rows.keys:
        return StoredRun(experiment=experiment, values=values, variant=variant)
    errors = np.array(rows.column("error"), dtype=float)
    values["error"] = float(np.nanmax(errors)) if np.isfinite(errors).any() else float("nan")
    for name in ("status", "predicted"):
        values[name] = counts_in_words(rows.column(name))
    return StoredRun(
        experiment=experiment,
        values=values,
        members=rows.count,
        swept="; ".join(swept_in_words(key, rows.column(key)) for key in rows.keys),
        variant=variant,
    )


def difference_in_words(base: Mapping[str, Any], own: Mapping[str, Any]) -> str:
    """``problem.stiffness = 2, store.every = 4``: settings of `own` that `base` does not have."""
    before, after = dict(_leaves(base)), dict(_leaves(own))
    texts = [
        f"{key} = {value_in_words(value)}"
        for key, value in after.items()
        if before.get(key, _ABSENT) != value
    ]
    return ", ".join([*texts, *(f"no {key}" for key in before if key not in after)])


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping) and value:
        for key, inner in value.items():
            yield from _leaves(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list) and value:
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{path}.{index}")
    else:
        yield _CONFIG_KEYS.get(path, path).removesuffix(f".{INPUT}"), value
