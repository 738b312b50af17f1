"""Opening and replacing result files, with errors that say what to do."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py

from fvi_cli.errors import StorageError
from fvi_cli.storage.atomic import UNFINISHED, explain_os_error, followed, reason, replacement
from fvi_cli.storage.digests import FORMAT
from fvi_cli.storage.stream import SafeStream

CREATOR = "fvi-cli"

SUFFIX = ".h5"

CACHE_BYTES = 2**18

HDF5_ERRORS = (
    OSError,
    LookupError,
    TypeError,
    ValueError,
    RuntimeError,
    AttributeError,
    MemoryError,
    OverflowError,
)
"""Exceptions that h5py raises on damaged or foreign bytes."""

_WHAT_THEN = "it is left as it is: move it away, and its runs are computed again"


@contextlib.contextmanager
def open_stored(path: Path) -> Iterator[h5py.File]:
    """Open a result file for reading, after a check that this program wrote it.

    Later reads give the contents at the time of opening, even if the file is replaced meanwhile.
    """
    if not path.exists():
        hint = "" if path.suffix else f"; result files end in .h5, such as results/{path.name}.h5"
        raise StorageError(f"{path}: no such file{hint}")
    if not path.is_file():
        kind = "a folder" if path.is_dir() else "a device or pipe"
        raise StorageError(f"{path}: is {kind}, not a result file")
    if path.suffix in (".yaml", ".yml"):
        raise StorageError(
            f"{path}: is not a result file of fvi; `fvi check` and `fvi run` take configurations"
        )
    with contextlib.ExitStack() as stack:
        try:
            file = stack.enter_context(h5py.File(path, "r", locking=False))
            _limit_cache(file)
        except PermissionError as error:
            raise StorageError(f"{path}: cannot be read: {reason(error)}") from None
        except HDF5_ERRORS:
            raise StorageError(
                f"{path}: is not a result file of fvi (not HDF5, or damaged or cut off); it is "
                "left as it is: move it away, or choose another name or --output"
            ) from None
        with explain_damage(path):
            _refuse_strangers(file, path)
        yield file


def _limit_cache(file: h5py.File) -> None:
    """Limit to :data:`CACHE_BYTES` the texts and headers of an open file that h5py keeps.

    By default it keeps up to 32 MB of each, and one and a half times its size with every text.
    """
    config = file.id.get_mdc_config()
    config.set_initial_size = True
    config.initial_size = config.min_size = config.max_size = CACHE_BYTES
    config.incr_mode = config.flash_incr_mode = config.decr_mode = 0
    file.id.set_mdc_config(config)


def _refuse_strangers(file: h5py.File, path: Path) -> None:
    if file.attrs.get("creator") != CREATOR or "format" not in file.attrs:
        raise StorageError(
            f"{path}: was not written by fvi; it is left as it is: move it away, or choose another "
            "name or --output"
        )
    number = int(file.attrs["format"])
    if number > FORMAT:
        raise StorageError(
            f"{path}: has format {number}, this version of fvi reads {FORMAT}; update fvi, "
            "or move the file away"
        )
    if number < FORMAT:
        version = escape_text(str(file.attrs.get("fvi_version", "an older version")))
        raise StorageError(
            f"{path}: has format {number}, this version of fvi reads {FORMAT}; move the file away, "
            f"and its runs are computed again, or read it with the version that wrote it "
            f"({version}); every version's files are plain HDF5"
        )


def escape_text(text: str) -> str:
    """A text from a file, safe to print: characters that would control a terminal are escaped."""
    return "".join(
        c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text
    )


@contextlib.contextmanager
def explain_damage(path: Path) -> Iterator[None]:
    """Turn exceptions of h5py on a damaged file into an error that names the file."""
    try:
        yield
    except HDF5_ERRORS as error:
        found = escape_text(f"{type(error).__name__}: {error}")
        raise StorageError(
            f"{path}: is damaged or not a result file ({found}); {_WHAT_THEN}"
        ) from error


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[tuple[h5py.File, Callable[[], None]]]:
    """A new file under a temporary name; on success it is flushed to the disk and renamed.

    On any failure `path` stays as it was. Yields the file, and a function that raises the first
    error of the disk so far, which h5py itself never sees.
    """
    with explain_os_error(path), replacement(path) as handle:
        stream = SafeStream(handle)
        with h5py.File(stream, "w", track_order=True, libver=("v110", "v110")) as file:
            _limit_cache(file)
            yield file, stream.check
        stream.check()


def remove_unfinished(path: Path) -> None:
    """Remove half-written files of a crash; the lock ensures that no process is writing them."""
    place = followed(path)
    for leftover in place.parent.glob(f".{place.name}.*{UNFINISHED}"):
        with explain_os_error(leftover):
            leftover.unlink(missing_ok=True)
