"""All runs of a configuration in one file, with where they come from."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.storage.batch_reading import MemberReader, Row
from fvi_cli.storage.batch_records import Columns, write_batch
from fvi_cli.storage.batch_summary import write_member_convergence
from fvi_cli.storage.files import NewFile
from fvi_cli.storage.locations import CONVERGENCE, Location
from fvi_cli.storage.provenance import (
    canonical_json,
    origin,
    package_versions,
    platform_name,
    sha256,
)
from fvi_cli.storage.records import (
    SWEPT,
    Place,
    Record,
    attribute,
    write_datasets,
    write_record,
)


class Configuration(Protocol):
    """What a file says of the configuration that made it."""

    @property
    def text(self) -> str:
        """Word for word."""

    @property
    def resolved(self) -> Mapping[str, Any]:
        """With every default filled in."""

    @property
    def overrides(self) -> tuple[str, ...]:
        """Changes that were asked for beside it."""


def described(configuration: Configuration) -> dict[str, str]:
    """What the root of a file says of the configuration."""
    resolved = canonical_json(configuration.resolved)
    return {
        "config": configuration.text,
        "config_overrides": json.dumps(list(configuration.overrides)),
        "resolved_config": resolved,
        "resolved_config_sha256": sha256(resolved),
    }


def write_root(file: h5py.File, configuration: Configuration) -> None:
    """Write where the file comes from."""
    attributes = {
        **described(configuration),
        **origin(),
        "packages": canonical_json(package_versions()),
        "hdf5_version": h5py.version.hdf5_version,
        "platform": platform_name(),
    }
    for name, value in attributes.items():
        file.attrs[name] = attribute(value)


def write_runs(new: NewFile, chosen: Mapping[Place, Location], reader: MemberReader) -> None:
    """Write all runs, one or a block in memory at a time, and the summary of every case."""
    rows: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    swept: dict[tuple[str, str, int], list[Row]] = {}
    for place, location in chosen.items():
        experiment, case, n_steps, _ = place
        if location.row is not None:
            swept.setdefault((experiment, case, n_steps), []).append(location.member_row)
            continue
        record = location.read(reader)
        # the same numbers may have been stored under another experiment's name
        named = {"experiment": experiment, "case": case, "n_steps": n_steps}
        record = Record(attributes={**record.attributes, **named}, datasets=record.datasets)
        write_record(new.file, record)
        new.check()
        rows.setdefault((experiment, case), []).append(record.attributes)
    for (experiment, case), attributes in rows.items():
        group = new.file.create_group(f"/{experiment}/{case}/{CONVERGENCE}", track_order=True)
        ordered = sorted(attributes, key=lambda row: int(row["n_steps"]))
        datasets = _convergence(ordered)
        write_datasets(group, datasets, dict.fromkeys(datasets, ("n_steps",)))
        group.attrs["norm"] = attribute(ordered[0]["norm"])
    _write_sweeps(new, swept, reader)


def _write_sweeps(
    new: NewFile, swept: Mapping[tuple[str, str, int], Sequence[Row]], reader: MemberReader
) -> None:
    ladders: dict[tuple[str, str], dict[int, Columns]] = {}
    for (experiment, case, n_steps), rows in swept.items():
        columns = reader.columns(rows)
        named = {"experiment": experiment, "case": case, "n_steps": n_steps}
        # another sweep may name the same keys in another order
        named[SWEPT] = columns[SWEPT][0]
        columns |= {name: [value] * len(rows) for name, value in named.items()}
        write_batch(new.file, columns, reader.blocks(rows))
        new.check()
        ladders.setdefault((experiment, case), {})[n_steps] = columns
    for (experiment, case), ladder in ladders.items():
        group = new.file.create_group(f"/{experiment}/{case}/{CONVERGENCE}", track_order=True)
        keys = json.loads(next(iter(ladder.values()))[SWEPT][0])
        write_member_convergence(group, ladder, keys)


def _convergence(rows: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[Any]]:
    return {
        "n_steps": np.array([row["n_steps"] for row in rows], dtype=np.int64),
        "step_size": np.array([row["step_size"] for row in rows], dtype=float),
        "error": np.array([row["error"] for row in rows], dtype=float),
        "seconds": np.array([row["stepping_seconds"] for row in rows], dtype=float),
        "history_operations": np.array([row["history_operations"] for row in rows], dtype=np.int64),
        "status": np.array([row["status"] for row in rows], dtype=object),
    }
