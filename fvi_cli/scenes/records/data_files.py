"""Files that are read together with a configuration, and their contents as text."""

from __future__ import annotations

import base64
import contextlib
import functools
import hashlib
import math
import zlib
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar, cast

import numpy as np

from fvi_cli.effects.sampled import Interpolation, SampledForce
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import excerpt, suggestion
from fvi_cli.keys.cursor import INVALID, Cursor
from fvi_cli.keys.scalars import Text
from fvi_cli.keys.settings import key
from fvi_cli.mathematics.arrays import Array

T = TypeVar("T")

MOST_LINES: Final = 1_000_000
"""Most lines of a text file; the limit on samples is lower."""
Digest = Annotated[str | None, Text(what="64 hexadecimal digits")]
SHA256: Final = key(
    "Of the file; filled in, and checked where it is given and the file is there.", default=None
)
CONTENT_SHA256: Final = key("Of the text under content; checked where it is given.", default=None)


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


def filled_in(
    values: Mapping[str, Any],
    at: Cursor,
    key: tuple[Hashable, ...],
    read: Callable[[], tuple[str, str, str]],
    *,
    parse: Callable[[str], object],
    is_equal: Callable[[str, str], bool],
    largest: int,
) -> Any:
    """The keys with ``sha256`` and ``content`` filled in from the file, or as they are given.

    `read` returns (digest of the file, content as text, words for the content); `parse` raises
    ValueError for a wrong text; `is_equal` says whether two texts have the same contents. The
    result has no ``content_sha256``.
    """
    name = excerpt(values["file"], 200)
    if "content" not in values:
        try:
            sha256, text, what = read_once(at, key, read)
        except DataFileError as error:
            error.report_argument(at)
            return INVALID
        if values.get("sha256", sha256).lower() != sha256:
            return at.refuse(f"{name} has changed: its sha256 is {sha256}", "sha256")
        if len(text) > largest:
            size_message = f"{name}: {what} take {len(text)} characters in every result file"
            return at.refuse(f"{size_message}, more than {largest}; thin them out", "file")
        return {**values, "sha256": sha256, "content": text}
    try:
        parse(values["content"])
    except ValueError as error:
        return at.refuse(str(error), "content")
    digest = hashlib.sha256(str(values["content"]).encode()).hexdigest()
    if str(values.get("content_sha256", digest)).lower() != digest:
        return at.refuse(
            f"it has changed: its sha256 is {digest}, not content_sha256; leave both out to read "
            "the file",
            "content",
        )
    if "sha256" in values and file_under(values["file"], at)[0].is_file():
        # only the same file, by its digest, can contradict the content
        with contextlib.suppress(DataFileError):
            sha256, text, _ = read_once(at, key, read)
            if sha256 == values["sha256"].lower() and not is_equal(text, values["content"]):
                return at.refuse(f"not what {name} holds; leave it out to read the file", "content")
    return {key: value for key, value in values.items() if key != "content_sha256"}


MOST_SAMPLES: Final = 100_000
LARGEST_TEXT: Final = 500_000
"""Most characters of samples as text, which is part of every result file and run identity."""
_LARGEST_LINE: Final = 52


def samples_as_text(time: Array, values: Array) -> str:
    """Times and values without loss as one word.

    Lines ``t,value`` with the fewest digits from which the numbers are read back, compressed (zlib)
    and encoded in letters (base64).
    """
    lines = "".join(f"{t!r},{v!r}\n" for t, v in zip(time.tolist(), values.tolist(), strict=True))
    return base64.b64encode(zlib.compress(lines.encode(), 9)).decode()


@functools.lru_cache(maxsize=8)
def samples_from_text(text: str) -> tuple[Array, Array]:
    """Times and values of a text from `samples_as_text`; the arrays are read-only.

    They are cached, since members of a sweep have the same text.
    """
    limit = MOST_SAMPLES * _LARGEST_LINE
    try:
        unpacking = zlib.decompressobj()
        content = unpacking.decompress(base64.b64decode(text, validate=True), limit)
        if unpacking.unconsumed_tail or content.count(b"\n") > MOST_SAMPLES:
            raise ValueError(f"more than {MOST_SAMPLES} samples")
        if not unpacking.eof or unpacking.unused_data:
            # the checksum of the content is at the end of the compressed data
            raise ValueError("the text is cut off or continues after its end")
        rows = [line.split(",") for line in content.decode("ascii").removesuffix("\n").split("\n")]
        table = np.array([[float(cell) for cell in row] for row in rows])
    except (zlib.error, ValueError) as error:
        raise ValueError(f"not samples as text: {excerpt(str(error))}") from None
    if table.ndim != 2 or table.shape[1] != 2:
        raise ValueError("not samples as text: two columns are needed")
    table.setflags(write=False)
    return table[:, 0], table[:, 1]


def sampled_component(specification: Mapping[str, Any], final_time: float) -> SampledForce:
    """The component that ``{file, column, interpolation, scale, content}`` describes."""
    name, column = str(specification["file"]), str(specification.get("column", "acceleration"))
    if "content" not in specification:
        raise ArgumentError("content", f"missing; what {name} holds is needed as well")
    time, values = samples_from_text(str(specification["content"]))
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
    if specification.get("beyond") != "zero" or "content" not in specification:
        return math.inf
    end = float(samples_from_text(str(specification["content"]))[0][-1])
    return end if end < final_time * (1.0 - 1e-9) else math.inf
