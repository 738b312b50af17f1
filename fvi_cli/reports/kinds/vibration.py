"""The reports on modes and on harmonic responses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from fvi_cli.reports.document import Block, Grid, Heading, Paragraph
from fvi_cli.reports.naming import all_units, columns_with_units, member_columns, with_ratio
from fvi_cli.reports.table import About, Column, Report, Sheet, Within, rows_of, within
from fvi_cli.studies.vibration.modes import LARGEST_RATIO, ModeTable
from fvi_cli.studies.vibration.response import GROUND, ResponseTable

FREQUENCY = Within(relative=1e-6)
DECAY = Within(relative=1e-5, absolute=1e-6)
PART = Within(relative=1e-6, absolute=1e-12)
SMALL = Within(relative=1e-5, absolute=1e-9)

MODE_COLUMNS = (
    Column("mode", "number of the mode, by |s|", "mode", get="number"),
    *within(
        "one",
        Column("real", "real part of s, 1/time", "Re s", ".6g", DECAY, get="frequency.real"),
        Column(
            "imaginary",
            "imaginary part of s, 1/time",
            "Im s",
            ".8g",
            FREQUENCY,
            get="frequency.imag",
        ),
        Column(
            "frequency_hz",
            "Im s / (2 pi), oscillations per unit of time (Hz for seconds)",
            "frequency",
            ".8g",
            FREQUENCY,
            get="hertz",
        ),
        Column("damping_ratio", "-Re s / |s|", "damping ratio", ".6f", SMALL),
        Column("loss_factor", "eta of -s^2 = Omega^2 (1 + i eta)", "loss factor", ".6f", SMALL),
        Column(
            "residual",
            "size of (s^2 M + s Z(s) + K) v relative to that of its terms",
            "residual",
            ".1e",
            None,
        ),
    ),
)
EXPERIMENT = Column("experiment", "name of the experiment", get="table.name")
MEMBER = Column("member", "swept values", "member", get="table.member")


def _at(name: str, part: str = "real") -> Callable[[About], Any]:
    """A getter for the real part, or another part, of an output at a frequency."""
    return lambda of: getattr(getattr(of.table, name)[of.number, of.column].item(), part)


RESPONSE_COLUMNS = (
    Column("at", "coordinate, or combination of them", get="one"),
    Column(
        "frequency_hz",
        "oscillations per unit of time (Hz for seconds)",
        get=lambda of: float(of.table.hertz[of.number]),
    ),
    Column("real", "real part of the amplitude", "", "", PART, get=_at("values")),
    Column("imaginary", "imaginary part of the amplitude", "", "", PART, get=_at("values", "imag")),
    Column("magnitude", "size of the amplitude", "", "", FREQUENCY, get=_at("magnitude")),
    Column(
        "phase",
        "argument of the amplitude, degrees",
        "",
        "",
        Within(absolute=1e-4),
        get=_at("phase"),
    ),
)
PEAK_COLUMNS = (
    Column("at", "coordinate, or combination of them", "at", get="one.at"),
    Column("peak", "number of the peak there, by frequency", get="number"),
    *within(
        "one",
        Column("frequency_hz", "of the peak", "peak at", ".6g", FREQUENCY, get="hertz"),
        Column("magnitude", "of the peak", "magnitude", ".6g", FREQUENCY),
        Column("low_hz", "half-power point below", "half power from", ".6g", FREQUENCY, get="low"),
        Column("high_hz", "half-power point above", "to", ".6g", FREQUENCY, get="high"),
        Column("loss_factor", "width relative to frequency", "loss factor", ".5g", SMALL),
    ),
)


def mode_report(name: str, tables: Sequence[ModeTable]) -> Report:
    """The report on frequencies, damping ratios and loss factors of modes."""
    owner, units = _owner(tables), _units(tables)
    columns = columns_with_units(
        MODE_COLUMNS, units, real="rate", imaginary="rate", frequency_hz="frequency"
    )
    items = [
        About(table=table, one=mode, number=number)
        for table in tables
        for number, mode in enumerate(table.modes, start=1)
    ]
    sheet = _sheet("modes", owner, columns, items, "mode")
    return Report(
        name=f"{name}-modes",
        sheets=(sheet,),
        blocks=list(_mode_words(name, tables, sheet)),
    )


def _units(tables: Sequence[ModeTable] | Sequence[ResponseTable]) -> Mapping[str, str]:
    """The units of the tables; empty if they differ."""
    first = tables[0].units if tables else {}
    return first if all(table.units == first for table in tables) else {}


_QUALITIES = {"displacement": "length", "velocity": "velocity", "acceleration": "acceleration"}


def magnitude_label(table: ResponseTable) -> str:
    """The label of the size of a response, with its unit where all outputs have the same."""
    below = "acceleration" if table.load.split(" ")[0] == GROUND else "force"
    kinds = {_QUALITIES.get(one, "") for one in table.qualities} or {"length"}
    return with_ratio("magnitude", table.units, kinds.pop() if len(kinds) == 1 else "", below)


def _owner(tables: Sequence[ModeTable] | Sequence[ResponseTable]) -> tuple[Column, ...]:
    """Columns with the experiment and member of a row, as far as they differ."""
    owner = (EXPERIMENT,) if len({table.name for table in tables}) > 1 else ()
    return (*owner, MEMBER) if any(table.member for table in tables) else owner


def _sheet(
    name: str,
    owner: tuple[Column, ...],
    columns: tuple[Column, ...],
    items: list[About],
    *keys: str,
) -> Sheet:
    """A sheet whose first columns are `owner`, the experiment and member of a row."""
    members = (item.table.of_member for item in items)
    columns = (*columns, *member_columns(members, lambda of: of.table.of_member))
    return Sheet(
        name=name,
        columns=(*owner, *columns),
        rows=rows_of((EXPERIMENT, MEMBER, *columns), items),
        keys=(*(one.name for one in owner), *keys),
    )


def _own_grid(sheet: Sheet, experiment: str) -> Grid:
    """The grid of the rows of an experiment."""
    own = tuple(row for row in sheet.rows if row["experiment"] == experiment)
    keeps = any(row["member"] for row in own)
    columns = tuple(one for one in sheet.columns if keeps or one is not MEMBER)
    keys = 1 + bool(keeps)
    return replace(sheet, columns=columns, rows=own).grid(text_columns=keys)


def _mode_words(name: str, tables: Sequence[ModeTable], sheet: Sheet) -> Iterator[Block]:
    yield Heading(1, f"Modes: {name}")
    groups = {table.name: [one for one in tables if one.name == table.name] for table in tables}
    for experiment, own in groups.items():
        if len(groups) > 1:
            yield Heading(2, experiment)
        yield _own_grid(sheet, experiment)
        for words in _completeness(own):
            yield Paragraph(words)


def _completeness(tables: Sequence[ModeTable]) -> Iterator[str]:
    """Sentences on missing modes; a single one for a sweep without missing modes."""
    missing = [table for table in tables if not table.is_complete]
    if len(tables) == 1:
        yield completeness(tables[0])
        return
    yield (
        f"None is missing in {len(tables) - len(missing)} of {len(tables)} members: as many modes "
        "are found as the argument of the determinant counts in a region chosen for each, with "
        f"damping ratios up to {LARGEST_RATIO}."
    )
    for table in missing:
        yield f"{table.member}: {completeness(table)}"


def completeness(table: ModeTable) -> str:
    """Whether any mode is missing, in words."""
    region = table.region
    where = (
        f"{region.least / (2 * math.pi):.4g} < |s|/(2 pi) < {region.largest / (2 * math.pi):.4g} "
        f"and damping ratios up to {LARGEST_RATIO}"
    )
    if table.counted is None:
        return f"Modes with {where} were not counted, and others may be missing."
    return (
        f"{'None is missing' if table.is_complete else 'Not complete'}: the argument of the "
        f"determinant turns {table.counted} times around the region with {where}, in which "
        f"{table.inside} modes are found."
    )


def response_report(name: str, tables: Sequence[ResponseTable]) -> Report:
    """The report on amplitudes over frequencies, and peaks with half-power widths."""
    owner, units = _owner(tables), _units(tables)
    items = [
        About(table=table, one=output, number=i, column=column)
        for table in tables
        for column, output in enumerate(table.outputs)
        for i in range(table.hertz.size)
    ]
    peaks = [
        About(
            table=table,
            one=peak,
            number=1 + sum(one.at == peak.at and one.hertz < peak.hertz for one in table.peaks),
        )
        for table in tables
        for peak in table.peaks
    ]
    columns = columns_with_units(
        PEAK_COLUMNS, units, frequency_hz="frequency", low_hz="frequency", high_hz="frequency"
    )
    if units:
        label = magnitude_label(tables[0])
        columns = tuple(replace(c, title=label) if c.name == "magnitude" else c for c in columns)
    # peaks are identified by numbers: the last digits of their frequencies are round-off
    peak_sheet = replace(_sheet("peaks", owner, columns, peaks, "at", "peak"), is_file=False)
    return Report(
        name=f"{name}-response",
        sheets=(
            _sheet("response", owner, RESPONSE_COLUMNS, items, "at", "frequency_hz"),
            peak_sheet,
        ),
        blocks=list(_response_words(name, tables, peak_sheet)),
    )


def _response_words(name: str, tables: Sequence[ResponseTable], peaks: Sheet) -> Iterator[Block]:
    yield Heading(1, f"Harmonic response: {name}")
    groups = {table.name: table for table in tables}
    for experiment, table in groups.items():
        if len(groups) > 1:
            yield Heading(2, experiment)
        unit = all_units(table.units).get("frequency", "")
        ends = f"{table.hertz[0]:g} to {table.hertz[-1]:g} {unit}".rstrip()
        yield Paragraph(f"Load: `{table.load}`; {table.hertz.size} frequencies from {ends}.")
        if any(row["experiment"] == experiment for row in peaks.rows):
            yield _own_grid(peaks, experiment)
        else:
            yield Paragraph("The magnitude has no maximum inside of this range.")
        own = [one for one in tables if one.name == experiment]
        for one in own:
            prefix = f"{one.member}: " if one.member else ""
            if not one.has_all_modes:
                yield Paragraph(
                    f"{prefix}Not all modes in the range are known: peaks that are narrower "
                    "than the spacing of the frequencies may be missing."
                )
            if one.grows:
                yield Paragraph(
                    f"{prefix}A mode grows (fvi modes): motions do not settle into this response."
                )
