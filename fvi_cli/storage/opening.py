"""Result files are opened: for reading alone, or by the one process that writes."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

from fvi_cli.storage.atomic import file_lock
from fvi_cli.storage.files import SUFFIX, remove_unfinished
from fvi_cli.storage.store import Store


@contextlib.contextmanager
def open_results(
    directory: Path, name: str, *, fresh: bool = False, waits: bool = False
) -> Iterator[Store]:
    """Open ``<name>.h5`` in `directory` for reading and for new runs.

    The file is held by a lock of the kernel until the block ends.

    Parameters
    ----------
    directory
        Folder of results; it is made when it is missing.
    name
        Of the configuration.
    fresh
        Find nothing that is stored; it is replaced by what is computed again, run by run.
    waits
        Where another process holds the file, wait until that has ended.

    Raises
    ------
    StorageError
        If another process writes it, the folder cannot be used, or a file of that name cannot
        be read or is not ours.
    """
    path = directory / f"{name}{SUFFIX}"
    with file_lock(path, waits=waits):
        remove_unfinished(path)
        with contextlib.closing(Store(path=path, is_fresh=fresh)) as store:
            store.look()
            yield store


@contextlib.contextmanager
def read_results(
    path: Path, *, fresh: bool = False, may_be_missing: bool = False
) -> Iterator[Store]:
    """Look up runs of a result file, and of parts that wait beside it; nothing is written.

    Parameters
    ----------
    path
        The file.
    fresh
        Find nothing that is stored.
    may_be_missing
        Take a file that is not there for one without runs.

    Raises
    ------
    StorageError
        If neither is there, or one cannot be read.
    """
    with contextlib.closing(Store(path=path, is_fresh=fresh)) as store:
        store.look()
        if not may_be_missing:
            store.require()
        yield store
