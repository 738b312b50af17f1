"""The files of a report."""

from __future__ import annotations

import logging
from pathlib import Path

from fvi_cli.reports.compare import compare_files
from fvi_cli.reports.table import Report
from fvi_cli.reports.writers import rendered
from fvi_cli.storage.atomic import explain_os_error, replace_file

_logger = logging.getLogger("fvi_cli")


def write(directory: Path, report: Report, *, anew: bool = False) -> list[Path]:
    """Bring ``<name>.csv``, ``.md``, ``.tex`` and ``.json`` in `directory` up to date.

    Stored rows that agree with the fresh ones (:func:`compare`) stay, and with them every file that
    they make, byte for byte, unless all are wanted `anew`: round-off differs from machine to
    machine, and a file that is written for that alone would be a change that nobody made. All are
    made before the first is written, and
    each appears whole or not at all: it is written under a temporary name, flushed to the disk and
    renamed.

    Returns
    -------
    list of Path
        All files of the report.

    Raises
    ------
    StorageError
        If the folder or a file cannot be written.
    """
    is_new = anew or report.is_timed
    found, kept = ({}, report) if is_new else compare_files(directory, report)
    stale = {path for path, lines in found.items() if lines}
    texts = {directory / name: text for name, text in rendered(kept).items()}
    if not is_new and not stale:
        _logger.info("%s: agrees with what is computed, left as it is", directory / report.name)
    with explain_os_error(directory):
        directory.mkdir(parents=True, exist_ok=True)
    for place, text in texts.items():
        with explain_os_error(place):
            # where rows are others all files are; else those that do not belong to the rows
            if kept is report or place in stale or not place.is_file():
                replace_file(place, text.encode("utf-8"))
    return list(texts)
