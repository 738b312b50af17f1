"""Export of result files as CSV, for programs without HDF5."""

from __future__ import annotations

import contextlib
import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import RequestError
from fvi_cli.storage.atomic import replace_file
from fvi_cli.storage.digests import canonical_json, extract_inputs
from fvi_cli.storage.records.fields import TIME
from fvi_cli.storage.records.record import Entry, StoredRecord
from fvi_cli.storage.result_file import ResultFile

Designs = Mapping[str, Mapping[str, Any]]
"""Values by key path, by the name of the design."""


def export_file(path: Path | str, directory: Path | str) -> list[Path]:
    """Write a CSV file for every run of a result file, as ``fvi export`` does.

    Parameters
    ----------
    path
        Result file.
    directory
        Folder for ``<experiment>-<design or member>-<method>-n000016.csv``, with a column for the
        time, every coordinate (``x1``, its momentum ``p_x1``), the energy, and every quantity, to
        the last digit.

    Returns
    -------
    list of Path
        The files that were written.
    """
    path, directory = Path(path), Path(directory)
    written: list[Path] = []
    with contextlib.closing(ResultFile(path)) as file:
        resolved = json.loads(str(file.root["resolved_config"]))
        designs = {one["name"]: one.get("designs") or {} for one in resolved["experiments"]}
        members: dict[str, dict[str, int]] = {}
        for entry in file.entries:
            if entry.is_reference:
                continue
            record = entry.record()
            own = members.setdefault(entry.path.split("/")[1], {})
            target = directory / f"{_name(entry, record, designs, own)}.csv"
            if target in written:  # a run with other values of the same design
                target = target.with_stem(f"{target.stem}-{len(written)}")
            directory.mkdir(parents=True, exist_ok=True)
            replace_file(target, _csv(record).encode())
            written.append(target)
    if not written:
        raise RequestError(f"{path}: holds no runs")
    return written


def _name(
    entry: Entry, record: StoredRecord, designs: Mapping[str, Designs], numbers: dict[str, int]
) -> str:
    """The name of a file; members are numbered in their order where they have no name."""
    kind, experiment = entry.kind, entry.path.split("/")[1]
    member = ""
    if kind.swept:
        values = {key: record.attributes.get(key) for key in kind.swept}
        number = numbers.setdefault(canonical_json(values), len(numbers))
        member = f"-{_design(values, designs.get(kind.experiment, {})) or f'member-{number}'}"
    return f"{experiment}{member}-{kind.case}-n{kind.n_steps:06d}"


def _design(values: Mapping[str, Any], designs: Designs) -> str:
    """The design that sets most of a member's values and none that it does not have."""
    fitting = [
        (len(own), name)
        for name, own in designs.items()
        if all(values.get(key) == extract_inputs(value) for key, value in own.items())
    ]
    return max(fitting, default=(0, ""))[1]


def _csv(record: StoredRecord) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns = dict(_columns(record))
    writer.writerow(columns)
    writer.writerows(zip(*(map(repr, values.tolist()) for values in columns.values()), strict=True))
    return text.getvalue()


def _columns(record: StoredRecord) -> Iterator[tuple[str, NDArray[Any]]]:
    """The columns of a run: all that it has at its times."""
    coordinates = _coordinates(record)
    for name, values in record.arrays.items():
        axes = record.axes[name]
        if axes[0] != TIME:
            continue
        bare = name.rpartition("/")[2]
        if len(axes) == 1:
            yield bare, values
            continue
        labels = coordinates if axes[1] == "dof" else list(map(str, range(values.shape[1])))
        for label, column in zip(labels, np.moveaxis(values, 1, 0), strict=True):
            is_free = bare == "position" and label not in record.arrays
            yield label if is_free else f"{_SHORT.get(bare, bare)}_{label}", column


_SHORT = {"momentum": "p"}


def _coordinates(record: StoredRecord) -> Sequence[str]:
    """The stored names of the coordinates; without them ``x``, or ``x1``, ``x2``."""
    size = record.arrays["position"].shape[1]
    names = json.loads(str(record.attributes.get("coordinates", "[]")))
    if len(names) == size:
        return [str(name) for name in names]
    return ["x"] if size == 1 else [f"x{k}" for k in range(1, size + 1)]
