"""Streams for h5py: its writer never sees a failure, its reader never a damaged byte.

HDF5 cannot close a file that it could not write: it fails again with every object that is
released, and may end the process with a segmentation fault. So the first failure, of the disk or
by an interrupt, is kept for the caller, and later writes go to memory.

HDF5 must not see changed bytes either: it may search in them for ever. So a seal, the checksums of
all blocks, follows the last byte of the HDF5 file, and every block is verified before HDF5 gets it;
a large file need not be read whole before a part of it is used. Other readers do not see the seal,
and a program that changes a file through HDF5 cuts it off. Such a file is read only if the user
asks for that, and then each run in it is verified by itself.
"""

from __future__ import annotations

import hashlib
import io
import os
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

MARK = b"fvi-cli sha256 seal:"
BLOCK = 2**18
"""Bytes per block; each block has its own checksum."""

_DIGEST = hashlib.sha256().digest_size
_ENOUGH = len(b"fvi-cli ")


class DamagedBytesError(ValueError):
    """The bytes of a file are not those that were written."""

    def __init__(self) -> None:
        super().__init__("its bytes are not those that were written")


@dataclass(frozen=True, kw_only=True)
class Seal:
    """Number of sealed bytes, and the SHA-256 of each block of them."""

    size: int
    digests: bytes


def length_of(size: int) -> int:
    """Length of the seal of `size` bytes."""
    return len(MARK) + -(-size // BLOCK) * _DIGEST + _DIGEST


def append_seal(handle: int) -> None:
    """Seal a complete file that is open for reading and writing."""
    with os.fdopen(os.dup(handle), "r+b") as file:
        file.seek(0)
        digests = b""
        while block := file.read(BLOCK):
            digests += hashlib.sha256(block).digest()
        size = file.tell()
        file.write(MARK + digests + _digest_of(size, digests))


def read_seal(handle: int) -> Seal | None:
    """The seal of an open file; None where there is none.

    The argument is no path, since another file may take the place of a path at any time.
    """
    whole = os.fstat(handle).st_size
    # a seal grows with its file, so the seal of all bytes would be longer than the real one
    longest = min(length_of(whole), whole)
    os.lseek(handle, whole - longest, os.SEEK_SET)
    end = _read_all(handle, longest)
    begin = end.rfind(MARK)
    if begin < 0:
        if any(end.endswith(MARK[:n]) for n in range(_ENOUGH, len(MARK))):
            raise DamagedBytesError
        return None
    size = whole - longest + begin
    digests, own = end[begin + len(MARK) : -_DIGEST], end[-_DIGEST:]
    if whole - size != length_of(size) or own != _digest_of(size, digests):
        raise DamagedBytesError
    return Seal(size=size, digests=digests)


def _digest_of(size: int, digests: bytes) -> bytes:
    return hashlib.sha256(size.to_bytes(8, "little") + digests).digest()


def is_whole(seal: Seal, number: int, block: bytes) -> bool:
    """Whether a block, counted from 0, is the one that was sealed."""
    expected = seal.digests[number * _DIGEST : (number + 1) * _DIGEST]
    return hashlib.sha256(block).digest() == expected


class _Stream(ABC):
    """A place in a file of known size, for :class:`h5py.File`."""

    _position = 0
    _size = 0

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a place; beyond the end is allowed."""
        begin = {io.SEEK_SET: 0, io.SEEK_CUR: self._position, io.SEEK_END: self._size}[whence]
        self._position = begin + offset
        return self._position

    def tell(self) -> int:
        """The place where the next byte is read or written."""
        return self._position

    def read(self, size: int) -> bytes:
        """At most `size` bytes; h5py requires this method of a file."""
        content = bytearray(size)
        return bytes(content[: self.readinto(content)])

    @abstractmethod
    def readinto(self, target: bytearray | memoryview) -> int:
        """Read as many bytes as fit and are there."""


class SafeStream(_Stream):
    """Random access to an open file, for :class:`h5py.File`; the caller closes the file."""

    def __init__(self, handle: int) -> None:
        self._handle = handle
        self._failure: BaseException | None = None
        self._unwritten: list[tuple[int, bytes]] = []

    def check(self) -> None:
        """Raise the first failure, if there was one."""
        if self._failure is not None:
            raise self._failure

    def write(self, data: bytes | bytearray | memoryview) -> int:
        """Write all of `data`; after a failure to memory."""
        content = bytes(data)
        if self._failure is None:
            try:
                _write_all(self._handle, content, self._position)
            except BaseException as error:
                self._failure = error
        if self._failure is not None:
            self._unwritten.append((self._position, content))
        self._position += len(content)
        self._size = max(self._size, self._position)
        return len(content)

    def readinto(self, target: bytearray | memoryview) -> int:
        """Read as many bytes as fit and are there."""
        view = memoryview(target).cast("B")
        begin = self._position
        count = max(0, min(len(view), self._size - begin))
        content = bytearray(count)
        try:
            os.lseek(self._handle, begin, os.SEEK_SET)
            found = _read_all(self._handle, count)
        except BaseException as error:
            self._failure = self._failure or error
            found = b""
        content[: len(found)] = found
        for place, data in self._unwritten:
            first, last = max(place, begin), min(place + len(data), begin + count)
            if first < last:
                content[first - begin : last - begin] = data[first - place : last - place]
        view[:count] = content
        self._position += count
        return count

    def truncate(self, size: int | None = None) -> int:
        """Change the length."""
        self._size = self._position if size is None else size
        if self._failure is None:
            try:
                os.ftruncate(self._handle, self._size)
            except BaseException as error:
                self._failure = error
        return self._size

    def flush(self) -> None:
        """Do nothing: there is no buffer."""


class SealedStream(_Stream):
    """A file for the reader of h5py, which gets only bytes that agree with the seal.

    It stays open, so that reads give the same file even when another one takes its name.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb", buffering=0)
        try:
            self._seal = read_seal(self._file.fileno())
        except BaseException:
            self._file.close()
            raise
        size = os.fstat(self._file.fileno()).st_size
        self._size = size if self._seal is None else self._seal.size
        self._looked_at: set[int] = set()

    def readinto(self, target: bytearray | memoryview) -> int:
        """Read as many bytes as fit and are there."""
        view = memoryview(target).cast("B")
        count = max(0, min(len(view), self._size - self._position))
        if self._seal is not None and count:
            for number in range(self._position // BLOCK, (self._position + count - 1) // BLOCK + 1):
                self._look_at(self._seal, number)
        self._file.seek(self._position)
        view[:count] = _read_all(self._file.fileno(), count)
        self._position += count
        return count

    @property
    def is_sealed(self) -> bool:
        """Whether every byte is verified by a seal."""
        return self._seal is not None

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _look_at(self, seal: Seal, number: int) -> None:
        if number in self._looked_at:
            return
        self._file.seek(number * BLOCK)
        block = _read_all(self._file.fileno(), min(BLOCK, self._size - number * BLOCK))
        if not is_whole(seal, number, block):
            raise DamagedBytesError
        self._looked_at.add(number)


def _write_all(handle: int, content: bytes, place: int) -> None:
    os.lseek(handle, place, os.SEEK_SET)
    remaining = memoryview(content)
    while remaining:
        remaining = remaining[os.write(handle, remaining) :]


def _read_all(handle: int, count: int) -> bytes:
    found = b""
    while len(found) < count and (more := os.read(handle, count - len(found))):
        found += more
    return found
