"""Files that are read together with a configuration, and forces by their samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar, cast

from numpy.typing import NDArray

from fvi_cli.effects.sampled import Interpolation, SampledForce
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import excerpt, suggestion
from fvi_cli.keys.cursor import INVALID, Cursor
from fvi_cli.scenes.records.inputs import keep_numbers, numbers_of

T = TypeVar("T")

MOST_LINES: Final = 1_000_000
"""Most lines of a text file; the limit on samples is lower."""


class DataFileError(Exception):
    """A file cannot be used; one message for each of the first mistakes."""

    def __init__(self, *messages: str) -> None:
        self.messages = messages
        super().__init__("\n".join(messages))

    def report_argument(self, at: Cursor) -> None:
        """Complain about the key ``file``."""
        for message in self.messages:
            at.refuse(message, "file")


def file_under(given: str, at: Cursor) -> tuple[Path, str]:
    """Path of a file, relative to the configuration, and its name in messages."""
    folder = at.complaints.folder
    return Path(given) if folder is None else folder / given, excerpt(given, 200)


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


def read_once(at: Cursor, key: tuple[Hashable, ...], read: Callable[[], T]) -> T:
    """The result of `read`, which is called once per configuration and `key` (file and part)."""
    known = at.complaints.files
    if key not in known:
        known[key] = read()
    return cast(T, known[key])


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


def with_digest(
    values: Mapping[str, Any],
    at: Cursor,
    key: tuple[Hashable, ...],
    read: Callable[[], NDArray[Any]],
) -> Any:
    """The keys with the digest of the numbers that `read` returns, once per file and part."""
    try:
        digest = read_once(at, key, lambda: keep_numbers(read()))
    except DataFileError as error:
        error.report_argument(at)
        return INVALID
    if values.get("digest", digest) != digest:
        name = excerpt(values["file"], 200)
        return at.refuse(f"{name} has changed; leave digest out to take what it holds", "digest")
    return {**values, "digest": digest}


MOST_SAMPLES: Final = 100_000


def sampled_component(specification: Mapping[str, Any], final_time: float) -> SampledForce:
    """The component that ``{file, column, interpolation, scale, digest}`` describes."""
    name, column = str(specification["file"]), str(specification.get("column", "acceleration"))
    time, values = numbers_of(specification).T
    slack = 1e-9 * final_time
    ends_early = time[-1] < final_time - slack
    if time[0] > slack or (ends_early and specification.get("beyond") != "zero"):
        hint = (
            ""
            if time[0] > slack
            else f"; write beyond: zero for no force after them, or final_time: {time[-1]:g}"
        )
        raise ArgumentError(
            name,
            f"its samples reach from t = {time[0]:g} to {time[-1]:g}; they must reach from "
            f"0 to final_time = {final_time:g}{hint}",
        )
    return SampledForce.through(
        time,
        float(specification.get("scale", 1.0)) * values,
        cast(Interpolation, specification.get("interpolation", "linear")),
        source=f"{column} of {name}",
    )


def end_of_samples(specification: Mapping[str, Any], final_time: float) -> float:
    """Time before T at which samples with ``beyond: zero`` end; infinite otherwise."""
    if specification.get("beyond") != "zero":
        return math.inf
    end = float(numbers_of(specification)[-1, 0])
    return end if end < final_time * (1.0 - 1e-9) else math.inf
