"""The command line as a process of its own, for tests that kill, starve or confine it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from command_line import LADDER
from stored_runs import kept_in

import fvi_cli
from fvi_cli.runner.request import load

QUICK = LADDER.replace("48]", "48, 64, 96]")
N_RUNS = 24

# nonlinear: the last run takes minutes, in little memory
SLOW = QUICK.replace("bagley-torvik", "duffing\n  stiffness: 1.0\n  cubic_stiffness: 1.0")
SLOW = SLOW.replace("t**2.5\n  initial", "t**2.5 + t**7.5\n  initial")
SLOW = SLOW.replace("[4, 8, 16, 24, 32, 48, 64, 96]", "[8, 16, 5000000]")
SLOW = SLOW.replace("[1, 2, 3]", "1")

COMMAND = [sys.executable, "-m", "fvi_cli"]


def environment() -> dict[str, str]:
    """Variables for a process that runs the package which is tested here."""
    package = str(Path(fvi_cli.__file__).parents[1])
    search = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH")]))
    # buffered as users have it: what a stream refuses stays in the buffer
    return {**os.environ, "PYTHONPATH": search, "PYTHONUNBUFFERED": ""}


def started(folder: Path, *arguments: object) -> subprocess.Popen[str]:
    """Begin a command in `folder`; its standard error can be read line by line."""
    return subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def confined(folder: Path, script: str) -> subprocess.CompletedProcess[str] | None:
    """Run a shell script with mounts of its own, ``$FVI`` being the command, ``$PYTHON`` Python.

    None where the system allows nobody to mount anything.
    """
    if shutil.which("unshare") is None:
        return None
    prefix = ["unshare", "--map-root-user", "--mount", "sh", "-euc"]
    probe = [*prefix, "mount -t tmpfs tmpfs ."]
    if subprocess.run(probe, cwd=folder, capture_output=True, check=False).returncode:
        return None
    return subprocess.run(
        [*prefix, script],
        cwd=folder,
        env={**environment(), "FVI": " ".join(COMMAND), "PYTHON": sys.executable},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def complete_runs(path: Path, config: Path | str = "quick.yaml", **changes: str) -> int:
    """How many runs of a configuration are in a file, which must be readable, and in its parts."""
    overrides = [f"{key.replace('__', '.')}={value}" for key, value in changes.items()]
    runs = [run for one in load(config, overrides=overrides).experiments for run in one.runs()]
    return kept_in(path, runs)
