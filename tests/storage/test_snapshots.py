"""What a command reads of a file is one state of it, whoever replaces it meanwhile."""

import itertools
import threading

import h5py
import numpy as np
import pytest
import stored_runs as t
from command_line import fvi

from fvi_cli.storage import open_results, read_results
from fvi_cli.studies.experiment import FinishedRun

CONFIG = """\
name: ten
problem: {kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0}
method: {bdf: [1, 2], sampling: nodes}
ladder: {steps: [4, 8, 12, 16, 20]}
"""


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The mode of every file that is opened."""
    modes: list[str] = []
    real = h5py.File.__init__

    def counted(self, name, mode="r", *arguments, **keywords):
        if not isinstance(name, h5py.h5g.GroupID):  # the library's own way to a file that is open
            modes.append(mode)
        return real(self, name, mode, *arguments, **keywords)

    monkeypatch.setattr(h5py.File, "__init__", counted)
    return modes


def test_a_command_opens_its_file_as_often_as_it_must(tmp_path, monkeypatch, opened):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "ten.yaml").write_text(CONFIG)

    def count(*arguments: str) -> int:
        opened.clear()
        fvi(*arguments, code=0)
        return len(opened)

    assert count("run", "ten.yaml") == 1
    assert count("run", "ten.yaml") == 1
    assert count("run", "ten.yaml", "--dry-run") == 1
    assert count("convergence", "ten.yaml") == 1
    # control: its configuration is read, then the file is written anew
    assert count("run", "ten.yaml", "--set", "ladder.steps=[4]") == 2
    assert count("convergence", "results/ten.h5") == 2
    assert count("show", "results/ten.h5") == 1
    assert count("export", "results/ten.h5", "-o", "made") == 1


def stamped(stiffness: float) -> list[FinishedRun]:
    """Runs whose numbers all tell of their problem."""
    finished = []
    for run in t.experiment((t.BDF, t.GAUSS), stiffness=stiffness).runs():
        one = t.made_up(run, error=stiffness)
        one.trajectory.position[:] = stiffness
        finished.append(one)
    return finished


def test_a_reader_beside_a_writer_never_mixes_two_problems(tmp_path):
    problems = {value: stamped(value) for value in (1.0, 2.0)}
    path = t.store(tmp_path, problems[1.0])
    stop = threading.Event()
    written = 0

    def write() -> None:
        nonlocal written
        for value in itertools.cycle((2.0, 1.0)):
            if stop.is_set():
                return
            t.store(tmp_path, problems[value], fresh=True)
            written += 1

    writer = threading.Thread(target=write)
    writer.start()
    try:
        reads = 0
        while written < 3 or reads < 5:
            with read_results(path) as stored:
                for value in (1.0, 2.0):
                    found = [stored.finished(finished.run) for finished in problems[value]]
                    # those of the other problem may not all be written yet
                    for one in found if value == 1.0 else filter(None, found):
                        assert one.error == value
                        assert np.all(one.trajectory.position == value)
            reads += 1
    finally:
        stop.set()
        writer.join()


def test_a_journal_that_goes_into_the_file_while_it_is_read_is_read_as_it_was(tmp_path):
    runs = stamped(1.0)
    with open_results(tmp_path, "sample") as results:
        for finished in runs:
            results.add([finished])
        with read_results(tmp_path / "sample.h5") as stored:
            results.consolidate(t.configuration())
            for finished in runs:
                t.assert_same(stored.finished(finished.run), finished)
    assert not (tmp_path / "sample.journal").exists()
    # control: what is nowhere any more is not there
    others = t.experiment(stiffness=3.0).runs()[:2]
    with open_results(tmp_path, "sample") as results:
        results.add([t.made_up(run) for run in others])
    (tmp_path / "sample.journal").unlink()
    with read_results(tmp_path / "sample.h5") as stored:
        assert [stored.finished(run) for run in others] == [None, None]
        assert stored.finished(runs[0].run) is not None


def test_a_file_that_is_open_is_read_as_it_was(tmp_path):
    runs = stamped(1.0)
    path = t.store(tmp_path, runs)
    with read_results(path) as stored:
        path.unlink()
        t.store(tmp_path, stamped(2.0))
        for finished in runs:
            t.assert_same(stored.finished(finished.run), finished)
    with read_results(path) as stored:
        assert stored.finished(runs[0].run) is None
