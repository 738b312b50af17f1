"""One result file, or part of one, as it was when it was opened; and where runs lie in it."""

from __future__ import annotations

import contextlib
import json
import sys
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py

from fvi_cli.storage.files import damage_told, open_stored
from fvi_cli.storage.groups import Columns, StoredGroup, run_groups
from fvi_cli.storage.provenance import canonical_json, identity
from fvi_cli.storage.records import (
    Form,
    Place,
    Record,
    form_of,
    group_path,
    place_of,
    variant_of,
)
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.members import with_values

VARIANT_MARK = "@"
"""Behind the name of an experiment in a group that holds runs of other values."""

BLOCK_BYTES = 2**25
"""Trajectories of members that are read at a time."""

BLOCKS_KEPT = 2

Key = tuple[Place, str, str, bool]
"""What is stored once: place, variant, method, and whether it is a refusal. A run that a later
version of the program computes, or that is computed afresh, has the key of the earlier one."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Location:
    """Where a complete run is stored, and which one it is.

    Parameters
    ----------
    file, group, row
        Result file or part, path of the group, number in it.
    key
        What is stored once.
    identity, predicted
        As stored.
    """

    file: Path
    group: str
    row: int
    key: Key
    identity: str
    predicted: str

    @property
    def place(self) -> Place:
        """Experiment, case, number of steps, swept values."""
        return self.key[0]

    @property
    def is_refusal(self) -> bool:
        """Whether it says only that the run was predicted to blow up."""
        return self.key[3]

    @property
    def is_of_configuration(self) -> bool:
        """Whether it lies where the runs lie that the file's configuration asks for."""
        return VARIANT_MARK not in self.group


class Index:
    """Complete runs, by what tells them apart.

    What is learned later stands in the place of what was learned earlier.
    """

    def __init__(self) -> None:
        self.by_key: dict[Key, Location] = {}
        self._waiting: list[Location] = []
        self._by_identity: dict[tuple[str, Form, bool], Location] = {}
        self._by_place: dict[Place, Location] = {}
        self._searched: dict[tuple[str, str], dict[Key, Location]] = {}
        self._forms: dict[Form, Form] = {}

    def learn(self, locations: Iterable[Location]) -> None:
        """Take in where runs are."""
        for location in locations:
            self.by_key[location.key] = location
            self._waiting.append(location)
            if '"accuracy"' in location.key[1]:
                name, _, _, values = location.place
                self._searched.setdefault((name, values), {})[location.key] = location

    def find(self, run: Run) -> Location | None:
        """Where the numbers of a run are, or its refusal; None if they are not there."""
        self._look_closer()
        # the same numbers may be there as a member of another sweep, in a group of another form
        named, form = identity(run), form_of(place_of(run))
        computed = self._by_identity.get((named, form, False))
        if run.experiment.allow_unstable:
            return computed
        if computed is not None and computed.predicted != "unstable":
            return computed
        return self._by_identity.get((named, form, True))

    def at_places(self) -> Mapping[Place, Location]:
        """The runs by where they belong."""
        self._look_closer()
        return self._by_place

    def identities(self) -> set[str]:
        """Of all runs, also of those that were replaced."""
        self._look_closer()
        return {named for named, _, _ in self._by_identity}

    def searched(self, search: Run) -> list[Location]:
        """Runs of an experiment with a tolerance, of the member that a search is about."""
        name, _, _, values = place_of(search)
        return list(self._searched.get((name, values), {}).values())

    def _look_closer(self) -> None:
        """Learn what to join files takes no memory for."""
        for location in self._waiting:
            form = form_of(location.place)
            # one for all that have it
            form = self._forms.setdefault(form, form)
            self._by_identity[location.identity, form, location.is_refusal] = location
            self._by_place[location.place] = location
        self._waiting.clear()


class Snapshot:
    """A result file, or a part, as it was when it was opened."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stack = contextlib.ExitStack()
        self.file: h5py.File = self._stack.enter_context(open_stored(path))
        self._groups: dict[str, StoredGroup] = {}
        self._blocks: OrderedDict[tuple[str, int], list[Record]] = OrderedDict()

    def close(self) -> None:
        """Let go of the file."""
        self._groups.clear()
        self._blocks.clear()
        self._stack.close()

    def locations(self) -> list[Location]:
        """Every complete run; those of other values than the configuration's come first."""
        with damage_told(self.path):
            found = [
                location
                for _, _, group in run_groups(self.file)
                if group.is_complete
                for location in self._in_group(group)
            ]
        return sorted(found, key=lambda location: location.is_of_configuration)

    def _in_group(self, group: StoredGroup) -> Iterator[Location]:
        path = str(group.group.name)
        self._groups[path] = group
        # a run that stands alone is verified when it is read
        a = group.said if not group.keys else group.attributes
        specification = json.loads(a["specification"])
        # one text for all runs that share it
        variant = sys.intern(variant_of(specification, group.keys))
        method = sys.intern(canonical_json(specification["method"]))
        names = (sys.intern(str(a["experiment"])), sys.intern(str(a["case"])), int(a["n_steps"]))
        values = map(canonical_json, group.values) if group.keys else iter([""])
        columns = ("identity", "predicted", "status")
        rows = [group.by_member[n] if group.keys else [str(a[n])] for n in columns]
        for row, (own, mine, predicted, status) in enumerate(zip(values, *rows, strict=True)):
            refused = _is_refusal(status, predicted, specification)
            key = ((*names, own), variant, method, refused)
            yield Location(
                file=self.path,
                group=path,
                row=row,
                key=key,
                identity=mine,
                predicted=sys.intern(predicted),
            )

    def record(self, location: Location) -> Record:
        """A run as it was written."""
        with damage_told(self.path):
            group = self._group(location.group)
            size = group.rows_at_a_time(BLOCK_BYTES)
            number, within = divmod(location.row, size)
            block = self._blocks.get((location.group, number))
            if block is None:
                start = number * size
                block = group.records(start, min(start + size, len(group)))
                self._blocks[location.group, number] = block
                while len(self._blocks) > BLOCKS_KEPT:
                    self._blocks.popitem(last=False)
            return block[within]

    def attributes(self, location: Location) -> dict[str, Any]:
        """What is said of a run."""
        with damage_told(self.path):
            group = self._group(location.group)
            found = {name: values[location.row] for name, values in group.columns.items()}
            values = {key: found.pop(key) for key in group.keys}
            if values:
                common = json.loads(found["specification"])
                own = with_values(common["problem"], values)
                found["specification"] = canonical_json({**common, "problem": own})
            return found

    def columns(self, group: str) -> Columns:
        """What is said of the runs of a group, by name."""
        with damage_told(self.path):
            return self._group(group).columns

    def _group(self, path: str) -> StoredGroup:
        if path not in self._groups:
            self._groups[path] = StoredGroup(self.file[path])
        return self._groups[path]


@dataclass(frozen=True, kw_only=True, eq=False)
class NewPart:
    """A part with runs that stand alone, which this process has just written and still has.

    Parameters
    ----------
    records
        Its runs, by the path of their group.
    """

    records: Mapping[str, Record]

    @property
    def size(self) -> int:
        """Bytes of the arrays."""
        return sum(one.nbytes for each in self.records.values() for one in each.datasets.values())

    def record(self, location: Location) -> Record:
        """As :meth:`Snapshot.record`."""
        return self.records[location.group]

    def attributes(self, location: Location) -> dict[str, Any]:
        """As :meth:`Snapshot.attributes`."""
        return dict(self.records[location.group].attributes)

    def columns(self, group: str) -> Columns:
        """As :meth:`Snapshot.columns`."""
        return {name: [value] for name, value in self.records[group].attributes.items()}


Source = Snapshot | NewPart


def _is_refusal(status: str, predicted: str, specification: Mapping[str, Any]) -> bool:
    allowed = specification["allow_unstable"]
    return status == "refused" and predicted == "unstable" and not allowed


def key_of(run: Run) -> tuple[Place, str, str]:
    """Place, variant and method of a run: what tells it from others in a file."""
    specification = json.loads(canonical_json(run.specification()))
    keys = () if run.member is None else tuple(run.member.values)
    variant, method = variant_of(specification, keys), canonical_json(specification["method"])
    return place_of(run), sys.intern(variant), sys.intern(method)


def location_of(path: Path, row: int, finished: FinishedRun, record: Record) -> Location:
    """Where a run has just been written."""
    run, own = finished.run, key_of(finished.run)
    refusal = _is_refusal(finished.status, finished.predicted, run.specification())
    return Location(
        file=path,
        group=sys.intern(group_path(own[0])),
        row=row,
        key=(*own, refusal),
        identity=str(record.attributes["identity"]),
        predicted=sys.intern(finished.predicted),
    )
