"""How much memory can still be taken: the least of everything that limits it."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from fvi_cli.config.machine import machine_bytes

MEGA = 10**6


def tree(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


AVAILABLE = 9000 * 1024


@pytest.fixture(autouse=True)
def _machine(monkeypatch):
    monkeypatch.setattr("psutil.virtual_memory", lambda: SimpleNamespace(available=AVAILABLE))


def test_what_is_available_and_not_what_there_is(tmp_path):
    assert machine_bytes(tmp_path) == AVAILABLE


@pytest.mark.parametrize(
    ("limits", "left"),
    [
        # the innermost, one between, the outermost
        (("3000000", "max", "max"), 3 * MEGA),
        (("max", "2000000", "max"), 2 * MEGA),
        (("8000000", "7000000", "1000000"), 1 * MEGA),
        (("max", "max", "max"), AVAILABLE),
    ],
)
def test_every_group_around_the_process_counts(tmp_path, limits, left):
    places = ("slurm/job_7/step_0", "slurm/job_7", "slurm")
    groups = {
        f"sys/fs/cgroup/{place}/memory.max": limit
        for place, limit in zip(places, limits, strict=True)
    }
    root = tree(tmp_path, groups | {"proc/self/cgroup": "0::/slurm/job_7/step_0\n"})
    assert machine_bytes(root) == left


def test_what_is_taken_is_gone_but_for_cached_files(tmp_path):
    files = {
        "proc/self/cgroup": "0::/\n",
        "sys/fs/cgroup/memory.max": "5000000\n",
        "sys/fs/cgroup/memory.current": "4000000\n",
        "sys/fs/cgroup/memory.stat": "anon 1500000\ninactive_file 2500000\n",
    }
    assert machine_bytes(tree(tmp_path, files)) == 3500000
