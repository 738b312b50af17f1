"""The summary of a case over members and numbers of steps."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import h5py
import numpy as np

from fvi_cli.storage.batch_records import MEANINGS, MEMBER, Columns, write_column
from fvi_cli.storage.provenance import canonical_json
from fvi_cli.storage.records import SWEPT, attribute, stored_kind
from fvi_cli.studies.members import value_at

_CONVERGENCE: Mapping[str, tuple[Any, Any]] = {
    "error": (np.nan, float),
    "seconds": (np.nan, float),
    "history_operations": (0, np.int64),
    "status": ("missing", object),
}


def write_member_convergence(
    group: h5py.Group, ladders: Mapping[int, Columns], keys: Sequence[str]
) -> None:
    """The summary of a case: errors and what they took, by member and number of steps.

    Parameters
    ----------
    group
        Empty.
    ladders
        The attributes of all members by number of steps.
    keys
        The swept keys.
    """
    steps = sorted(ladders)
    places: dict[str, int] = {}
    values: list[list[Any]] = []
    for columns in ladders.values():
        for text in columns["specification"]:
            problem = json.loads(text)["problem"]
            own = [value_at(problem, key) for key in keys]
            if places.setdefault(canonical_json(own), len(places)) == len(values):
                values.append(own)
    first = ladders[steps[0]]
    group.attrs[SWEPT] = json.dumps(list(keys))
    group.attrs["norm"] = attribute(first["norm"][0])
    scales = {
        MEMBER: np.arange(len(values)),
        "n_steps": np.array(steps, dtype=np.int64),
    }
    for name, numbers in scales.items():
        dataset = group.create_dataset(name, data=numbers, dtype="<i8")
        dataset.attrs["long_name"] = MEANINGS[name]
        dataset.make_scale(name)
    for key, column in zip(keys, zip(*values, strict=True), strict=True):
        write_column(group, key, column)
    sizes = [float(ladders[n]["step_size"][0]) for n in steps]
    group.create_dataset("step_size", data=np.array(sizes)).dims[0].attach_scale(group["n_steps"])
    group["step_size"].attrs["long_name"] = MEANINGS["step_size"]
    tables = {
        name: np.full((len(values), len(steps)), empty, dtype=kind)
        for name, (empty, kind) in _CONVERGENCE.items()
    }
    for rung, n_steps in enumerate(steps):
        columns = ladders[n_steps]
        for row, text in enumerate(columns["specification"]):
            problem = json.loads(text)["problem"]
            place = places[canonical_json([value_at(problem, key) for key in keys])]
            for name, table in tables.items():
                source = "stepping_seconds" if name == "seconds" else name
                table[place, rung] = columns[source][row]
    for name, table in tables.items():
        is_text = table.dtype.kind == "O"
        dataset = group.create_dataset(
            name,
            data=table.tolist() if is_text else table,
            dtype=h5py.string_dtype() if is_text else stored_kind(table),
        )
        dataset.attrs["long_name"] = MEANINGS[name]
        dataset.attrs["coordinates"] = " ".join(keys)
        for axis, dimension in enumerate((MEMBER, "n_steps")):
            dataset.dims[axis].attach_scale(group[dimension])
    for key in keys:
        group[key].dims[0].attach_scale(group[MEMBER])
