"""Files that appear whole or not at all, and are written by one process at a time."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path

from fvi_cli.errors import StorageError

UNFINISHED = ".part"
"""Ending of files that are being written; such a file that a crash leaves behind is useless."""


_WITHOUT_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)


def replace_file(path: Path, content: bytes) -> None:
    """Write `content` to a new file in the folder of `path`, flush it to disk, and rename it."""
    with replacement(path) as handle, os.fdopen(os.dup(handle), "wb") as stream:
        stream.write(content)


@contextlib.contextmanager
def replacement(path: Path) -> Iterator[int]:
    """Descriptor of a new file that replaces `path` when the block has ended.

    It is open for reading and writing. On any failure `path` stays as it was, and the new file is
    removed. Where `path` is a link, its target is replaced. A file that only its owner may read
    stays so.
    """
    try:
        with _replacement(followed(path)) as handle:
            yield handle
    except OSError as error:
        # for a full disk the system gives no name, for a folder the name of the unfinished file
        if error.errno and (not error.filename or str(error.filename).endswith(UNFINISHED)):
            error.filename = str(path)
        raise


def followed(path: Path) -> Path:
    """The target of a link, whether it exists or not; any other path unchanged."""
    return path.resolve() if path.is_symlink() else path


@contextlib.contextmanager
def _replacement(path: Path) -> Iterator[int]:
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}{UNFINISHED}")
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    handle = os.open(temporary, flags, 0o666)
    try:
        try:
            if path.exists():
                temporary.chmod(stat.S_IMODE(path.stat().st_mode))
            yield handle
            os.fsync(handle)
        finally:
            # some systems cannot rename an open file
            os.close(handle)
        temporary.replace(path)
        _flush_folder(path.parent)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _flush_folder(path: Path) -> None:
    """Make a renaming survive a loss of power, where the file system can."""
    if not hasattr(os, "O_DIRECTORY"):  # Windows opens no folders
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


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
    """Hold a result file, which need not exist, for one process alone.

    The lock is the kernel's, on the file ``.<name>.lock`` beside it. That file stays: removing it
    would let two processes hold locks on two files of that name.
    """
    from filelock import FileLock, Timeout

    with explain_os_error(path.parent):
        path.parent.mkdir(parents=True, exist_ok=True)
    # links to one file share its lock
    place = followed(path)
    # the fallback, a lock by the mere existence of a file, would outlive a killed process
    lock = FileLock(place.with_name(f".{place.name}.lock"), timeout=0, fallback_to_soft=False)
    try:
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
        with explain_os_error(path):
            raise
    try:
        yield
    finally:
        lock.release()
