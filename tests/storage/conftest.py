"""What tests of result files share."""

from pathlib import Path

import pytest
from stored_runs import made_runs, store

from fvi_cli.storage.files import UNSEALED
from fvi_cli.studies.experiment import FinishedRun


@pytest.fixture(autouse=True)
def unsealed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look at every run by itself where the bytes of a file cannot be verified.

    So are files read that other programs have changed, as users may ask for.
    """
    monkeypatch.setenv(UNSEALED, "1")


@pytest.fixture
def runs() -> list[FinishedRun]:
    return made_runs()


@pytest.fixture
def path(tmp_path: Path, runs: list[FinishedRun]) -> Path:
    return store(tmp_path, runs)
