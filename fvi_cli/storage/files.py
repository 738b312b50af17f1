"""Files that appear whole or not at all, and the lock of one that is being folded."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from fvi_cli.errors import StorageError

UNFINISHED = ".tmp"
"""Ending of files that are being written; such a file that a crash leaves behind is useless."""


def replace_file(path: Path, content: bytes) -> None:
    """Write `content` to a new file in the folder of `path`, flush it to disk, and rename it."""
    with replacement(path) as temporary:
        temporary.write_bytes(content)


@contextlib.contextmanager
def replacement(path: Path) -> Iterator[Path]:
    """A new path in the folder of `path`, whose file replaces `path` when the block has ended.

    The folder is made where it is missing. On any failure `path` stays as it was, and the new file
    is removed. The new file has the mode of the old.

    Raises
    ------
    StorageError
        For an error of the operating system, with the path and the reason.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}{UNFINISHED}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        if path.exists():
            shutil.copymode(path, temporary)
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else str(error)
        raise StorageError(f"{path}: cannot be written: {reason}") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


@contextlib.contextmanager
def file_lock(path: Path) -> Iterator[None]:
    """Hold the lock on `path`, a file of its own that is removed at the end."""
    from filelock import FileLock

    with FileLock(path):
        try:
            yield
        finally:
            # filelock takes its lock anew where the file it opened has been removed
            with contextlib.suppress(OSError):
                path.unlink()
