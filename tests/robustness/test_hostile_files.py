"""Files that declare what they like: no signal, no hang, no mistake of the program."""

import os
import signal
import time

import pytest

from benchmarks import hostile_files
from benchmarks.hostile_files import KINDS, MATRIX, reproduced, try_kind

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes with limits")


@pytest.mark.few(3)
@pytest.mark.parametrize("kind", KINDS)
def test_files_that_declare_what_they_like(kind):
    found = try_kind(kind, 25, seed=1)
    assert not found.wrong
    assert found.count == 25
    # both happen
    assert 0 < found.refused < 25


@pytest.mark.processes
@pytest.mark.parametrize("kind", KINDS)
def test_many_files_that_declare_what_they_like(kind):
    found = try_kind(kind, 250, seed=2)
    assert not found.wrong
    assert found.count == 250


def test_a_file_is_made_again_of_its_numbers():
    for kind in KINDS:
        assert reproduced(kind, 7, 3) == reproduced(kind, 7, 3)
        assert reproduced(kind, 7, 3) != reproduced(kind, 8, 3)


def test_control_a_process_that_dies_is_told(monkeypatch):
    """Without the look at what is declared, SciPy is given the indices: so it is here."""

    def believed(kind, shape, parts):
        os.kill(os.getpid(), signal.SIGKILL)

    monkeypatch.setattr("fvi_cli.scenes.structures.archives.sparse_matrix", believed)
    found = try_kind(".npz", 8, seed=1)
    assert found.count == 8
    assert any("ended with -9" in line for line in found.wrong)


def take(seconds):
    """Take time of a processor."""
    began = time.process_time()
    while time.process_time() - began < seconds:
        pass


def change_of(problem):
    """Files that are all the same, of which one is not read as it should be."""
    return lambda chance: (MATRIX.format(source=problem), b"1,0\n0,1\n")


@pytest.mark.parametrize(
    ("broken", "told"),
    [
        (lambda: 1 / 0, "ZeroDivisionError"),
        pytest.param(lambda: bytearray(600_000_000), " MB; ", marks=pytest.mark.processes),
        pytest.param(lambda: take(1.2), " s, ", marks=pytest.mark.processes),
    ],
    ids=["mistake", "memory", "time"],
)
def test_control_mistakes_memory_and_time_are_told(monkeypatch, broken, told):
    monkeypatch.setattr(hostile_files, "MOST_SECONDS", 1)
    monkeypatch.setattr(hostile_files, "KINDS", {"broken": ("K.csv", change_of("{file: K.csv}"))})
    real, calls = hostile_files.load_config, []

    def load(path):
        calls.append(path)
        # the first three are read before limits are set
        if len(calls) > 3:
            broken()
        return real(path)

    monkeypatch.setattr(hostile_files, "load_config", load)
    found = try_kind("broken", 1, seed=1)
    (line,) = found.wrong
    assert told in line or "ended with -24" in line
