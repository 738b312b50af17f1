"""Files that are read together with a configuration, whose content then travels with it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar, cast

from fvi_cli.keys.complaints import excerpt
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Text
from fvi_cli.keys.settings import key

T = TypeVar("T")

MOST_LINES: Final = 1_000_000
"""Lines of a text file, at most; there may be fewer samples."""
Digest = Annotated[str | None, Text(what="64 hexadecimal digits")]
SHA256: Final = key(
    "Of the file; filled in, and checked where it is given and the file is there.", default=None
)
CONTENT_SHA256: Final = key("Of the text under content; checked where it is given.", default=None)


class DataFileError(Exception):
    """What is wrong with a file, one message for each mistake (no more than a few)."""

    def __init__(self, *messages: str) -> None:
        self.messages = messages
        super().__init__("\n".join(messages))

    def report_argument(self, at: Cursor) -> None:
        """Complain about the key ``file``."""
        for message in self.messages:
            at.refuse(message, "file")


def file_under(given: str, at: Cursor) -> tuple[Path, str]:
    """A file of the configuration, beside it, and what messages call it."""
    folder = at.complaints.folder
    return Path(given) if folder is None else folder / given, excerpt(given, 200)


def read_content(path: Path, name: str, largest: int) -> bytes:
    """The bytes of a file that has no more than `largest`.

    Raises
    ------
    DataFileError
        If it cannot be read, or is larger.
    """
    try:
        # a pipe or a device would be read for ever
        if path.exists() and not path.is_file():
            raise DataFileError(f"{name}: not a file")
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or type(error).__name__
        raise DataFileError(f"{name}: cannot be read: {reason}") from None
    if len(content) > largest:
        raise DataFileError(f"{name}: more than {largest // 10**6} MB: too large")
    return content


def read_once(at: Cursor, key: tuple[Hashable, ...], read: Callable[[], T]) -> T:
    """What `read` returns, called once for a text and a key that tells the file and what of it."""
    known = at.complaints.files
    if key not in known:
        known[key] = read()
    return cast(T, known[key])


def check_lines(content: bytes, name: str) -> None:
    """Refuse a text of more than `MOST_LINES` lines: empty ones take time as well.

    Raises
    ------
    DataFileError
        With the limit.
    """
    lines = content.count(b"\n") + content.count(b"\r") - content.count(b"\r\n")
    if lines > MOST_LINES:
        raise DataFileError(
            f"{name}: more than {MOST_LINES} lines; thin it out, or remove empty ones"
        )


def number_of(word: str) -> float:
    """The number that a word in a file is.

    Raises
    ------
    ValueError
        If it is none; Python also takes ``1_000``.
    """
    if "_" in word:
        raise ValueError(f"{excerpt(word)!r} is not a number")
    return float(word)


def with_content(
    values: Mapping[str, Any], at: Cursor, *, sha256: str, text: str, largest: int, what: str
) -> Any:
    """The keys with ``sha256`` and ``content`` filled in from what was read."""
    name = excerpt(values["file"], 200)
    if values.get("sha256", sha256).lower() != sha256:
        return at.refuse(f"{name} has changed: its sha256 is {sha256}", "sha256")
    if len(text) > largest:
        size_message = f"{name}: {what} take {len(text)} characters in every result file"
        return at.refuse(f"{size_message}, more than {largest}; thin them out", "file")
    return {**values, "sha256": sha256, "content": text}


def without_digest(values: Mapping[str, Any], at: Cursor, *, is_same: Callable[[], bool]) -> Any:
    """The keys with a content that is what it was, without ``content_sha256``."""
    digest = hashlib.sha256(str(values["content"]).encode()).hexdigest()
    if str(values.get("content_sha256", digest)).lower() != digest:
        return at.refuse(
            f"it has changed: its sha256 is {digest}, not content_sha256; leave both out to read "
            "the file",
            "content",
        )
    name = excerpt(values["file"], 200)
    if "sha256" in values and file_under(values["file"], at)[0].is_file():
        try:
            known = is_same()
        except DataFileError:
            # another file by this name says nothing of the content
            known = True
        if not known:
            return at.refuse(f"not what {name} holds; leave it out to read the file", "content")
    return {key: value for key, value in values.items() if key != "content_sha256"}
