"""A stream for h5py whose writer never sees a failure.

HDF5 cannot close a file that it could not write: it fails again with every object that is
released, and may end the process with a segmentation fault. So the first failure, of the disk or
by an interrupt, is kept for the caller, and later writes go to memory.
"""

from __future__ import annotations

import io
import os


class SafeStream:
    """Random access to an open file, for :class:`h5py.File`; the caller closes the file."""

    def __init__(self, handle: int) -> None:
        self._handle = handle
        self._position = 0
        self._size = 0
        self._failure: BaseException | None = None
        self._unwritten: list[tuple[int, bytes]] = []

    def check(self) -> None:
        """Raise the first failure, if there was one."""
        if self._failure is not None:
            raise self._failure

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
