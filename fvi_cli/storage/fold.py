"""A result file and its parts as one file: parts are appended to a copy of it."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import h5py

from fvi_cli.storage.files import replacement
from fvi_cli.storage.groups import GroupWriter, read_records, run_groups
from fvi_cli.storage.hdf5 import (
    LIBVER,
    children,
    opened,
    read_attributes,
    read_plain,
    write_attributes,
    write_plain,
    write_root,
)
from fvi_cli.storage.parts import CONFIGURATION, INPUTS, REFERENCES, SETTINGS, VARIANT
from fvi_cli.storage.provenance import origin

KEPT: Final = "@kept"
"""Group of experiments with settings that are not asked for, below the digest of these."""


def experiments_in(file: h5py.File | h5py.Group) -> Iterator[tuple[h5py.Group, str, str]]:
    """Group, name and digest of the settings of every experiment, first of those at the root."""
    for name, node in children(file):
        if VARIANT in node.attrs:
            yield node, name, str(read_attributes(node, VARIANT)[VARIANT])
    for _, kept in children(file[KEPT]) if KEPT in file else ():
        yield from experiments_in(kept)


def fold_files(
    path: Path,
    parts: Sequence[Path],
    is_kept: Callable[[str, Path], bool],
    variants: Mapping[str, str],
    *,
    prunes: bool,
) -> None:
    """Append parts to a result file.

    A run of a source is taken if it `is_kept`; an experiment is at the root if its settings are
    those in `variants`, or else the latest. If it `prunes`, the file is written anew, without what
    other programs have added to it.
    """
    own, is_copy = [path] * path.exists(), path.exists() and not prunes
    sources = own * prunes + sorted(parts)
    with replacement(path) as temporary:
        # HDF5 ends the process where it cannot write
        needed = sum(one.stat().st_size for one in (*own, *parts))
        if shutil.disk_usage(path.parent).free < needed:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if is_copy:
            shutil.copyfile(path, temporary)
        with h5py.File(temporary, "r+" if is_copy else "w", libver=LIBVER) as file:
            folded = _Folded(file, is_kept, {**_latest(sources), **variants})
            for source in sources:
                folded.append(source)
            folded.finish()


def _latest(sources: Sequence[Path]) -> dict[str, str]:
    """The settings of every experiment, of several the latest."""
    found: dict[str, str] = {}
    for source in sorted(sources, key=lambda one: one.stat().st_mtime_ns):
        with opened(source) as file:
            found |= {name: one for _, name, one in experiments_in(file)}
    return found


class _Folded:
    """A result file that is written."""

    def __init__(
        self, file: h5py.File, is_kept: Callable[[str, Path], bool], variants: Mapping[str, str]
    ) -> None:
        self._file, self._is_kept, self._variants = file, is_kept, variants
        self._writer = GroupWriter(file)
        known = [one for one in experiments_in(file) if one[1] in variants]
        # first what is not asked for, which makes room
        for group, name, variant in sorted(known, key=lambda one: variants[one[1]] == one[2]):
            if group.name != (place := self._place(name, variant)):
                file.move(group.name, place)

    def _place(self, experiment: str, variant: str) -> str:
        """The path of an experiment with some settings."""
        is_asked_for = self._variants.get(experiment, variant) == variant
        return f"/{experiment}" if is_asked_for else f"/{KEPT}/{variant}/{experiment}"

    def append(self, source: Path) -> None:
        """Add what this program has written into a source."""
        with opened(source) as own:
            for experiment, name, variant in experiments_in(own):
                place = self._place(name, variant)
                self._append_runs(source, experiment, place)
                if place in self._file:
                    write_attributes(self._file[place], {VARIANT: variant})
            if REFERENCES in own:
                self._append_runs(source, own[REFERENCES], f"/{REFERENCES}")
            for above in (CONFIGURATION, SETTINGS, INPUTS):
                for path, arrays in read_plain(own, above).items():
                    if above == CONFIGURATION or path not in self._file:
                        write_plain(self._file, path, arrays)

    def _append_runs(self, source: Path, above: h5py.Group, place: str) -> None:
        for group in run_groups(above):
            path = place + str(group.name).removeprefix(str(above.name))
            for block in read_records(group):
                kept = [one for one in block if self._is_kept(one.identity, source)]
                self._writer.write([replace(one, path=path) for one in kept])

    def finish(self) -> None:
        """Complete the groups, and write when and by what."""
        self._writer.attach_scales()
        write_root(self._file, origin())
