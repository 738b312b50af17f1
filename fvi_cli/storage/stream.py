"""A stream for h5py whose writer never sees a failure.

HDF5 cannot close a file that it could not write: it fails again with every object that is
released, and may end the process with a segmentation fault. So the first failure, of the disk or
by an interrupt, is kept for the caller, and later writes go to memory.
"""

from __future__ import annotations

import io
from typing import Any


class SafeStream(io.RawIOBase):
    """Random access to an open file without buffer, for :class:`h5py.File`."""

    def __init__(self, file: io.FileIO) -> None:
        self._file = file
        self._failure: BaseException | None = None
        self._unwritten: list[tuple[int, bytes]] = []
        self._position = 0
        self._size = file.seek(0, io.SEEK_END)

    def check(self) -> None:
        """Raise the first failure, if there was one."""
        if self._failure is not None:
            raise self._failure

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a place; beyond the end is allowed."""
        begin = {io.SEEK_SET: 0, io.SEEK_CUR: self._position, io.SEEK_END: self._size}[whence]
        self._position = begin + offset
        return self._position

    def write(self, data: Any) -> int:
        """Write all of `data`; after a failure to memory."""
        content, place = bytes(data), self._position
        self.seek(len(content), io.SEEK_CUR)
        self._size = max(self._size, self._position)
        try:
            if self._failure is None:
                self._file.seek(place)
                rest = memoryview(content)
                while rest:
                    rest = rest[self._file.write(rest) :]
        except BaseException as error:
            self._failure = error
        if self._failure is not None:
            self._unwritten.append((place, content))
        return len(content)

    def readinto(self, target: Any) -> int:
        """Fill the target; what nobody has written is zero."""
        begin, view = self._position, memoryview(target).cast("B")
        self.seek(len(view), io.SEEK_CUR)
        content = bytearray(len(view))
        try:
            self._file.seek(begin)
            found = self._file.read(len(view))
            content[: len(found)] = found
        except BaseException as error:
            self._failure = self._failure or error
        for place, data in self._unwritten:
            first, last = max(place, begin), min(place + len(data), begin + len(view))
            if first < last:
                content[first - begin : last - begin] = data[first - place : last - place]
        view[:] = content
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Change the length."""
        self._size = self._position if size is None else size
        try:
            if self._failure is None:
                self._file.truncate(self._size)
        except BaseException as error:
            self._failure = error
        return self._size
