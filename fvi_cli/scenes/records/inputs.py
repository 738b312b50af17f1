"""Input files of a configuration: their numbers are kept once in the process, by their digest."""

from __future__ import annotations

import hashlib
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, model_validator

from fvi_cli.errors import ArgumentError, excerpt
from fvi_cli.scenes.keys.values import Keys, key

LARGEST_TEXT: Final = 20_000_000
PLACE: Final = ("file", "column", "time", "decimal", "variable")
"""Keys that say where numbers stand; the digest says which ones they are."""

_KEPT: Final[dict[str, NDArray[Any]]] = {}


class DataFileError(ArgumentError):
    """A file cannot be used: what is wrong, at a key."""

    def __init__(self, message: str, key: str = "file") -> None:
        super().__init__(key, message)


def read_content(path: Path, name: str, largest: int) -> bytes:
    """The bytes of a file; refuses more than `largest` bytes."""
    try:
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or type(error).__name__
        words = f"cannot be read: {reason}; paths begin at the folder of the configuration"
        raise DataFileError(f"{name}: {words}") from None
    if len(content) > largest:
        raise DataFileError(f"{name}: more than {largest // 10**6} MB: too large")
    return content


def read_text(path: Path, name: str, encoding: str = "utf-8-sig") -> str:
    """The text of a file; refuses other encodings."""
    content = read_content(path, name, LARGEST_TEXT)
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise DataFileError(f"{name}:{line}: not UTF-8; save the file as UTF-8 text") from None


class FromFile(Keys):
    """Numbers of a file, which is read when the mapping is validated.

    The context of the validation may hold the `folder` at which relative paths begin, and the
    mapping `files` of digests that were read before.
    """

    file: str = key("Path of the file; a relative one begins at the configuration.")
    digest: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = key(
        "SHA-256 of the numbers that were read; filled in.", None
    )

    @abstractmethod
    def read(self, path: Path, name: str) -> NDArray[Any]:
        """The numbers of the file at a path, called `name` in messages."""

    @property
    def value(self) -> Any:
        """What stands in the file: its numbers, or the matrix of these."""
        return kept_numbers(str(self.digest))

    @model_validator(mode="after")
    def _read(self, info: ValidationInfo) -> Self:
        if self.digest in _KEPT:
            return self
        context: Mapping[str, Any] = info.context or {}
        path = Path(context.get("folder") or "", self.file)
        known = context.get("files", {})
        where = (type(self), path, *(getattr(self, name, None) for name in PLACE[1:]))
        name = excerpt(self.file, 200)
        if where not in known:
            known[where] = keep_numbers(self.read(path, name))
        if self.digest not in (None, known[where]):
            message = f"{name} has changed; leave digest out to take what it holds"
            raise DataFileError(message, "digest")
        self.__dict__["digest"] = known[where]
        self.__pydantic_fields_set__.add("digest")
        return self


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


def kept_numbers(digest: str) -> NDArray[Any]:
    """The numbers of a file that was read."""
    return _KEPT[digest]


def is_file(value: Mapping[str, Any]) -> bool:
    """Whether a mapping of JSON values is that of a file that was read."""
    return "file" in value and "digest" in value


def inputs_in(value: object) -> Iterator[tuple[str, NDArray[Any]]]:
    """Digests and numbers of all files in JSON values."""
    if isinstance(value, Mapping):
        if is_file(value):
            yield str(value["digest"]), kept_numbers(str(value["digest"]))
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
