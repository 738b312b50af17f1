"""Tables of quantities and events: printed, written, compared."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fvi_cli import reports
from fvi_cli.errors import RequestError
from fvi_cli.reports.kinds.quantities import quantities_report
from fvi_cli.reports.writers.text import show
from fvi_cli.runner.outcome import Outcome


def _report(name: str, outcomes: Sequence[Outcome]) -> reports.Report:
    finished = [one for outcome in outcomes for one in outcome.finished]
    if not any(one.trajectory.observed is not None for one in finished):
        raise RequestError(
            f"{name}: no quantities, events or impacts are asked for; give for example "
            "quantities: {top: ax}"
        )
    return quantities_report(name, finished)


def show_quantities(name: str, outcomes: Sequence[Outcome]) -> None:
    """Print the tables."""
    show(_report(name, outcomes).summary)


def write_quantities(
    name: str, outcomes: Sequence[Outcome], output: Path, *, anew: bool = False
) -> list[Path]:
    """Bring ``tables/<name>-quantities.*`` up to date; returns the paths."""
    return reports.write(output / "tables", _report(name, outcomes), anew=anew)


def compare_quantities(name: str, outcomes: Sequence[Outcome], output: Path) -> list[str]:
    """One line for everything in which the stored tables differ."""
    return reports.compare(output / "tables", _report(name, outcomes))
