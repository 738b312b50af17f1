"""A stream for h5py whose writer never sees a failure.

HDF5 cannot close a file that it could not write: it fails again with every object that is
released, and may end the process with a segmentation fault. So the first failure, of the disk or
by an interrupt, is kept for the caller, and later writes go to memory.
"""

from __future__ import annotations

import io
from typing import Any


class SafeStream:
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
        self._position = offset + (self._size if whence == io.SEEK_END else 0)
        return self._position

    def tell(self) -> int:
        """The place where the next byte is read or written."""
        return self._position

    def write(self, data: Any) -> int:
        """Write all of `data`; after a failure to memory."""
        content, place = bytes(data), self._position
        self._position += len(content)
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
        """Fill the target; what no file has is zero."""
        begin, view = self._position, memoryview(target).cast("B")
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
        self._position += len(view)
        return len(view)

    def read(self, size: int) -> bytes:
        """Bytes from the present place on; h5py requires this method of a file."""
        content = bytearray(size)
        self.readinto(content)
        return bytes(content)

    def truncate(self, size: int) -> int:
        """Change the length."""
        self._size = size
        try:
            if self._failure is None:
                self._file.truncate(size)
        except BaseException as error:
            self._failure = error
        return size

    def flush(self) -> None:
        """Do nothing: there is no buffer."""
