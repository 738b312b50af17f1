"""Where complete runs are stored."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py

from fvi_cli.storage.batch_reading import MemberReader, Row
from fvi_cli.storage.batch_records import is_batch, read_columns, values_in
from fvi_cli.storage.files import reading
from fvi_cli.storage.provenance import canonical_json
from fvi_cli.storage.records import (
    COMPLETE,
    SWEPT,
    Place,
    Record,
    basis,
    basis_in,
    group_path,
    place_in,
    read_record,
)

CONVERGENCE = "convergence"
"""Group of a case that holds no run."""


@dataclass(frozen=True, kw_only=True)
class Location:
    """Where a complete run is stored."""

    file: Path
    place: Place
    identity: str
    basis: str
    predicted: str
    row: int | None = None

    def read(self, reader: MemberReader) -> Record:
        """The run as it was written."""
        if self.row is not None:
            return reader.record(self.member_row)
        with reading(self.file) as file:
            return read_record(file[group_path(self.place)])

    @property
    def member_row(self) -> Row:
        """Where a member of a sweep is."""
        return self.file, group_path(self.place), self.row or 0


def located(path: Path, attributes: Mapping[str, Any]) -> Location:
    """Where the run with these attributes is."""
    return Location(
        file=path,
        place=place_in(attributes),
        identity=str(attributes["identity"]),
        basis=basis_in(attributes),
        predicted=str(attributes["predicted"]),
    )


def index(path: Path) -> list[Location]:
    """Every complete run of a file.

    Raises
    ------
    StorageError
        If it cannot be read or is not ours.
    """
    found = []
    with reading(path) as file:
        for _, _, group in run_groups(file):
            if COMPLETE in group.attrs:
                is_several = is_batch(group)
                found += _members(path, group) if is_several else [located(path, group.attrs)]
    return found


def _members(path: Path, group: h5py.Group) -> list[Location]:
    """Every member of a sweep in a group."""
    keys = tuple(json.loads(group.attrs[SWEPT]))
    own_basis = basis(json.loads(group.attrs["specification"]), keys)
    names = (str(group.attrs["experiment"]), str(group.attrs["case"]), int(group.attrs["n_steps"]))
    columns = read_columns(group, ("identity", "predicted"))
    return [
        Location(
            file=path,
            place=(*names, canonical_json(values)),
            identity=own_identity,
            basis=own_basis,
            predicted=predicted,
            row=row,
        )
        for row, (values, own_identity, predicted) in enumerate(
            zip(values_in(group), columns["identity"], columns["predicted"], strict=True)
        )
    ]


def run_groups(file: h5py.File) -> Iterator[tuple[str, str, h5py.Group]]:
    """Every run of a file with the names of its experiment and case."""
    for experiment, cases in file.items():
        for case, runs in cases.items():
            for name, group in runs.items():
                if name != CONVERGENCE:
                    yield experiment, case, group
