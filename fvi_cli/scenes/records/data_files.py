"""Files that are read together with a configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from fvi_cli.errors import excerpt, suggestion

MOST_LINES: Final = 1_000_000
"""Most lines of a text file; the limit on samples is lower."""


class DataFileError(Exception):
    """A file cannot be used; one message for each of the first mistakes, at a key."""

    def __init__(self, *messages: str, key: str = "file") -> None:
        self.messages, self.key = messages, key
        super().__init__("\n".join(messages))


def no_such_file(path: Path, name: str) -> str:
    """The complaint about a missing file, with the most similar name in its folder."""
    files = [one.name for one in path.parent.glob("*") if one.is_file()]
    near = suggestion(path.name, files) or "; paths begin at the folder of the configuration"
    if "\\" in name:
        near = "; write / in place of \\"
    return f"{name}: cannot be read: no such file{near}"


def read_content(path: Path, name: str, largest: int) -> bytes:
    """The bytes of a file; refuses more than `largest` bytes."""
    try:
        # reading a pipe or a device might never end
        if path.exists() and not path.is_file():
            raise DataFileError(f"{name}: not a file")
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except FileNotFoundError:
        raise DataFileError(no_such_file(path, name)) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or type(error).__name__
        raise DataFileError(f"{name}: cannot be read: {reason}") from None
    if len(content) > largest:
        raise DataFileError(f"{name}: more than {largest // 10**6} MB: too large")
    return content


def check_lines(content: bytes, name: str) -> None:
    """Refuse a text of more than `MOST_LINES` lines: empty lines take time as well."""
    lines = content.count(b"\n") + content.count(b"\r") - content.count(b"\r\n")
    if lines > MOST_LINES:
        raise DataFileError(
            f"{name}: more than {MOST_LINES} lines; thin it out, or remove empty ones"
        )


def parse_number(word: str) -> float:
    """The number that a word in a file means."""
    # Python also accepts 1_000
    if "_" in word:
        raise ValueError(f"{excerpt(word)!r} is not a number")
    return float(word)


MOST_SAMPLES: Final = 100_000
