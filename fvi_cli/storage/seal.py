"""The seal behind the last byte that HDF5 knows of: a checksum of all before it.

The library may search for ever, or end the process, in a file whose bytes have changed. So they are
looked at before it is. Other readers do not see the seal, and a program that changes a file by the
library cuts it off; a file without one is read as it is.
"""

from __future__ import annotations

import functools
import hashlib
import os
from pathlib import Path
from typing import BinaryIO

MARK = b"fvi-cli sha256 seal:"
LENGTH = len(MARK) + hashlib.sha256().digest_size
_ENOUGH = len(b"fvi-cli ")


def append_seal(handle: int) -> None:
    """Seal a file that is open for reading and writing, and written to its end."""
    with os.fdopen(os.dup(handle), "r+b", buffering=0) as file:
        file.seek(0)
        digest = hashlib.file_digest(file, "sha256").digest()
        remaining = memoryview(MARK + digest)
        file.seek(0, os.SEEK_END)
        while remaining:
            remaining = remaining[file.write(remaining) :]


def is_broken(path: Path) -> bool:
    """Whether the bytes before the seal are not those that were sealed, or it is cut off in part.

    False where there is no seal.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    status = path.stat()
    return _is_broken(path, status.st_ino, status.st_size, status.st_mtime_ns)


@functools.lru_cache(maxsize=1024)
def _is_broken(path: Path, node: int, size: int, changed: int) -> bool:
    """As :func:`is_broken`; files are replaced as a whole, so that one look at each will do."""
    with path.open("rb") as file:
        file.seek(max(size - LENGTH, 0))
        seal = file.read(LENGTH)
        if not seal.startswith(MARK):
            return MARK in seal or any(seal.endswith(MARK[:n]) for n in range(_ENOUGH, len(MARK)))
        file.seek(0)
        return _digest_of(file, size - LENGTH) != seal[len(MARK) :]


def _digest_of(file: BinaryIO, size: int) -> bytes:
    digest = hashlib.sha256()
    while size > 0:
        part = file.read(min(size, 2**20))
        if not part:
            break
        digest.update(part)
        size -= len(part)
    return digest.digest()
