"""A lock on a result file that ends with the process, whatever ends it."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from fvi_cli.errors import StorageError
from fvi_cli.storage.atomic import told

_WITHOUT_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)


@contextlib.contextmanager
def file_lock(path: Path) -> Iterator[None]:
    """Hold a result file, which need not exist, for one process alone.

    The lock is the kernel's, on the file ``.<name>.lock`` beside it. That file stays: removing it
    would let two processes hold locks on two files of that name.

    Raises
    ------
    StorageError
        If another process holds it, or the folder cannot be made or written.
    """
    from filelock import FileLock, Timeout

    with told(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
    # a lock that is a mere file, as is done where there are no others, would outlive a death
    lock = FileLock(path.with_name(f".{path.name}.lock"), timeout=0, fallback_to_soft=False)
    try:
        lock.acquire()
    except Timeout:
        raise StorageError(
            f"{path}: another fvi is writing it; wait until it has ended, or choose another "
            "folder with --output"
        ) from None
    except OSError as error:
        if error.errno in _WITHOUT_LOCKS:
            raise StorageError(
                f"{lock.lock_file}: cannot be locked: {os.strerror(error.errno)}; on a file system "
                "without locks (some network folders) two commands could destroy each other's "
                "results: choose a folder on another one with --output"
            ) from None
        with told(path):
            raise
    try:
        yield
    finally:
        lock.release()
