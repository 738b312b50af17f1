"""A lock on a folder that ends with the process, whatever ends it."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from fvi_cli.errors import StorageError
from fvi_cli.storage.files import told

LOCK_NAME = ".lock"


@contextlib.contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the folder, which is made when it is missing, for one process alone.

    The lock is the kernel's (``flock``) on the file ``.lock`` in it. The file stays: removing it
    would let two processes hold locks on two files of that name.

    Raises
    ------
    StorageError
        If another process holds it, or the folder cannot be made or written.
    """
    with told(folder):
        folder.mkdir(parents=True, exist_ok=True)
    path = folder / LOCK_NAME
    with told(path):
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                raise StorageError(
                    f"{path}: cannot be locked: {os.strerror(error.errno or 0)}; on a file system "
                    "without locks (some network folders) two commands could destroy each "
                    "other's results: choose a folder on another one with --output"
                ) from None
            raise StorageError(
                f"{folder}: another fvi is writing there; wait until it has ended, or choose "
                "another folder with --output"
            ) from None
        yield
    finally:
        os.close(handle)
