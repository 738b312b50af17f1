"""What a command takes before it begins: beside the imports it cannot do without."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from benchmarks.measuring import number, table, yes_or_no

REPEATS = 15
LARGEST_MULTIPLE = 1.5
"""Of the imports: what a check of one page should take at the most."""

IMPORTS = "import numpy, typer, yaml\n"
BARE = (
    IMPORTS
    + """
def main(config: str, quiet: bool = False) -> None:
    pass
app = typer.Typer(rich_markup_mode=None, pretty_exceptions_enable=False)
app.command()(main)
app(["damped-oscillator"])
"""
)
COMMANDS: Mapping[str, Sequence[str]] = {
    "`import numpy, typer, yaml`": ("-c", IMPORTS),
    "these, and a command of Typer that does nothing": ("-c", BARE),
    "`fvi --version`": ("-m", "fvi_cli", "--version"),
    "`fvi check damped-oscillator`": ("-m", "fvi_cli", "check", "damped-oscillator"),
}
"""What Python is asked; the first is the yardstick, the last is to keep the goal."""

Clock = Callable[[Sequence[str]], float]


@dataclass(frozen=True, kw_only=True)
class StartupRow:
    """What one command takes.

    Parameters
    ----------
    name
        The command in words.
    seconds
        Least seconds of :data:`REPEATS` calls in turn with the others, from start to end.
    multiple
        The same by those of the first row.
    """

    name: str
    seconds: float
    multiple: float


def seconds_of(arguments: Sequence[str]) -> float:
    """Seconds of one Python process."""
    began = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)  # noqa: S603
    return time.perf_counter() - began


def run_startup(repeats: int = REPEATS, clock: Clock = seconds_of) -> list[StartupRow]:
    """Measure all commands in turn, so that a busy machine is busy for all of them."""
    least = dict.fromkeys(COMMANDS, float("inf"))
    for _ in range(repeats):
        for name, arguments in COMMANDS.items():
            least[name] = min(least[name], clock(arguments))
    yardstick = next(iter(least.values()))
    return [
        StartupRow(name=name, seconds=seconds, multiple=seconds / yardstick)
        for name, seconds in least.items()
    ]


def startup_table(rows: Sequence[StartupRow]) -> str:
    """Markdown: the commands, and whether the last one keeps the goal."""
    remark = (
        f"Least of {REPEATS} processes in turn. The last is to take at most "
        f"{LARGEST_MULTIPLE} times the first: {yes_or_no(rows[-1].multiple <= LARGEST_MULTIPLE)}. "
        "What the second takes is the least that a command can: Typer 0.29 loads pydantic for it."
    )
    return table(
        remark,
        ["process", "seconds", "by the first"],
        ([row.name, number(row.seconds, ".3f"), number(row.multiple, ".2f")] for row in rows),
    )
