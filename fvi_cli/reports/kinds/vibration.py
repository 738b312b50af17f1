"""The reports on modes and on harmonic responses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from fvi_cli.reports.columns import Item, member_columns, member_title
from fvi_cli.reports.naming import unit_of, with_ratio
from fvi_cli.reports.table import Block, Column, Report, Sheet, Within, grid_of, listed
from fvi_cli.studies.vibration.modes import LARGEST_RATIO, ModeTable
from fvi_cli.studies.vibration.response import GROUND, ResponseTable

FREQUENCY = Within(relative=1e-6)
DECAY = Within(relative=1e-5, absolute=1e-6)
PART = Within(relative=1e-6, absolute=1e-12)
SMALL = Within(relative=1e-5, absolute=1e-9)
EXPERIMENT = Column("experiment", get="table.name")
MEMBER = member_title("table.of_member")
MODES = (
    Column("mode", "mode", get="number"),
    Column("real", "Re s", ".6g", DECAY, "rate", "one.frequency.real"),
    Column("imaginary", "Im s", ".8g", FREQUENCY, "rate", "one.frequency.imag"),
    Column("frequency_hz", "frequency", ".8g", FREQUENCY, "frequency", "one.hertz"),
    Column("damping_ratio", "damping ratio", ".6f", SMALL, get="one.damping_ratio"),
    # eta of -s^2 = Omega^2 (1 + i eta)
    Column("loss_factor", "loss factor", ".6f", SMALL, get="one.loss_factor"),
    # size of (s^2 M + s Z(s) + K) v relative to that of its terms
    Column("residual", "residual", ".1e", None, get="one.residual"),
)


def _at(name: str, part: str = "real") -> Callable[[Item], Any]:
    """A getter for the real part, or another part, of an output at a frequency."""
    return lambda of: getattr(getattr(of.table, name)[of.number, of.column].item(), part)


RESPONSE = (
    Column("at", get="output"),
    Column("frequency_hz", get=lambda of: float(of.table.hertz[of.number])),
    Column("real", within=PART, get=_at("values")),
    Column("imaginary", within=PART, get=_at("values", "imag")),
    Column("magnitude", within=FREQUENCY, get=_at("magnitude")),
    Column("phase", within=Within(absolute=1e-4), get=_at("phase")),
)
PEAKS = (
    Column("at", "at", get="one.at"),
    Column("frequency_hz", "peak at", ".6g", FREQUENCY, "frequency", "one.hertz"),
    Column("magnitude", "magnitude", ".6g", FREQUENCY, get="one.magnitude"),
    Column("low_hz", "half power from", ".6g", FREQUENCY, "frequency", "one.low"),
    Column("high_hz", "to", ".6g", FREQUENCY, "frequency", "one.high"),
    Column("loss_factor", "loss factor", ".5g", SMALL, get="one.loss_factor"),
)


def _sheet(name: str, columns: tuple[Column, ...], items: list[Item], **more: Any) -> Sheet:
    """A sheet whose first columns are the experiment and member of a row."""
    swept = member_columns((item.table.of_member for item in items), "table.of_member")
    return Sheet(name=name, columns=(EXPERIMENT, *swept, *columns), items=items, **more)


def mode_report(name: str, tables: Sequence[ModeTable]) -> Report:
    """The report on frequencies, damping ratios and loss factors of modes."""
    items = [
        Item(table=table, one=mode, number=number)
        for table in tables
        for number, mode in enumerate(table.modes, start=1)
    ]
    return Report(
        name=f"{name}-modes",
        sheets=(_sheet("modes", MODES, items),),
        blocks=[f"# Modes: {name}", *_modes(tables)],
    )


def _modes(tables: Sequence[ModeTable]) -> Iterator[Block]:
    groups = _by_experiment(tables)
    for experiment, own in groups.items():
        if len(groups) > 1:
            yield f"## {experiment}"
        items = [Item(table=t, one=m, number=k) for t in own for k, m in enumerate(t.modes, 1)]
        yield grid_of((MEMBER, *MODES), items, own[0].units)
        missing = [table for table in own if not table.is_complete]
        if len(own) == 1:
            yield completeness(own[0])
        elif len(missing) < len(own):
            yield f"None is missing in {len(own) - len(missing)} of {len(own)} members."
        if len(own) > 1:
            yield from listed(f"{table.member}: {completeness(table)}" for table in missing)


def _by_experiment(tables: Sequence[Any]) -> dict[str, list[Any]]:
    return {one.name: [table for table in tables if table.name == one.name] for one in tables}


def completeness(table: ModeTable) -> str:
    """Whether any mode is missing, in words."""
    least, largest = (one / (2 * math.pi) for one in (table.region.least, table.region.largest))
    where = f"{least:.4g} < |s|/(2 pi) < {largest:.4g} and damping ratios up to {LARGEST_RATIO}"
    if table.counted is None:
        return f"Modes with {where} were not counted, and others may be missing."
    return (
        f"{'None is missing' if table.is_complete else 'Not complete'}: {table.counted} modes are "
        f"counted, and {table.inside} found, with {where}."
    )


_QUALITIES = {"displacement": "length", "velocity": "velocity", "acceleration": "acceleration"}


def magnitude_label(table: ResponseTable) -> str:
    """The label of the size of a response, with its unit where all outputs have the same."""
    below = "acceleration" if table.load.split(" ")[0] == GROUND else "force"
    kinds = {_QUALITIES.get(one, "") for one in table.qualities} or {"length"}
    return with_ratio("magnitude", table.units, kinds.pop() if len(kinds) == 1 else "", below)


def response_report(name: str, tables: Sequence[ResponseTable]) -> Report:
    """The report on amplitudes over frequencies, and peaks with half-power widths."""
    items = [
        Item(table=table, output=output, number=number, column=column)
        for table in tables
        for column, output in enumerate(table.outputs)
        for number in range(table.hertz.size)
    ]
    peaks = [Item(table=table, one=peak) for table in tables for peak in table.peaks]
    return Report(
        name=f"{name}-response",
        sheets=(
            _sheet("response", RESPONSE, items),
            _sheet("peaks", PEAKS, peaks, is_file=False),
        ),
        blocks=[f"# Harmonic response: {name}", *_responses(tables)],
    )


def _responses(tables: Sequence[ResponseTable]) -> Iterator[Block]:
    groups = _by_experiment(tables)
    for experiment, own in groups.items():
        table = own[0]
        if len(groups) > 1:
            yield f"## {experiment}"
        ends = f"{table.hertz[0]:g} to {table.hertz[-1]:g} {unit_of(table.units, 'frequency')}"
        yield f"Load: `{table.load}`; {table.hertz.size} frequencies from {ends.rstrip()}."
        label = magnitude_label(table)
        columns = [replace(c, title=label) if c.name == "magnitude" else c for c in PEAKS]
        peaks = [Item(table=one, one=peak) for one in own for peak in one.peaks]
        grid = grid_of((MEMBER, *columns), peaks, table.units)
        yield grid if peaks else "The magnitude has no maximum inside of this range."
        yield from listed(
            f"{one.member}: {words}".removeprefix(": ") for one in own for words in _remarks(one)
        )


def _remarks(table: ResponseTable) -> Iterator[str]:
    if not table.has_all_modes:
        yield "Not all modes in the range are known: narrow peaks may be missing."
    if table.grows:
        yield "A mode grows (fvi modes): no motion settles into this response."
