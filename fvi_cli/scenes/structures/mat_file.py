"""Matrices of MATLAB's files, versions 5 to 7: the numbers and the sparse ones, nothing else.

The format: MathWorks, *MAT-File Format* (level 5). SciPy's reader is compiled and believes types
and lengths: a wrong one ends the process.
"""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.scenes.structures.declared import check_rows, sparse_matrix

HEADER: Final = 128
_MATRIX: Final = 14
_SPARSE: Final = 5
_CLASSES: Final = (
    *("", "cell", "struct", "object", "char", "sparse", "double", "single"),
    *("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"),
    *("function", "opaque"),
)
_NUMBERS: Final = range(_SPARSE, 16)
_TYPES: Final = MappingProxyType(
    {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
)
_LOGICAL, _COMPLEX = 1 << 9, 1 << 11


@dataclass(frozen=True, kw_only=True, eq=False)
class MatVariable:
    """A variable of a file, of which only the head was read.

    Parameters
    ----------
    name
        As in MATLAB.
    kind
        Its class, ``double``, ``sparse``, ``cell``, ...
    shape
        As it is declared.
    is_complex
        Whether it has an imaginary part.
    order
        ``<`` or ``>``: which byte comes first.
    rest
        Bytes behind the head.
    """

    name: str
    kind: str
    shape: tuple[int, ...]
    is_complex: bool
    order: str
    rest: memoryview

    @property
    def is_matrix_of_numbers(self) -> bool:
        """Whether it holds real or complex numbers."""
        return self.kind in [_CLASSES[number] for number in _NUMBERS]

    def value(self) -> Any:
        """The matrix, dense or sparse.

        Raises
        ------
        ValueError
            If its parts are not those that it declares.
        """
        places = _places(self.rest, self.order)
        parts = [_numbers(kind, part, self.order) for kind, part, _ in places]
        if self.kind != "sparse":
            values = _with_imaginary(parts, 0, self)
            if values.size != math.prod(self.shape) or min(self.shape, default=-1) < 0:
                raise ValueError(f"{values.size} entries for {' x '.join(map(str, self.shape))}")
            return values.reshape(self.shape, order="F")
        check_rows(self.shape, sparse=True)
        if len(parts) < 3:
            raise ValueError("a sparse matrix without its entries")
        rows, ends, data = parts[0], parts[1], _with_imaginary(parts, 2, self)
        # room that was set aside for more entries is not taken
        count = int(ends[-1]) if ends.size else 0
        if not 0 <= count <= min(rows.size, data.size):
            raise ValueError(f"{count} entries are declared, {data.size} are there")
        held: Mapping[str, NDArray[Any]] = {
            "indices": rows[:count],
            "indptr": ends,
            "data": data[:count],
        }
        return sparse_matrix("csc", self.shape, held)


def mat_variables(plain: bytes) -> list[MatVariable]:
    """The variables of a file whose elements are not compressed.

    Raises
    ------
    ValueError
        If it is not of that format.
    """
    order = "<" if plain[126:128] == b"IM" else ">"
    found = []
    for kind, data, _ in _places(memoryview(plain)[HEADER:], order, padded=False):
        if kind != _MATRIX:
            raise ValueError(f"an element of type {kind} where a matrix is needed")
        variable = _variable(data, order)
        # a workspace of functions has no name
        if variable.name and not variable.name.startswith("__"):
            found.append(variable)
    return found


def _variable(data: memoryview, order: str) -> MatVariable:
    places = list(itertools.islice(_places(data, order), 3))
    head = [_numbers(kind, part, order) for kind, part, _ in places]
    if len(head) < 3 or head[0].size < 1 or head[1].size > 32:
        raise ValueError("a variable without flags, dimensions and name")
    flags = int(head[0][0])
    number = flags & 0xFF
    name = _CLASSES[number] if 0 < number < len(_CLASSES) else f"of class {number}"
    return MatVariable(
        name=head[2].tobytes().decode("latin-1"),
        kind="logical" if flags & _LOGICAL else name,
        shape=tuple(head[1].tolist()),
        is_complex=bool(flags & _COMPLEX),
        order=order,
        rest=data[places[-1][2] :],
    )


def _places(
    data: memoryview, order: str, *, padded: bool = True
) -> Iterator[tuple[int, memoryview, int]]:
    """Types and bytes of elements, one after the other, and where each ends."""
    place = 0
    while place + 8 <= len(data):
        kind, length = struct.unpack_from(f"{order}II", data, place)
        begin = place + 8
        if kind >> 16:
            # up to four bytes stand in the tag itself
            kind, length, begin = kind & 0xFFFF, kind >> 16, place + 4
            place += 8
            if length > 4:
                raise ValueError(f"a short element of {length} bytes")
        else:
            place = begin + length + (-length % 8 if padded else 0)
        if begin + length > len(data):
            raise ValueError(f"{length} bytes are declared, {len(data) - begin} are there")
        yield kind, data[begin : begin + length], place


def _numbers(kind: int, data: memoryview, order: str) -> NDArray[Any]:
    """The numbers of an element."""
    if kind not in _TYPES:
        raise ValueError(f"an element of type {kind} where numbers are needed")
    dtype = np.dtype(f"{order}{_TYPES[kind]}")
    if len(data) % dtype.itemsize:
        raise ValueError(f"{len(data)} bytes are no numbers of {dtype.itemsize} bytes")
    return np.frombuffer(data, dtype=dtype)


def _with_imaginary(parts: list[NDArray[Any]], index: int, of: MatVariable) -> NDArray[Any]:
    """The entries, complex where there is an imaginary part."""
    wanted = index + 1 + of.is_complex
    if len(parts) != wanted:
        raise ValueError(f"{len(parts)} parts where there must be {wanted}")
    if not of.is_complex:
        return parts[index]
    if parts[index].size != parts[index + 1].size:
        raise ValueError("real and imaginary parts of other lengths")
    return parts[index] + 1j * parts[index + 1]
