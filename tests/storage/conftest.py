"""What tests of result files share."""

from pathlib import Path

import pytest
from stored_runs import made_runs, store

from fvi_cli.studies.experiment import FinishedRun


@pytest.fixture
def runs() -> list[FinishedRun]:
    return made_runs()


@pytest.fixture
def path(tmp_path: Path, runs: list[FinishedRun]) -> Path:
    return store(tmp_path, runs)
