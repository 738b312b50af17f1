"""Export of result files as CSV, for programs without HDF5."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import RequestError
from fvi_cli.storage.fields import TIME, axes_of
from fvi_cli.storage.files import replace_file
from fvi_cli.storage.fold import experiments_in
from fvi_cli.storage.groups import DESIGN, NUMBER, Record, read_records, run_groups
from fvi_cli.storage.hdf5 import Source, opened
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
    store, directory = Store.existing(Path(path)), Path(directory)
    written: list[Path] = []
    for source in store.sources():
        for one in _runs_in(source):
            target = directory / f"{_name(one)}.csv"
            if target in written:  # a run with other settings
                target = target.with_stem(f"{target.stem}-{len(written)}")
            replace_file(target, _csv(one).encode())
            written.append(target)
    if not written:
        raise RequestError(f"{path}: holds no runs")
    return written


def _runs_in(source: Source) -> Iterator[Record]:
    with opened(source) as file:
        for experiment, _, _ in experiments_in(file):
            for group in run_groups(experiment):
                yield from chain.from_iterable(read_records(group))


def _name(one: Record) -> str:
    """The name of a file; members are numbered where they have no name."""
    experiment, case, steps = one.path.split("/")[-3:]
    number = one.values.get(NUMBER)
    member = one.values.get(DESIGN) or ("" if number is None else f"member-{number}")
    return "-".join(filter(None, (experiment, member, case, steps.partition("-")[0])))


def _csv(one: Record) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns = dict(_columns(one))
    writer.writerow(columns)
    writer.writerows(zip(*(map(repr, column.tolist()) for column in columns.values()), strict=True))
    return text.getvalue()


def _columns(one: Record) -> Iterator[tuple[str, NDArray[Any]]]:
    """The columns of a run: all that it has at its times."""
    arrays = one.arrays
    size = arrays["position"].shape[1]
    names = one.values.get("coordinates", ())
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
