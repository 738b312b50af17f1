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

    On any failure `path` stays as it was, and the new file is removed. Where `path` is a link, its
    target is replaced. The new file has the mode of the old.
    """
    # a link may lead to a file that does not exist
    target = path.resolve() if path.is_symlink() else path
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(4)}{UNFINISHED}")
    try:
        yield temporary
        if target.exists():
            shutil.copymode(target, temporary)
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.replace(target)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        # for a full disk the system gives no name, for a folder that of the unfinished file
        if isinstance(error, OSError) and str(error.filename or UNFINISHED).endswith(UNFINISHED):
            error.filename = str(path)
        raise


@contextlib.contextmanager
def explain_os_error(path: Path) -> Iterator[None]:
    """Turn an error of the operating system into one that names `path` and the reason."""
    try:
        yield
    except OSError as error:
        raise StorageError(f"{path}: cannot be written: {reason(error)}") from error


def reason(error: OSError) -> str:
    """The reason that the operating system gives, without additions of libraries."""
    return os.strerror(error.errno) if error.errno else str(error)


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
