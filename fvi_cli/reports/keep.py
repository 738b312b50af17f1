"""What is stored and agrees with what is computed now is left as it is, byte for byte.

Round-off differs from machine to machine. A file that is written anew for that alone would be a
change that nobody made.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from fvi_cli.errors import StorageError
from fvi_cli.reports.check import compare_with_tables
from fvi_cli.reports.files import rendered, table_paths
from fvi_cli.storage.atomic import replace_file
from fvi_cli.studies.order import OrderTable

_logger = logging.getLogger("fvi_cli")


def write_where_different(
    paths: Iterable[Path],
    differences: Callable[[], Sequence[str]],
    write: Callable[[], object],
    *,
    anew: bool = False,
) -> list[Path]:
    """Call `write` if there are `differences`; returns `paths`, which hold the results either way.

    Parameters
    ----------
    paths
        The files that belong together: all are written, or none.
    differences
        What ``--check`` tells of them, a missing file included.
    write
        Writes all of them.
    anew
        Write whatever the differences.
    """
    files = list(paths)
    if anew or differences():
        write()
    else:
        _logger.info(
            "%s: agree with what is computed, left as they are", ", ".join(map(str, files))
        )
    return files


def write_tables(
    directory: Path, name: str, tables: Sequence[OrderTable], *, anew: bool = False
) -> list[Path]:
    """Bring ``<name>.csv``, ``.md``, ``.tex`` and ``.json`` in `directory` up to date.

    Where they agree with `tables` (:func:`fvi_cli.reports.compare_with_tables`) they are left as
    they are, unless they are wanted `anew`. Otherwise all are made before the first is written, and
    each appears whole or not at all: it is written under a temporary name, flushed to the disk and
    renamed.

    Returns
    -------
    list of Path
        The four files.

    Raises
    ------
    StorageError
        If the folder or a file cannot be written.
    """
    paths = table_paths(directory, name)

    def write() -> None:
        texts = rendered(name, tables)
        place = directory
        try:
            directory.mkdir(parents=True, exist_ok=True)
            for form, text in texts.items():
                place = paths[form]
                replace_file(place, text.encode("utf-8"))
        except OSError as error:
            raise StorageError(f"{place}: cannot be written: {error.strerror}") from None

    return write_where_different(
        paths.values(), lambda: compare_with_tables(directory, name, tables), write, anew=anew
    )
