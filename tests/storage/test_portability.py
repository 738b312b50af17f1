"""The package needs nothing that only Unix has: a configuration runs with that hidden."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import fvi_cli

CONFIG = """\
name: portable
problem: {kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0}
method: {rk: gauss, degree: 2}
ladder: {steps: [4, 8]}
"""

HIDING = """\
import os, sys
# what belongs to others, and knows its system, comes first
import filelock, h5py, matplotlib, multiprocessing.popen_spawn_posix, numpy, platform
import psutil, scipy.linalg, yaml
platform.platform()
for name in ("fcntl", "grp", "pwd", "resource", "termios", "tty", "pty", "posix_ipc"):
    sys.modules[name] = None
for name in ("fchmod", "fchown", "pread", "pwrite", "fork", "getuid", "geteuid", "sysconf",
             "getloadavg", "O_CLOEXEC", "O_DIRECTORY", "killpg", "sched_getaffinity"):
    if hasattr(os, name):
        delattr(os, name)
real = os.open
def no_folders(path, *arguments, **keywords):
    if os.path.isdir(path):
        raise PermissionError(13, "Permission denied")
    return real(path, *arguments, **keywords)
os.open = no_folders
import multiprocessing.context
del multiprocessing.context.ForkServerContext
import fvi_cli
import fvi_cli.runner.executor
loaded = fvi_cli.load("portable.yaml")
for _ in range(2):
    (outcome,) = fvi_cli.run(loaded, output="results")
    print([one.status for one in outcome.finished])
print(len(fvi_cli.contents("results/portable.h5").runs))
"""


@pytest.mark.processes
def test_a_configuration_runs_without_what_windows_lacks(tmp_path):
    (tmp_path / "portable.yaml").write_text(CONFIG)
    done = subprocess.run(
        [sys.executable, "-c", HIDING],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(fvi_cli.__file__).parents[1])},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "['ok', 'ok']\n['ok', 'ok']\n2\n"
