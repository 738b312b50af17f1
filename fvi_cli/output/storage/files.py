"""Opening and replacing result files, with errors that say what to do."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import h5py

from fvi_cli.errors import StorageError
from fvi_cli.output.provenance import FORMAT

CREATOR = "fvi-cli"

UNFINISHED = ".part"
"""Ending of files that are being written; what is left of them after a crash is of no use."""


@contextlib.contextmanager
def reading(path: Path) -> Iterator[h5py.File]:
    """Open a result file that may be there only as a whole.

    Raises
    ------
    StorageError
        If it cannot be read, is damaged, was not written by this program, or has a newer format.
    """
    file = open_stored(path)
    try:
        with damage_told(path):
            yield file
    finally:
        file.close()


def open_stored(path: Path) -> h5py.File:
    """Open a result file for reading after a look at who wrote it.

    Raises
    ------
    StorageError
        As :func:`reading`.
    """
    if not path.exists():
        raise StorageError(f"{path}: no such file")
    if path.is_dir():
        raise StorageError(f"{path}: is a folder, not a result file")
    try:
        # no lock of HDF5: files are replaced as a whole, never changed
        file = h5py.File(path, "r", locking=False)
    except PermissionError as error:
        raise StorageError(f"{path}: cannot be read: {reason(error)}") from None
    except (OSError, RuntimeError, ValueError):
        raise StorageError(
            f"{path}: is not HDF5, or is damaged or cut off; nothing is read from it and nothing "
            "written over it: delete it or move it away, and its runs are computed again"
        ) from None
    try:
        with damage_told(path):
            _refuse_strangers(file, path)
    except BaseException:
        file.close()
        raise
    return file


def _refuse_strangers(file: h5py.File, path: Path) -> None:
    if file.attrs.get("creator") != CREATOR or "format" not in file.attrs:
        raise StorageError(
            f"{path}: was not written by fvi; it is left as it is: move it away, or choose another "
            "name or --output"
        )
    number = int(file.attrs["format"])
    if number > FORMAT:
        raise StorageError(
            f"{path}: has format {number}, this version of fvi reads up to {FORMAT}; update fvi, "
            "or move the file away"
        )


@contextlib.contextmanager
def damage_told(path: Path) -> Iterator[None]:
    """Turn what the library raises on a damaged file into an error that names it."""
    try:
        yield
    except (OSError, KeyError, TypeError, ValueError, RuntimeError, AttributeError) as error:
        raise StorageError(
            f"{path}: is damaged or not a result file ({type(error).__name__}: {error}); delete it "
            "or move it away, and its runs are computed again"
        ) from error


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[h5py.File]:
    """A new file under a temporary name; on success it is flushed to the disk and renamed.

    On any failure `path` stays as it was.

    Raises
    ------
    StorageError
        If it cannot be written, with the reason of the operating system.
    """
    temporary: Path | None = None
    try:
        with told(path):
            handle, name = tempfile.mkstemp(
                dir=path.parent, prefix=f".{path.name}.", suffix=UNFINISHED
            )
            os.close(handle)
            temporary = Path(name)
            with h5py.File(temporary, "w", track_order=True, locking=False) as file:
                file.attrs["creator"] = CREATOR
                file.attrs["format"] = FORMAT
                yield file
            _flush(temporary)
            mask = os.umask(0)
            os.umask(mask)
            temporary.chmod(0o666 & ~mask)
            temporary.replace(path)
            temporary = None
            _flush(path.parent)
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # some file systems cannot flush a folder
        if not path.is_dir() or error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


@contextlib.contextmanager
def told(path: Path) -> Iterator[None]:
    """Turn an error of the operating system into one that names `path` and the reason."""
    try:
        yield
    except OSError as error:
        raise StorageError(f"{path}: cannot be written: {reason(error)}") from error


def reason(error: OSError) -> str:
    """The reason of the operating system, without what the library adds."""
    return os.strerror(error.errno) if error.errno else str(error)
