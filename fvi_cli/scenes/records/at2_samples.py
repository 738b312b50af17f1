"""Accelerograms in the AT2 format of the PEER ground motion database."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Final

import numpy as np

from fvi_cli.keys.complaints import excerpt
from fvi_cli.scenes.records.csv_samples import LARGEST_FILE, CsvSamples
from fvi_cli.scenes.records.data_files import DataFileError, read_content
from fvi_cli.scenes.records.samples import MOST_SAMPLES

SUFFIX: Final = ".at2"
HEADER_LINES: Final = 4
_NUMBER: Final = r"([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)"
_NAMED: Final = re.compile(rf"NPTS\s*=\s*(\d+)\s*,?\s*DT\s*=\s*{_NUMBER}", re.IGNORECASE)
_BEFORE: Final = re.compile(rf"(\d+)\s+{_NUMBER}\s+NPTS\s*,\s*DT", re.IGNORECASE)


def read_at2_samples(path: Path, name: str) -> CsvSamples:
    """Read a record: times k DT, and accelerations in units of g as they stand in the file.

    Four lines of header, the last of which has ``NPTS= 4000, DT= .0050 SEC`` (older files:
    ``4000 0.0050 NPTS, DT``), then NPTS numbers, several in a line.

    Parameters
    ----------
    path
        The file.
    name
        What messages call it.

    Raises
    ------
    DataFileError
        ``<name>:<line>: what is wrong``.
    """
    content = read_content(path, name, LARGEST_FILE)
    lines = content.decode("latin-1").splitlines()
    header = "\n".join(lines[:HEADER_LINES])
    found = _NAMED.search(header) or _BEFORE.search(header)
    if found is None:
        raise DataFileError(
            f"{name}:{HEADER_LINES}: no NPTS= and DT= in the first {HEADER_LINES} lines; a record "
            "in AT2 has them in its fourth line"
        )
    count, step = int(found[1]), float(found[2])
    if not step > 0 or not 2 <= count <= MOST_SAMPLES:
        raise DataFileError(
            f"{name}:{HEADER_LINES}: {count} samples {step:g} apart are not allowed; there must be "
            f"2 to {MOST_SAMPLES}, a positive time apart"
        )
    values: list[float] = []
    for number, line in enumerate(lines[HEADER_LINES:], start=HEADER_LINES + 1):
        for word in line.split():
            try:
                values.append(float(word))
            except ValueError:
                raise DataFileError(
                    f"{name}:{number}: {excerpt(word)!r} is no number; below the header stand "
                    "accelerations only"
                ) from None
    if len(values) != count or not np.isfinite(values).all():
        raise DataFileError(
            f"{name}:{len(lines)}: {len(values)} accelerations where the header says NPTS = "
            f"{count}; the record is cut off or has a gap"
        )
    digits = len(found[2].partition(".")[2]) if "e" not in found[2].lower() else 12
    time = np.round(step * np.arange(count), digits)
    return CsvSamples(
        time=time, values=np.array(values), sha256=hashlib.sha256(content).hexdigest()
    )
