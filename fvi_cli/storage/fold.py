"""One result file of several: where every run goes, and how the file is written."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import h5py
import numpy as np
from h5py import h5o

from fvi_cli.storage.files import explain_os_error, replacement
from fvi_cli.storage.groups import GroupRows, Piece, write_group
from fvi_cli.storage.hdf5 import (
    LIBVER,
    LINKS,
    NewGroup,
    children,
    copy_attributes,
    opened,
)
from fvi_cli.storage.identity import identity_of, reference_identity_of, variant_of
from fvi_cli.storage.parts import (
    CONFIGURATION,
    INPUTS,
    REFERENCES,
    SETTINGS,
    texts_in,
    write_input,
    write_root,
    write_texts,
)
from fvi_cli.storage.provenance import origin
from fvi_cli.storage.stream import SafeStream
from fvi_cli.studies.experiment import Run

INDEX: Final = "@index"
KEPT: Final = "@kept"
_OTHERS: Final = (CONFIGURATION, INDEX, INPUTS, SETTINGS)


def run_groups(file: h5py.File | h5py.Group) -> Iterator[h5py.Group]:
    """The groups of runs and references, also those of runs that are not requested."""
    for experiment, cases in children(file):
        if experiment == KEPT:
            for _, variant in children(cases):
                yield from run_groups(variant)
        elif experiment not in _OTHERS and isinstance(cases, h5py.Group):
            for _, case in children(cases):
                if isinstance(case, h5py.Group):
                    found = (one for _, one in children(case) if isinstance(one, h5py.Group))
                    yield from (one for one in found if "identity" in {*one, *one.attrs})


class Fold:
    """The contents of several files, the oldest first, as one new file."""

    def __init__(
        self, sources: Sequence[Path], requested: Sequence[Run] = (), *, prunes: bool = False
    ) -> None:
        self._sources = sources
        self._groups: list[GroupRows] = []
        for source in sources:
            with opened(source) as file:
                self._groups += [
                    GroupRows(group, source, is_whole=False) for group in run_groups(file)
                ]
        self._names = {identity_of(run): run.experiment.name for run in requested}
        self._order = {identity: number for number, identity in enumerate(self._names)}
        # runs have the path of their experiment if they are of this variant
        first = {run.experiment.name: run for run in reversed(requested)}
        self._variants = {name: variant_of(run)[0] for name, run in first.items()}
        self._prunes = prunes
        self._needed = {reference_identity_of(run) for run in requested} if prunes else set()

    def write(self, path: Path) -> int:
        """Replace a file by the folded one; returns the number of runs in ``/@kept/``."""
        layout = self._layout()
        with explain_os_error(path), replacement(path) as handle:
            stream = SafeStream(handle)
            with h5py.File(stream, "w", libver=LIBVER) as file:
                write_root(file, origin())
                for target, pieces in layout.items():
                    write_group(file, target, pieces)
                    stream.check()
                _write_index(file, layout)
                self._copy_others(file, layout)
            stream.check()
        return sum(
            last - first
            for target, pieces in layout.items()
            if target.startswith(f"/{KEPT}/")
            for _, first, last in pieces
        )

    def _layout(self) -> dict[str, list[Piece]]:
        """The pieces of every group of the new file, in their order."""
        latest: dict[str, tuple[int, int]] = {}
        variants: dict[str, str | None] = {}
        for number, rows in enumerate(self._groups):
            for row, identity in enumerate(rows.identities):
                latest[identity] = number, row
            if not self._variants and not rows.path.startswith(f"/{KEPT}/"):
                variants[rows.path.split("/")[1]] = rows.column("variant")[-1]
        variants |= self._variants
        found: dict[str, list[tuple[int, int, int]]] = defaultdict(list)
        for number, rows in enumerate(self._groups):
            places = rows.column("number") if rows.keys else [0]
            own = zip(rows.identities, rows.column("variant"), places, strict=True)
            for row, (identity, variant, place) in enumerate(own):
                if latest[identity] != (number, row):
                    continue
                target = self._target(rows.path, identity, variant, variants)
                if target is None:
                    continue
                while not rows.keys and target in found:
                    target += "-2"
                # requested runs in the order of the request, others behind them
                order = self._order.get(identity, len(self._order) + place)
                found[target].append((order, number, row))
        return {target: self._pieces(sorted(rows)) for target, rows in found.items()}

    def _target(
        self, path: str, identity: str, variant: str | None, variants: Mapping[str, str | None]
    ) -> str | None:
        """The path of a run in the new file; None: it is dropped."""
        # a group of runs that are not requested lies two levels deeper
        experiment, *tail = path.split("/")[-3:]
        if experiment == REFERENCES:
            return None if self._prunes and identity not in self._needed else path
        if self._prunes and identity not in self._order:
            return None
        experiment = self._names.get(identity, experiment)
        own = "/".join(("", experiment, *tail))
        return own if variants.get(experiment) == variant else f"/{KEPT}/{variant}{own}"

    def _pieces(self, places: Sequence[tuple[int, int, int]]) -> list[Piece]:
        """Rows that follow each other in one source."""
        found: list[list[int]] = []
        for _, number, row in places:
            if found and found[-1][0] == number and found[-1][2] == row:
                found[-1][2] = row + 1
            else:
                found.append([number, row, row + 1])
        return [(self._groups[number], first, last) for number, first, last in found]

    def _copy_others(self, file: h5py.File, layout: Mapping[str, Sequence[Piece]]) -> None:
        """Write what is no run: the latest configuration, settings, and what others have added."""
        variants = {
            one
            for pieces in layout.values()
            for rows, *_ in pieces
            for one in rows.column("variant")
        }
        ours = {*_OTHERS, KEPT, REFERENCES, *(rows.path.split("/")[1] for rows in self._groups)}
        for source in reversed(self._sources):
            with opened(source) as own:
                copy_attributes(own, file)
                if CONFIGURATION in own and CONFIGURATION not in file:
                    write_texts(file, f"/{CONFIGURATION}", texts_in(own[CONFIGURATION]))
                    for digest, group in children(own[INPUTS]) if INPUTS in own else ():
                        write_input(file, digest, group["numbers"][()])
                for variant, group in children(own[SETTINGS]) if SETTINGS in own else ():
                    if variant in variants and f"{SETTINGS}/{variant}" not in file:
                        write_texts(file, f"/{SETTINGS}/{variant}", texts_in(group))
                for name, node in children(own):
                    if name not in ours and name not in file:
                        h5o.copy(node.id, b".", file.id, name.encode(), lcpl=LINKS)


def _write_index(file: h5py.File, layout: Mapping[str, Sequence[Piece]]) -> None:
    """Write identity, group and row of all runs, so that a command need not open every group."""
    identities: list[str] = []
    numbers: list[int] = []
    rows: list[int] = []
    for number, pieces in enumerate(layout.values()):
        own = [one for group, first, last in pieces for one in group.identities[first:last]]
        identities += own
        numbers += [number] * len(own)
        rows += range(len(own))
    new = NewGroup(file, f"/{INDEX}")
    new.add("identity", ("run",), np.array(identities, dtype="S64"))
    new.add("group", ("run",), np.array(numbers, dtype="<i8"))
    new.add("row", ("run",), np.array(rows, dtype="<i8"))
    new.add("groups", ("path",), np.array([path.encode() for path in layout], dtype="S"))
    new.attach_scales()
