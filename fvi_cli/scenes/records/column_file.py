"""A list of numbers from a column of a CSV file, read together with the configuration."""

from __future__ import annotations

from typing import Annotated, Any, Final

from fvi_cli.errors import ArgumentError
from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Text
from fvi_cli.keys.settings import Setting, key, record_of
from fvi_cli.scenes.records.csv_samples import read_csv_columns
from fvi_cli.scenes.records.data_files import (
    CONTENT_SHA256,
    LARGEST_TEXT,
    SHA256,
    DataFileError,
    Digest,
    file_under,
    filled_in,
)


class ColumnOfFile(
    Setting, expected="a column of a file, such as {file: building.csv, column: mass}"
):
    """Positive numbers from a column of a file, one in every line."""

    file: Annotated[str, Text(what="the path of a CSV file")] = key(
        "CSV file with names of columns in its first line; a relative path begins at the "
        "configuration."
    )
    column: Annotated[str, Text(what="the name of a column")] = key("Column of the numbers.")
    sha256: Digest = SHA256
    content: Annotated[str | None, Text(what="numbers between blanks")] = key(
        "The numbers between blanks; filled in, and used in place of the file.", default=None
    )
    content_sha256: Digest = CONTENT_SHA256

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """The keys with ``sha256`` and ``content`` filled in from the file."""
        file, name = file_under(values["file"], at)
        column = values["column"]

        def read() -> tuple[str, str, str]:
            found = read_csv_columns(file, name, (column,))
            for value, line in zip(found.table[:, 0].tolist(), found.lines, strict=True):
                if not value > 0:
                    raise DataFileError(
                        f"{name}:{line}: {column} = {value:g}; write a number greater than 0"
                    )
            text = " ".join(map(repr, found.table[:, 0].tolist()))
            return found.sha256, text, f"its {len(found.lines)} numbers"

        return filled_in(
            values,
            at,
            ("column", file, column),
            read,
            parse=numbers_in,
            is_equal=lambda one, other: numbers_in(one) == numbers_in(other),
            largest=LARGEST_TEXT,
        )

    def value(self) -> tuple[float, ...]:
        """The numbers."""
        if self.content is None:
            raise ArgumentError("content", f"missing; what {self.file} holds is needed as well")
        return numbers_in(self.content)


COLUMN_FILE: Final = record_of(ColumnOfFile)


def numbers_in(text: str) -> tuple[float, ...]:
    """The numbers in the text of a column."""
    try:
        return tuple(map(float, text.split()))
    except ValueError as error:
        raise ValueError(f"not numbers between blanks: {error}") from None
