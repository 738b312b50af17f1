"""What a command takes before it begins: beside the imports it cannot do without."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence

from benchmarks.measuring import Figure

REPEATS = 15
IMPORTS = "import numpy, typer, yaml, pydantic\n"
COMMANDS: Mapping[str, Sequence[str]] = {
    "`import numpy, typer, yaml, pydantic`": ("-c", IMPORTS),
    "`fvi --version`": ("-m", "fvi_cli", "--version"),
    "`fvi check damped-oscillator`": ("-m", "fvi_cli", "check", "damped-oscillator"),
}
"""What Python is asked; the first is the yardstick."""
GOALS = (1.0, math.inf, 1.5)


def _seconds(arguments: Sequence[str]) -> float:
    began = time.perf_counter()
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True)  # noqa: S603
    return time.perf_counter() - began


def run_startup(repeats: int = REPEATS) -> list[Figure]:
    """Least seconds of all commands in turn, as multiples of those of the imports."""
    times = [[_seconds(arguments) for arguments in COMMANDS.values()] for _ in range(repeats)]
    least = [min(own) for own in zip(*times, strict=True)]
    return [
        Figure(name=name, measured=own / least[0], goal=goal, how=f"{own:.3f} s")
        for name, own, goal in zip(COMMANDS, least, GOALS, strict=True)
    ]
