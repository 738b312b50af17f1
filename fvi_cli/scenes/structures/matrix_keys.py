"""Matrices from files as they stand under a key."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final, cast

import numpy as np

from fvi_cli.effects.matrices import (
    Form,
    SparseMatrix,
    added,
    entries,
    is_definite,
    is_sparse,
    scaled,
    sparse_unit,
)
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.cursor import INVALID, Cursor
from fvi_cli.keys.scalars import Text
from fvi_cli.keys.settings import PlainSetting, key, record_of
from fvi_cli.scenes.records.data_files import (
    CONTENT_SHA256,
    SHA256,
    DataFileError,
    Digest,
    file_under,
    read_once,
    with_content,
    without_digest,
)
from fvi_cli.scenes.structures.matrix_files import MatrixFile as ReadMatrix
from fvi_cli.scenes.structures.matrix_files import read_matrix
from fvi_cli.scenes.structures.matrix_text import (
    LARGEST_TEXT,
    check_text,
    matrix_as_text,
    matrix_from_text,
    rows_of_text,
)


def _read(values: Mapping[str, Any], at: Cursor, *, positive: bool) -> Any:
    """The keys of a matrix with ``sha256`` and ``content`` filled in from the file."""
    if "content" in values:
        try:
            check_text(values["content"])
        except ValueError as error:
            return at.refuse(str(error), "content")
    file, name = file_under(values["file"], at)
    variable = values.get("variable")

    def read() -> tuple[ReadMatrix, str]:
        found = read_matrix(file, name, variable)
        return found, matrix_as_text(found.form)

    def is_same() -> bool:
        found, _ = read_once(at, ("matrix", file, variable), read)
        if found.sha256 != values["sha256"].lower():
            return True
        given = matrix_from_text(values["content"])
        return (
            given.shape == found.form.shape
            and not entries(added(given, scaled(found.form, -1.0))).any()
        )

    if "content" in values:
        return without_digest(values, at, is_same=is_same)
    try:
        found, text = read_once(at, ("matrix", file, variable), read)
    except DataFileError as error:
        error.report_argument(at)
        return INVALID
    if positive and not is_definite(found.form):
        return at.refuse(
            f"{name}: an eigenvalue is zero or negative; a mass must be positive definite", "file"
        )
    return with_content(
        values,
        at,
        sha256=found.sha256,
        text=text,
        largest=LARGEST_TEXT,
        what="its entries",
    )


class MatrixFileShape(PlainSetting, words="a matrix from a file, such as {file: K.mtx}"):
    """A symmetric matrix from a file, read together with the configuration."""

    file: Annotated[str, Text(what="the path of a file, from the configuration's folder")] = key(
        "Matrix Market (.mtx), NumPy (.npy, .npz, also of scipy.sparse), MATLAB (.mat) or "
        "rows of numbers (.csv, .txt); a relative path begins at the configuration."
    )
    variable: Annotated[str | None, Text(what="the name of a matrix")] = key(
        "Which matrix of a .mat or .npz file that holds several.", default=None
    )
    sha256: Digest = SHA256
    content: Annotated[str | None, Text(what="a matrix as fvi writes it")] = key(
        "The matrix in short; filled in, and used in place of the file.", default=None
    )
    content_sha256: Digest = CONTENT_SHA256

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """The keys with ``sha256`` and ``content`` filled in from the file."""
        return _read(values, at, positive=isinstance(self, MassFile))


class MassFile(MatrixFileShape):
    """A positive definite matrix from a file."""


MATRIX_FILE: Final = record_of(MatrixFileShape)
MASS_FILE: Final = record_of(MassFile)


def file_form(value: object) -> Form | None:
    """The matrix of a mapping that was read by `MATRIX_FILE`; None for anything else.

    Raises
    ------
    ValueError
        ``content: what is wrong``.
    """
    if not isinstance(value, Mapping) or "file" not in value:
        return None
    if "content" not in value:
        raise ArgumentError("content", f"missing; what {value['file']} holds is needed as well")
    try:
        return matrix_from_text(str(value["content"]))
    except ValueError as error:
        raise ArgumentError("content", str(error)) from None


def rows_of(value: object) -> int | None:
    """Number of rows of a matrix from a file; None for anything else."""
    if isinstance(value, Mapping) and "file" in value and "column" not in value:
        return rows_of_text(str(value.get("content", "")))
    return None


def matrix_of(value: object, dimension: int, *, sparse: bool = False) -> Form:
    """A number times the unit matrix, which may be sparse; a matrix as it is."""
    from_file = file_form(value)
    if from_file is not None:
        return from_file
    if is_sparse(value):
        return cast("SparseMatrix", value)
    matrix = np.asarray(value, dtype=float)
    if matrix.ndim:
        return matrix
    return scaled(sparse_unit(dimension), float(matrix)) if sparse else matrix * np.eye(dimension)
