"""Accelerograms in the AT2 format of the PEER ground motion database."""

from __future__ import annotations

import hashlib
import math
import re
from pathlib import Path
from typing import Final

import numpy as np

from fvi_cli.keys.complaints import excerpt
from fvi_cli.scenes.records.csv_samples import LARGEST_FILE, CsvSamples, number_or_nan
from fvi_cli.scenes.records.data_files import (
    DataFileError,
    check_lines,
    read_content,
)
from fvi_cli.scenes.records.samples import MOST_SAMPLES

SUFFIX: Final = ".at2"
HEADER_LINES: Final = 4
LONGEST_LINE: Final = 300
"""Characters of a line of the header with NPTS and DT, at most; records have some 80."""
_NUMBER: Final = r"([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)"
_NAMED: Final = re.compile(rf"NPTS\s*=\s*(\d+)\s*,?\s*DT\s*=\s*{_NUMBER}", re.IGNORECASE)
_BEFORE: Final = re.compile(rf"(\d+)\s+{_NUMBER}\s+NPTS\s*,\s*DT", re.IGNORECASE)


def read_at2_samples(path: Path, name: str) -> CsvSamples:
    """Read a record: times k DT, and accelerations in units of g as they stand in the file.

    Four lines of header, the last of which has ``NPTS= 4000, DT= .0050 SEC`` (older files:
    ``4000 0.0050 NPTS, DT``), then NPTS numbers, several in a line.

    Raises
    ------
    DataFileError
        ``<name>:<line>: what is wrong``.
    """
    content = read_content(path, name, LARGEST_FILE)
    check_lines(content, name)
    lines = content.decode("latin-1").splitlines()
    header = "\n".join(line for line in lines[:HEADER_LINES] if len(line) <= LONGEST_LINE)
    found = _NAMED.search(header) or _BEFORE.search(header)
    if found is None:
        raise DataFileError(
            f"{name}:{HEADER_LINES}: no NPTS= and DT= in the first {HEADER_LINES} lines; a record "
            "in AT2 has them in its fourth line"
        )
    count, step = int(found[1]), float(found[2])
    if not (step > 0 and 2 <= count <= MOST_SAMPLES and math.isfinite(count * step)):
        raise DataFileError(
            f"{name}:{HEADER_LINES}: {excerpt(found[1])} samples {step:g} apart are not allowed; "
            f"there must be 2 to {MOST_SAMPLES}, a positive time apart"
        )
    values: list[float] = []
    for number, line in enumerate(lines[HEADER_LINES:], start=HEADER_LINES + 1):
        for word in line.split():
            value = number_or_nan(word)
            if not math.isfinite(value):
                raise DataFileError(
                    f"{name}:{number}: {excerpt(word)!r} is no finite number; below the header "
                    "stand accelerations only"
                )
            values.append(value)
        if len(values) > count:
            break
    if len(values) != count:
        there = f"more than {count}" if len(values) > count else str(len(values))
        raise DataFileError(
            f"{name}:{len(lines)}: {there} accelerations where the header says NPTS = "
            f"{count}; the record is cut off or has a gap"
        )
    digits = len(found[2].partition(".")[2]) if "e" not in found[2].lower() else 12
    time = np.round(step * np.arange(count), digits)
    if not np.all(np.diff(time) > 0):
        raise DataFileError(f"{name}:{HEADER_LINES}: DT = {step:g} is too short")
    return CsvSamples(
        time=time, values=np.array(values), sha256=hashlib.sha256(content).hexdigest()
    )
