"""A list of numbers from a column of a CSV file, read together with the configuration."""

from __future__ import annotations

from typing import Annotated, Any, Final

from fvi_cli.keys.cursor import Cursor
from fvi_cli.keys.scalars import Text
from fvi_cli.keys.settings import Setting, key, record_of
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.records.csv_samples import read_csv_columns
from fvi_cli.scenes.records.data_files import DataFileError, file_under, with_digest
from fvi_cli.scenes.records.inputs import DIGEST, Digest, is_kept, numbers_of


class ColumnOfFile(
    Setting, expected="a column of a file, such as {file: building.csv, column: mass}"
):
    """Positive numbers from a column of a file, one in every line."""

    file: Annotated[str, Text(what="the path of a CSV file")] = key(
        "CSV file with names of columns in its first line; a relative path begins at the "
        "configuration."
    )
    column: Annotated[str, Text(what="the name of a column")] = key("Column of the numbers.")
    digest: Digest = DIGEST

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """The keys with the digest of the numbers in the file."""
        if is_kept(values.get("digest")):
            return values
        file, name = file_under(values["file"], at)
        column = values["column"]

        def read() -> Array:
            found = read_csv_columns(file, name, (column,))
            for value, line in zip(found.table[:, 0].tolist(), found.lines, strict=True):
                if not value > 0:
                    raise DataFileError(
                        f"{name}:{line}: {column} = {value:g}; write a number greater than 0"
                    )
            return found.table[:, 0].copy()

        return with_digest(values, at, ("column", file, column), read)

    def value(self) -> tuple[float, ...]:
        """The numbers."""
        return tuple(numbers_of({"file": self.file, "digest": self.digest}).tolist())


COLUMN_FILE: Final = record_of(ColumnOfFile)
