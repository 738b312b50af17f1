"""Export of result files as CSV, for programs without HDF5."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import RequestError
from fvi_cli.storage.columns import Arrays, arrays_of_row
from fvi_cli.storage.fields import TIME, axes_of
from fvi_cli.storage.files import explain_os_error, replace_file
from fvi_cli.storage.fold import run_groups
from fvi_cli.storage.groups import GroupRows
from fvi_cli.storage.hdf5 import opened
from fvi_cli.storage.parts import REFERENCES
from fvi_cli.storage.store import Store

_SHORT = {"momentum": "p"}


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
    store, directory = Store(Path(path)), Path(directory)
    store.configuration()
    store.fold()
    written: list[Path] = []
    for source in store.sources():
        with opened(source) as file:
            groups = [GroupRows(group, source) for group in run_groups(file)]
        for rows in groups:
            if rows.path.split("/")[-3] == REFERENCES:
                continue
            for row, values in enumerate(rows.values()):
                arrays = arrays_of_row(rows, rows.arrays(row, row + 1), 0, values)
                target = directory / f"{_name(rows, values)}.csv"
                if target in written:  # a run with other settings
                    target = target.with_stem(f"{target.stem}-{len(written)}")
                with explain_os_error(target):
                    directory.mkdir(parents=True, exist_ok=True)
                    replace_file(target, _csv(values, arrays).encode())
                written.append(target)
    if not written:
        raise RequestError(f"{path}: holds no runs")
    return written


def _name(rows: GroupRows, values: Mapping[str, Any]) -> str:
    """The name of a file; members are numbered where they have no name."""
    experiment, case, steps = rows.path.split("/")[-3:]
    member = values.get("design") or (f"member-{values['number']}" if "number" in values else "")
    return "-".join(filter(None, (experiment, member, case, steps.partition("-")[0])))


def _csv(values: Mapping[str, Any], arrays: Arrays) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns = dict(_columns(values, arrays))
    writer.writerow(columns)
    writer.writerows(zip(*(map(repr, one.tolist()) for one in columns.values()), strict=True))
    return text.getvalue()


def _columns(values: Mapping[str, Any], arrays: Arrays) -> Iterator[tuple[str, NDArray[Any]]]:
    """The columns of a run: all that it has at its times."""
    size = arrays["position"].shape[1]
    names = json.loads(str(values.get("coordinates", "[]")))
    if len(names) != size:
        names = ["x"] if size == 1 else [f"x{k}" for k in range(1, size + 1)]
    for name, array in sorted(arrays.items(), key=lambda one: one[0] != TIME):
        if axes_of(name)[0] != TIME:
            continue
        bare = name.rpartition("/")[2]
        if array.ndim == 1:
            yield bare, array
            continue
        for label, column in zip(names, np.moveaxis(array, 1, 0), strict=True):
            is_free = bare == "position" and label not in arrays
            yield label if is_free else f"{_SHORT.get(bare, bare)}_{label}", column
