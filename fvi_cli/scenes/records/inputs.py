"""Numbers of input files, which the process keeps once, by the digest that configurations hold."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import ArgumentError
from fvi_cli.keys.scalars import Text
from fvi_cli.keys.settings import key

Digest = Annotated[str | None, Text(what="64 hexadecimal digits", pattern="[0-9a-f]{64}")]
DIGEST: Final = key("SHA-256 of the numbers that were read; filled in.", default=None)
PLACE: Final = ("file", "column", "time", "variable")
"""Keys that say where numbers stand; the digest says which ones they are."""

_KEPT: Final[dict[str, NDArray[Any]]] = {}


def digest_of(numbers: NDArray[Any]) -> str:
    """SHA-256 of type, shape and numbers."""
    digest = hashlib.sha256(f"{numbers.dtype.str}{numbers.shape}".encode())
    digest.update(np.ascontiguousarray(numbers).data)
    return digest.hexdigest()


def keep_numbers(numbers: NDArray[Any]) -> str:
    """Keep the numbers of a file; returns their digest."""
    digest = digest_of(numbers)
    if digest not in _KEPT:
        numbers.setflags(write=False)
        _KEPT[digest] = numbers
    return digest


def is_kept(digest: object) -> bool:
    """Whether the numbers of a digest are known."""
    return digest in _KEPT


def numbers_of(specification: Mapping[str, Any]) -> NDArray[Any]:
    """The numbers of the mapping of a file that was read.

    Raises
    ------
    ArgumentError
        If the file was not read.
    """
    digest = str(specification.get("digest"))
    if digest not in _KEPT:
        raise ArgumentError("file", f"{specification['file']} was not read; load a configuration")
    return _KEPT[digest]


def is_file(value: Mapping[str, Any]) -> bool:
    """Whether a mapping of JSON values is that of a file that was read."""
    return "file" in value and "digest" in value


def inputs_in(value: object) -> Iterator[tuple[str, NDArray[Any]]]:
    """Digests and numbers of all files in JSON values."""
    if isinstance(value, Mapping):
        if is_file(value):
            yield str(value["digest"]), numbers_of(value)
        for one in value.values():
            yield from inputs_in(one)
    elif isinstance(value, list | tuple):
        for one in value:
            yield from inputs_in(one)


def without_places(value: Any) -> Any:
    """JSON values without the places of files, which do not matter beside their digests."""
    if isinstance(value, Mapping):
        left = PLACE if is_file(value) else ()
        return {key: without_places(one) for key, one in value.items() if key not in left}
    return [without_places(one) for one in value] if isinstance(value, list | tuple) else value
