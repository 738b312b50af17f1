"""Opening and replacing result files, with errors that say what to do."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import h5py

from fvi_cli.errors import StorageError
from fvi_cli.storage.atomic import reason, replacement, told
from fvi_cli.storage.provenance import FORMAT
from fvi_cli.storage.seal import append_seal, is_broken
from fvi_cli.storage.stream import SafeStream

CREATOR = "fvi-cli"


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
        hint = "" if path.suffix else f"; result files end in .h5, such as results/{path.name}.h5"
        raise StorageError(f"{path}: no such file{hint}")
    if path.is_dir():
        raise StorageError(f"{path}: is a folder, not a result file")
    if path.suffix in (".yaml", ".yml"):
        raise StorageError(
            f"{path}: is not a result file of fvi; `fvi check` and `fvi run` take configurations"
        )
    try:
        if is_broken(path):
            raise StorageError(
                f"{path}: is damaged: its bytes are not those that were written; it is left as it "
                "is: move it away, and its runs are computed again"
            )
        # no lock of HDF5: files are replaced as a whole, never changed
        file = h5py.File(path, "r", locking=False)
    except PermissionError as error:
        raise StorageError(f"{path}: cannot be read: {reason(error)}") from None
    except (OSError, RuntimeError, ValueError):
        raise StorageError(
            f"{path}: is not a result file of fvi (not HDF5, or damaged or cut off); it is "
            "left as it is: move it away, or choose another name or --output"
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
            f"{path}: is damaged or not a result file ({type(error).__name__}: {error}); it "
            "is left as it is: move it away, and its runs are computed again"
        ) from error


@dataclass(frozen=True, kw_only=True, eq=False)
class NewFile:
    """A file that is being written.

    Parameters
    ----------
    file
        What the library knows of it.
    check
        Raises what has gone wrong on the disk so far; the library does not learn of it.
    """

    file: h5py.File
    check: Callable[[], None]


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[NewFile]:
    """A new file under a temporary name; on success it is flushed to the disk and renamed.

    On any failure `path` stays as it was.

    Raises
    ------
    StorageError
        If it cannot be written, with the reason of the operating system.
    """
    with told(path), replacement(path) as handle:
        stream = SafeStream(handle)
        with h5py.File(stream, "w", track_order=True) as file:
            file.attrs["creator"] = CREATOR
            file.attrs["format"] = FORMAT
            yield NewFile(file=file, check=stream.check)
        stream.check()
        append_seal(handle)
