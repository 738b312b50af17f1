"""How much memory can still be taken: the least of everything that limits it."""

import subprocess
import sys
from pathlib import Path

import pytest

from fvi_cli.config.memory import machine_bytes

MEGA = 10**6


def tree(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


MACHINE = {"proc/meminfo": "MemTotal:  64000000 kB\nMemAvailable:  9000 kB\nHugePages_Total:  0\n"}


def test_what_is_available_and_not_what_there_is(tmp_path):
    assert machine_bytes(tree(tmp_path, MACHINE)) == 9000 * 1024


@pytest.mark.parametrize(
    ("limits", "left"),
    [
        # the innermost, one between, the outermost
        (("3000000", "max", "max"), 3 * MEGA),
        (("max", "2000000", "max"), 2 * MEGA),
        (("8000000", "7000000", "1000000"), 1 * MEGA),
        (("max", "max", "max"), 9000 * 1024),
    ],
)
def test_every_group_around_the_process_counts(tmp_path, limits, left):
    places = ("slurm/job_7/step_0", "slurm/job_7", "slurm")
    groups = {
        f"sys/fs/cgroup/{place}/memory.max": limit
        for place, limit in zip(places, limits, strict=True)
    }
    root = tree(tmp_path, MACHINE | groups | {"proc/self/cgroup": "0::/slurm/job_7/step_0\n"})
    assert machine_bytes(root) == left


def test_what_is_taken_is_gone_but_for_cached_files(tmp_path):
    files = {
        "proc/self/cgroup": "0::/\n",
        "sys/fs/cgroup/memory.max": "5000000\n",
        "sys/fs/cgroup/memory.current": "4000000\n",
        "sys/fs/cgroup/memory.stat": "anon 1500000\ninactive_file 2500000\n",
    }
    assert machine_bytes(tree(tmp_path, MACHINE | files)) == 3500000


def test_groups_of_version_1(tmp_path):
    files = {
        "proc/self/cgroup": "4:memory:/docker/abc\n3:cpu,cpuacct:/docker/abc\n0::/\n",
        "sys/fs/cgroup/memory/docker/memory.limit_in_bytes": "6000000",
        "sys/fs/cgroup/memory/docker/memory.usage_in_bytes": "1000000",
        # none
        "sys/fs/cgroup/memory/docker/abc/memory.limit_in_bytes": "9223372036854771712",
    }
    assert machine_bytes(tree(tmp_path, MACHINE | files)) == 5 * MEGA


def test_a_container_that_does_not_see_its_group_has_the_outermost(tmp_path):
    files = {"proc/self/cgroup": "0::/../../docker/abc\n", "sys/fs/cgroup/memory.max": "4000000\n"}
    assert machine_bytes(tree(tmp_path, MACHINE | files)) == 4 * MEGA


def test_groups_that_have_nothing_left_leave_nothing(tmp_path):
    files = {"sys/fs/cgroup/memory.max": "4000\n", "sys/fs/cgroup/memory.current": "5000\n"}
    assert machine_bytes(tree(tmp_path, MACHINE | files)) == 0


@pytest.mark.skipif(sys.platform == "win32", reason="there is no limit of that kind")
def test_the_limit_of_the_address_space():
    code = (
        "import resource; from fvi_cli.config.memory import machine_bytes\n"
        "resource.setrlimit(resource.RLIMIT_AS, (4 * 10**9, resource.RLIM_INFINITY))\n"
        "print(machine_bytes())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert 10**6 < int(done.stdout) < 4 * 10**9
