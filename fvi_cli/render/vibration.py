"""Modes and harmonic responses: what is printed, written and compared."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from fvi_cli import reports
from fvi_cli.errors import RequestError
from fvi_cli.render.figures import compare_figures, write_figures
from fvi_cli.reports import Report
from fvi_cli.reports.kinds.vibration import mode_report, response_report
from fvi_cli.reports.writers.text import show as show_blocks
from fvi_cli.studies.vibration.modes import ModeTable
from fvi_cli.studies.vibration.response import ResponseTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Tables = Sequence[ModeTable] | Sequence[ResponseTable]


def report_of(name: str, tables: Tables) -> Report:
    """The report on tables of one kind.

    Raises
    ------
    RequestError
        For none, or a mixture.
    """
    modes = [one for one in tables if isinstance(one, ModeTable)]
    responses = [one for one in tables if isinstance(one, ResponseTable)]
    if modes and not responses:
        return mode_report(name, modes)
    if responses and not modes:
        return response_report(name, responses)
    raise RequestError("tables of modes or of responses, one kind at a time")


def figures_of(name: str, tables: Tables) -> dict[str, Figure]:
    """Their figures by name."""
    from fvi_cli.plotting.vibration.spectra import mode_figures, response_figures

    modes = [one for one in tables if isinstance(one, ModeTable)]
    responses = [one for one in tables if isinstance(one, ResponseTable)]
    return mode_figures(name, modes) if modes else response_figures(name, responses)


def show_tables(name: str, tables: Tables) -> None:
    """Print them, on a terminal within its width."""
    show_blocks(report_of(name, tables).summary)


def write_tables(name: str, tables: Tables, output: Path) -> list[Path]:
    """Write tables, figures and, of modes, ``<name>-modes.h5`` with their shapes."""
    paths = reports.write(output / "tables", report_of(name, tables))
    paths += write_figures(figures_of(name, tables), output)
    modes = [one for one in tables if isinstance(one, ModeTable)]
    if modes:
        from fvi_cli.storage.spectra.mode_shapes import write_mode_shapes

        path = output / f"{name}-modes.h5"
        write_mode_shapes(path, modes)
        paths.append(path)
    return paths


def compare_tables(name: str, tables: Tables, output: Path) -> list[str]:
    """One line for everything in which stored tables and figures differ."""
    differences = reports.compare(output / "tables", report_of(name, tables))
    return differences + compare_figures(figures_of(name, tables), output)
